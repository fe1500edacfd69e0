using UnityEditor;

namespace Cairn.Unity.Editor
{
    /// <summary>Inspector of a world: its state, and what is missing.</summary>
    [CustomEditor(typeof(CairnWorld))]
    public sealed class CairnWorldEditor : CairnEditor
    {
        /// <summary>Draws the state.</summary>
        protected override void DrawState()
        {
            var world = (CairnWorld)target;
            Row("State", world.State);
            if (world.State == WorldState.Failed) EditorGUILayout.HelpBox(world.Message, MessageType.Error);
            else if (world.Message.Length > 0) EditorGUILayout.HelpBox(world.Message, MessageType.Info);
            if (world.State == WorldState.Running) Row("Anchors", world.Anchors);
        }
    }
}
