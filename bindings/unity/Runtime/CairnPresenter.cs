using System;
using System.IO;
using UnityEngine;
using UnityEngine.Rendering;

namespace Cairn.Unity
{
    /// <summary>Destination of a presenter's frames.</summary>
    public enum PresenterOutput
    {
        /// <summary>Over the whole screen.</summary>
        Screen,
        /// <summary>Into the main texture of the renderer on the same object, whose own texture is restored at the end.</summary>
        Renderer,
        /// <summary>Only into <see cref="CairnPresenter.Texture"/>.</summary>
        Texture,
    }

    /// <summary>Colour format of a presenter's texture.</summary>
    public enum PresenterFormat
    {
        /// <summary>Eight bits per channel, sRGB.</summary>
        ARGB32,
        /// <summary>Half floats: linear light in a project with linear colour space, otherwise sRGB.</summary>
        ARGBHalf,
        /// <summary>Floats of 11, 11 and 10 bits without alpha, with the same colours as ARGBHalf.</summary>
        RGB111110,
    }

    /// <summary>
    /// Shows a <see cref="CairnWorld"/> at the display's rate: its anchors, and frames generated between them on Unity's own graphics device, in a
    /// render texture. When the world ends, the texture keeps the last frame; with screen output the game becomes visible.
    /// </summary>
    [AddComponentMenu("Cairn/Cairn Presenter")]
    [DisallowMultipleComponent]
    public sealed class CairnPresenter : MonoBehaviour
    {
        [SerializeField, Tooltip("The world that is shown.")]
        private CairnWorld world = null;

        [SerializeField, Min(1), Tooltip("Width of the frames in pixels.")]
        private int width = 1280;

        [SerializeField, Min(1), Tooltip("Height of the frames in pixels.")]
        private int height = 720;

        [SerializeField, Tooltip("Colour format of the texture. Use floats with HDR rendering.")]
        private PresenterFormat format = PresenterFormat.ARGB32;

        [SerializeField, Tooltip("Frames per anchor: 1, 2, 3, 4 or 6.")]
        private int multiplier = 2;

        [SerializeField, Tooltip("Keeps the anchors' aspect ratio with black bars, instead of stretching.")]
        private bool letterbox = true;

        [SerializeField, Tooltip("AMD FidelityFX frame generation, if its libraries are installed.")]
        private Preference fsr = Preference.Auto;

        [SerializeField, Tooltip("Destination of frames.")]
        private PresenterOutput output = PresenterOutput.Screen;

        private readonly object pushing = new object();
        // Copies of the properties that are read when the component is enabled.
        private CairnWorld enabledWorld;
        private PresenterFormat enabledFormat;
        private PresenterOutput enabledOutput;
        private int enabledMultiplier;
        private RenderTexture texture;
        private IntPtr pointer;
        private CommandBuffer commands;
        private Presenter presenter;
        private Plugin.View view;
        private Device device;
        // The last error of each activity, for `Failure` and so that it is logged once. A success clears it; that of the setup stays until the
        // component is enabled again.
        private string setupError = "";
        private string showError = "";
        private string prepareError = "";
        private string pushError = "";
        private long missed;
        /// <summary>File that keeps compiled pipelines for the next run.</summary>
        private string pipelines = "";
        private int preparedWidth;
        private int preparedHeight;
        private long shownBefore;
        private Material surface;
        private Texture surfaceTexture;
        private Vector2 surfaceScale;
        private Vector2 surfaceOffset;

        /// <summary>The world to show. Read when the component is enabled.</summary>
        public CairnWorld World
        {
            get { return world; }
            set { world = value; }
        }

        /// <summary>Destination of frames. Read when the component is enabled.</summary>
        public PresenterOutput Output
        {
            get { return output; }
            set { output = value; }
        }

        /// <summary>Colour format of the texture. Read when the component is enabled.</summary>
        public PresenterFormat Format
        {
            get { return format; }
            set { format = value; }
        }

        /// <summary>Frames per anchor: 1, 2, 3, 4 or 6. Read when the component is enabled.</summary>
        public int Multiplier
        {
            get { return multiplier; }
            set { multiplier = value; }
        }

        /// <summary>The frames, upside down to a sampler like native render output: <see cref="Upright"/> shows them. Null while disabled.</summary>
        public RenderTexture Texture
        {
            get { return texture; }
        }

        /// <summary>Texture coordinates that show <see cref="Texture"/> upright.</summary>
        public static Rect Upright
        {
            get { return new Rect(0, 1, 1, -1); }
        }

        /// <summary>What failed, such as why nothing is shown; empty if there is no failure.</summary>
        public string Failure
        {
            get
            {
                lock (pushing)
                {
                    if (setupError.Length > 0) return setupError;
                    if (showError.Length > 0) return showError;
                    return prepareError.Length > 0 ? prepareError : pushError;
                }
            }
        }

