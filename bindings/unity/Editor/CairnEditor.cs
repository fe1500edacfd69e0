using UnityEditor;
using UnityEngine;

namespace Cairn.Unity.Editor
{
    /// <summary>The inspector of a component: what its project lacks, its fields, and how it is.</summary>
    public abstract class CairnEditor : UnityEditor.Editor
    {
        /// <summary>Draws all of it.</summary>
        public sealed override void OnInspectorGUI()
        {
            string why;
            if (!Plugin.IsReady(out why))
            {
                EditorGUILayout.HelpBox(why, MessageType.Error);
                if (GUILayout.Button("Open the player's settings")) SettingsService.OpenProjectSettings("Project/Player");
            }
            DrawDefaultInspector();
            EditorGUILayout.Space();
            DrawState();
        }

        /// <summary>While it runs it changes.</summary>
        public sealed override bool RequiresConstantRepaint()
        {
            return Application.isPlaying;
        }

        /// <summary>Draws how the component is.</summary>
        protected abstract void DrawState();

        /// <summary>Draws a figure.</summary>
        protected static void Row(string name, object value)
        {
            EditorGUILayout.LabelField(name, value.ToString());
        }
    }
}
