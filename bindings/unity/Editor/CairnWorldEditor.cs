using UnityEditor;

namespace Cairn.Unity.Editor
{
    /// <summary>The inspector of a world: what it is at, and what is missing.</summary>
    [CustomEditor(typeof(CairnWorld))]
    public sealed class CairnWorldEditor : CairnEditor
    {
        /// <summary>Draws it.</summary>
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
