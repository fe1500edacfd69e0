using UnityEditor;
using UnityEngine;

namespace Cairn.Unity.Editor
{
    /// <summary>Inspector of a presenter: its statistics, and below them a preview.</summary>
    [CustomEditor(typeof(CairnPresenter))]
    public sealed class CairnPresenterEditor : CairnEditor
    {
        /// <summary>Draws the statistics.</summary>
        protected override void DrawState()
        {
            var presenter = (CairnPresenter)target;
            if (presenter.Failure.Length > 0) EditorGUILayout.HelpBox(presenter.Failure, MessageType.Error);
            PresenterStatistics done = presenter.Statistics;
            if (done == null) return;
            Row("Frames shown", presenter.Shown);
            Row("Anchors", done.Anchors);
            Row("Late anchors", done.LateAnchors);
            Row("Anchors that were not taken", presenter.Missed);
            Row("Generated", done.ShownGenerated);
            Row("Generator", done.Generator);
            if (done.Preference.Length > 0) Row("Because", done.Preference);
        }

        /// <summary>There is a preview while the presenter is enabled.</summary>
        public override bool HasPreviewGUI()
        {
            return ((CairnPresenter)target).Texture != null;
        }

        /// <summary>Title of the preview.</summary>
        public override GUIContent GetPreviewTitle()
        {
            return new GUIContent("Cairn");
        }

        /// <summary>Draws the preview with the frames' aspect ratio.</summary>
        public override void OnPreviewGUI(Rect place, GUIStyle background)
        {
            RenderTexture texture = ((CairnPresenter)target).Texture;
            if (texture == null || Event.current.type != EventType.Repaint) return;
            float scale = Mathf.Min(place.width / texture.width, place.height / texture.height);
            var size = new Vector2(texture.width * scale, texture.height * scale);
            var middle = new Rect(
                place.x + (place.width - size.x) / 2, place.y + (place.height - size.y) / 2, size.x, size.y);
            GUI.DrawTextureWithTexCoords(middle, texture, CairnPresenter.Upright, false);
        }
    }
}
