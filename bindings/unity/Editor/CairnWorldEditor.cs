using UnityEditor;
using UnityEngine;

namespace Cairn.Unity.Editor
{
    /// <summary>The inspector of a world: what it is at, and what is missing.</summary>
    [CustomEditor(typeof(CairnWorld))]
    public sealed class CairnWorldEditor : UnityEditor.Editor
    {
        /// <summary>Draws it.</summary>
        public override void OnInspectorGUI()
        {
            ProjectCheck.Draw();
            DrawDefaultInspector();
            var world = (CairnWorld)target;
            EditorGUILayout.Space();
            EditorGUILayout.LabelField("State", world.State.ToString());
            if (world.State == WorldState.Failed) EditorGUILayout.HelpBox(world.Message, MessageType.Error);
            else if (world.Message.Length > 0) EditorGUILayout.HelpBox(world.Message, MessageType.Info);
            if (world.State == WorldState.Running) EditorGUILayout.LabelField("Anchors", world.Anchors.ToString());
        }

        /// <summary>While it runs figures change.</summary>
        public override bool RequiresConstantRepaint()
        {
            return Application.isPlaying;
        }
    }
}
