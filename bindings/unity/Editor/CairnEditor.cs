using UnityEditor;
using UnityEngine;

namespace Cairn.Unity.Editor
{
    /// <summary>Inspector of a component: problems of the project, the component's fields, and its state.</summary>
    public abstract class CairnEditor : UnityEditor.Editor
    {
        /// <summary>Draws the inspector.</summary>
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

        /// <summary>Repaints continuously in play mode.</summary>
        public sealed override bool RequiresConstantRepaint()
        {
            return Application.isPlaying;
        }

        /// <summary>Draws the component's state.</summary>
        protected abstract void DrawState();

        /// <summary>Draws a value.</summary>
        protected static void Row(string name, object value)
        {
            EditorGUILayout.LabelField(name, value.ToString());
        }
    }
}
