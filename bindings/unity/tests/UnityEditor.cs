// The parts of Unity's editor that the package uses, declared as in the file beside this one.

using System;
using UnityEngine;

namespace UnityEditor
{
    [AttributeUsage(AttributeTargets.Class)]
    public sealed class CustomEditor : Attribute
    {
        public CustomEditor(Type inspectedType)
        {
        }
    }

    public class Editor : UnityEngine.Object
    {
        public UnityEngine.Object target { get; set; }

        public virtual void OnInspectorGUI()
        {
        }

        public bool DrawDefaultInspector()
        {
            return false;
        }

        public virtual bool RequiresConstantRepaint()
        {
            return false;
        }

        public virtual bool HasPreviewGUI()
        {
            return false;
        }

        public virtual GUIContent GetPreviewTitle()
        {
            return null;
        }

        public virtual void OnPreviewGUI(Rect r, GUIStyle background)
        {
        }
    }

    public enum MessageType
    {
        None, Info, Warning, Error,
    }

    public sealed class EditorGUILayout
    {
        public static void Space()
        {
        }

        public static void LabelField(string label, string label2, params GUILayoutOption[] options)
        {
        }

        public static void HelpBox(string message, MessageType type)
        {
        }
    }

    public static class SettingsService
    {
        public static EditorWindow OpenProjectSettings(string settingsPath = null)
        {
            return null;
        }
    }

    public class EditorWindow : UnityEngine.Object
    {
    }
}
