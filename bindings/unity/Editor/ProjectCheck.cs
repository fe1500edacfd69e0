using UnityEditor;
using UnityEngine;

namespace Cairn.Unity.Editor
{
    /// <summary>Says in an inspector why the project cannot show a world, and leads to the setting.</summary>
    internal static class ProjectCheck
    {
        internal static void Draw()
        {
            string why;
            if (Plugin.IsReady(out why)) return;
            EditorGUILayout.HelpBox(why, MessageType.Error);
            if (GUILayout.Button("Open the player's settings")) SettingsService.OpenProjectSettings("Project/Player");
        }
    }
}