        /// <summary>Anchors dropped because the maximum number was waiting.</summary>
        public long Missed
        {
            get { lock (pushing) return missed; }
        }

        /// <summary>Frames copied into <see cref="Texture"/> since the component was enabled.</summary>
        public long Shown
        {
            get
            {
                long shown = 0;
                string why;
                if (view != null) view.TryGetShown(out shown, out why);
                return shownBefore + shown;
            }
        }

        /// <summary>Statistics; null before the world runs.</summary>
        public PresenterStatistics Statistics
        {
            get { return presenter == null ? null : presenter.Statistics; }
        }

        /// <summary>Changes the size of the frames.</summary>
        /// <param name="newWidth">In pixels.</param>
        /// <param name="newHeight">In pixels.</param>
        public void Resize(int newWidth, int newHeight)
        {
            if (newWidth <= 0 || newHeight <= 0) throw new ArgumentException($"There are no frames of {newWidth} x {newHeight} pixels");
            // Frames in flight have the old texture's size and are discarded.
            EndView();
            if (presenter != null) presenter.Resize(newWidth, newHeight);
            lock (pushing)
            {
                width = newWidth;
                height = newHeight;
            }
            if (texture != null) MakeTexture();
        }

        /// <summary>Takes an anchor on the world's thread, which also prepares frames of a new size.</summary>
        /// <param name="from">Its world. The presenter may have another by now, and takes no anchor of this one then.</param>
        /// <param name="anchor">The anchor.</param>
        internal void Push(CairnWorld from, Anchor anchor)
        {
            Presenter unprepared = null;
            Device with = null;
            int newWidth;
            int newHeight;
            lock (pushing)
            {
                if (presenter == null || !ReferenceEquals(from, enabledWorld)) return;
                newWidth = width;
                newHeight = height;
                try
                {
                    if (!presenter.TryPush(anchor, Clock.NowNs)) missed++;
                    pushError = "";
                    if (preparedWidth != newWidth || preparedHeight != newHeight)
                    {
                        unprepared = presenter;
                        with = device;
                    }
                }
                catch (CairnException why)
                {
                    if (pushError != why.Message) Debug.LogError("Cairn: " + why.Message);
                    pushError = why.Message;
                }
            }
            // Outside the lock: it takes long, and Unity's main thread must not wait for it.
            if (unprepared != null) Prepare(with, unprepared, newWidth, newHeight, anchor.Info);
        }

        private void Prepare(Device with, Presenter unprepared, int newWidth, int newHeight, AnchorInfo anchor)
        {
            string why = "";
            try
            {
                Plugin.Prepare(with, unprepared, newWidth, newHeight, anchor.Width, anchor.Height, pipelines);
            }
            catch (CairnException failure)
            {
                why = failure.Message;
            }
            catch (ObjectDisposedException)
            {
                // The component was disabled meanwhile.
                return;
            }
            lock (pushing)
            {
                if (presenter != unprepared) return;
                // Without the component as context, because it belongs to the main thread.
                if (why.Length > 0) Debug.LogError("Cairn: " + why);
                prepareError = why;
                // A size whose preparation failed is not tried again for each anchor.
                preparedWidth = newWidth;
                preparedHeight = newHeight;
            }
        }

        private void OnEnable()
        {
            lock (pushing)
            {
                setupError = "";
                showError = "";
                prepareError = "";
                pushError = "";
                missed = 0;
                enabledWorld = world;
            }
            shownBefore = 0;
            enabledFormat = format;
            enabledOutput = output;
            enabledMultiplier = multiplier;
            pipelines = Path.Combine(Application.persistentDataPath, "Cairn", "pipelines.bin");
            string why;
            if (!Plugin.IsReady(out why))
            {
                FailSetup(why);
                return;
            }
            if (enabledWorld == null)
            {
                FailSetup("The presenter has no world. Give it a Cairn World.");
                return;
            }
            MakeTexture();
            commands = new CommandBuffer { name = "Cairn" };
            enabledWorld.Add(this);
        }

        private void OnDisable()
        {
            if (enabledWorld != null) enabledWorld.Remove(this);
            Close();
            if (commands != null) commands.Release();
            commands = null;
            DetachFromRenderer();
            DestroyTexture();
        }

        private void LateUpdate()
        {
            if (commands == null) return;
            Device now = enabledWorld == null ? null : enabledWorld.Device;
            if (now != device) Close();
            if (now == null) return;
            try
            {
                if (presenter == null) Open(now);
                if (view == null) BeginView();
                if (!texture.IsCreated()) MakeTexture();
                view.Set(Clock.NowNs, pointer);
                Graphics.ExecuteCommandBuffer(commands);
                long shown;
                string why;
                if (view.TryGetShown(out shown, out why)) showError = "";
                else if (why != showError) Fail(why);
            }
            catch (CairnException why)
            {
                Close();
                if (why.Message != showError) Fail(why.Message);
            }
            catch (ObjectDisposedException)
            {
                // The world was disabled between two statements.
                Close();
            }
        }

        private void OnGUI()
        {
            if (enabledOutput != PresenterOutput.Screen || texture == null || view == null) return;
            if (Event.current.type != EventType.Repaint) return;
            var screen = new Rect(0, 0, UnityEngine.Screen.width, UnityEngine.Screen.height);
            GUI.DrawTextureWithTexCoords(screen, texture, Upright, false);
        }

        private void Open(Device with)
        {
            var made = new Presenter(new PresenterOptions
            {
                Multiplier = enabledMultiplier, Width = width, Height = height, Letterbox = letterbox, Fsr = fsr, CatchUp = true,
                ColourSpace = IsLinear ? ColourSpace.Linear : ColourSpace.Srgb,
            });
            lock (pushing)
            {
                device = with;
                presenter = made;
                preparedWidth = 0;
                preparedHeight = 0;
            }
        }

        private void BeginView()
        {
            view = new Plugin.View(device, presenter);
            commands.Clear();
            view.Issue(commands);
        }

        /// <summary>After this returns, no event runs, and later ones do nothing.</summary>
        private void EndView()
        {
            if (view == null) return;
            shownBefore = Shown;
            view.Dispose();
            view = null;
        }

        private void Close()
        {
            Presenter left;
            lock (pushing)
            {
                left = presenter;
                presenter = null;
            }
            // The view first: its events use the presenter.
            EndView();
            device = null;
            if (left != null) left.Dispose();
        }

        /// <summary>Whether frames are linear light, as shaders of a linear project expect of float textures.</summary>
        private bool IsLinear
        {
            get { return enabledFormat != PresenterFormat.ARGB32 && QualitySettings.activeColorSpace == ColorSpace.Linear; }
        }

        private static RenderTextureFormat FormatOf(PresenterFormat format)
        {
            switch (format)
            {
                case PresenterFormat.ARGBHalf: return RenderTextureFormat.ARGBHalf;
                case PresenterFormat.RGB111110: return RenderTextureFormat.RGB111110Float;
                default: return RenderTextureFormat.ARGB32;
            }
        }

        private void MakeTexture()
        {
            RenderTextureFormat wanted = FormatOf(enabledFormat);
            if (!SystemInfo.SupportsRenderTextureFormat(wanted))
            {
                FailSetup($"This graphics card renders into no texture of {wanted}. Set Format to ARGB32.");
                enabledFormat = PresenterFormat.ARGB32;
                wanted = RenderTextureFormat.ARGB32;
            }
            if (texture == null || texture.width != width || texture.height != height)
            {
                DestroyTexture();
                // Float textures have no sRGB conversion in the sampler.
                RenderTextureReadWrite curve = enabledFormat == PresenterFormat.ARGB32 ? RenderTextureReadWrite.sRGB : RenderTextureReadWrite.Linear;
                texture = new RenderTexture(width, height, 0, wanted, curve)
                {
                    name = "Cairn", useMipMap = false, antiAliasing = 1, filterMode = FilterMode.Bilinear,
                };
            }
            texture.Create();
            // Queried once, because Unity waits for its render thread to answer.
            pointer = texture.GetNativeTexturePtr();
            if (enabledOutput == PresenterOutput.Renderer) AttachToRenderer();
        }

        private void DestroyTexture()
        {
            if (texture != null)
            {
                texture.Release();
                Destroy(texture);
            }
            texture = null;
            pointer = IntPtr.Zero;
        }

        /// <summary>Sets the texture on the renderer of the same object.</summary>
        private void AttachToRenderer()
        {
            if (surface == null)
            {
                var shown = GetComponent<Renderer>();
                if (shown == null)
                {
                    FailSetup("The output is Renderer, and there is none beside the presenter.");
                    return;
                }
                surface = shown.material;
                surfaceTexture = surface.mainTexture;
                surfaceScale = surface.mainTextureScale;
                surfaceOffset = surface.mainTextureOffset;
            }
            surface.mainTexture = texture;
            surface.mainTextureScale = Upright.size;
            surface.mainTextureOffset = Upright.position;
        }

        /// <summary>Restores the renderer's own texture.</summary>
        private void DetachFromRenderer()
        {
            if (surface == null) return;
            surface.mainTexture = surfaceTexture;
            surface.mainTextureScale = surfaceScale;
            surface.mainTextureOffset = surfaceOffset;
            surface = null;
            surfaceTexture = null;
        }

        private void FailSetup(string why)
        {
            if (why == setupError) return;
            lock (pushing) setupError = why;
            Debug.LogError("Cairn: " + why, this);
        }

        private void Fail(string why)
        {
            lock (pushing) showError = why;
            Debug.LogError("Cairn: " + why, this);
        }
    }
}
