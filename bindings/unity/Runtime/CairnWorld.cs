using System;
using System.Collections.Generic;
using System.IO;
using System.Threading;
using UnityEngine;

namespace Cairn.Unity
{
    /// <summary>State of a world.</summary>
    public enum WorldState
    {
        /// <summary>Disabled.</summary>
        Off,
        /// <summary>Loading.</summary>
        Loading,
        /// <summary>Making anchors.</summary>
        Running,
        /// <summary>Failed; the message has the reason.</summary>
        Failed,
    }

    /// <summary>Processor of a world.</summary>
    public enum WorldProcessor
    {
        /// <summary>Unity's graphics device, on a queue of its own beside the drawing one.</summary>
        Graphics,
        /// <summary>The machine's processor: small worlds only.</summary>
        Processor,
    }

    /// <summary>
    /// A running world: loads a bundle, starts from a seed picture, and makes anchors from the player's controls at the world's own rate, all on a
    /// thread of its own. A <see cref="CairnPresenter"/> shows it.
    /// </summary>
    [AddComponentMenu("Cairn/Cairn World")]
    [DisallowMultipleComponent]
    public sealed class CairnWorld : MonoBehaviour
    {
        [SerializeField, Tooltip("The bundle: a path, or one below StreamingAssets. Empty for the world inside the library.")]
        private string bundle = "";

        [SerializeField, Tooltip("A preset with changes after commas, such as coherence or stock,g64. Empty for the bundle's own.")]
        private string operatingPoint = "";

        [SerializeField, Tooltip("The picture that the world starts from. Read/Write must be ticked in its import settings.")]
        private Texture2D seed = null;

        [SerializeField, Tooltip("Seed of the world's noise.")]
        private int noise = 1;

        [SerializeField, Tooltip("Processor on which the world runs.")]
        private WorldProcessor processor = WorldProcessor.Graphics;

        [SerializeField, Tooltip("Source of controls. Empty for none.")]
        private CairnInput input = null;

        private readonly object changing = new object();
        private readonly List<CairnPresenter> presenters = new List<CairnPresenter>();
        private WorldState state = WorldState.Off;
        private string message = "";
        private long anchors;
        private long lastUpdate;
        private byte[] seedPixels;
        private int seedWidth;
        private int seedHeight;
        private WorldThread work;

        /// <summary>The bundle: a path, or one below StreamingAssets; empty for the embedded world. Read when the component is enabled.</summary>
        public string Bundle
        {
            get { return bundle; }
            set { bundle = value ?? ""; }
        }

        /// <summary>Operating point; empty for the bundle's own. Read when the component is enabled.</summary>
        public string OperatingPoint
        {
            get { return operatingPoint; }
            set { operatingPoint = value ?? ""; }
        }

        /// <summary>Processor of the world. Read when the component is enabled.</summary>
        public WorldProcessor Processor
        {
            get { return processor; }
            set { processor = value; }
        }

        /// <summary>Source of controls; null for none. Read when the component is enabled.</summary>
        public CairnInput Input
        {
            get { return input; }
            set { input = value; }
        }

        /// <summary>Current state.</summary>
        public WorldState State
        {
            get { lock (changing) return state; }
        }

        /// <summary>Progress of loading, or the reason of a failure, as text.</summary>
        public string Message
        {
            get { lock (changing) return message; }
        }

        /// <summary>Anchors made since the component was enabled.</summary>
        public long Anchors
        {
            get { lock (changing) return anchors; }
        }

        /// <summary>The device on which frames are made; null until there is one.</summary>
        internal Device Device
        {
            get { lock (changing) return work == null ? null : work.Device; }
        }

        /// <summary>Sets the seed picture from memory: RGBA, rows from top to bottom. Read when the component is enabled.</summary>
        /// <param name="pixels">Four bytes per pixel.</param>
        /// <param name="width">In pixels.</param>
        /// <param name="height">In pixels.</param>
        public void SetSeed(byte[] pixels, int width, int height)
        {
            if (pixels == null) throw new ArgumentNullException(nameof(pixels));
            if (width <= 0 || height <= 0 || pixels.LongLength != 4L * width * height)
            {
                throw new ArgumentException($"{pixels.LongLength} bytes are no picture of {width} x {height} pixels", nameof(pixels));
            }
            seedPixels = pixels;
            seedWidth = width;
            seedHeight = height;
        }

        /// <summary>Registers a presenter, which gets each anchor.</summary>
        internal void Add(CairnPresenter presenter)
        {
            lock (presenters) presenters.Add(presenter);
        }

        /// <summary>Unregisters a presenter. An anchor that is on its way to it may still arrive.</summary>
        internal void Remove(CairnPresenter presenter)
        {
            lock (presenters) presenters.Remove(presenter);
        }

        private void OnEnable()
        {
            anchors = 0;
            string why;
            if (!Plugin.IsReady(out why))
            {
                Fail(why);
                return;
            }
            if (!TakeSeed(out why))
            {
                Fail(why);
                return;
            }
            try
            {
                Plugin.Load();
            }
            catch (Exception wrong) when (wrong is CairnException || wrong is InvalidOperationException)
            {
                Fail(wrong.Message);
                return;
            }
            SetState(WorldState.Loading, "Loading");
            work = new WorldThread(this);
        }

        private void OnDisable()
        {
            WorldThread left;
            lock (changing)
            {
                left = work;
                work = null;
            }
            if (left != null) left.Stop();
            SetState(WorldState.Off, "");
        }

        /// <summary>Copies the texture's pixels, rows from top to bottom.</summary>
        private bool TakeSeed(out string why)
        {
            why = "";
            if (seed == null)
            {
                if (seedPixels != null) return true;
                why = "The world has no seed. Give it a picture to start from, like one that the world was trained on.";
                return false;
            }
            if (!seed.isReadable)
            {
                why = $"The seed {seed.name} cannot be read. Tick Read/Write in its import settings.";
                return false;
            }
            Color32[] colours = seed.GetPixels32();
            var pixels = new byte[colours.Length * 4];
            for (int row = 0; row < seed.height; row++)
            {
                for (int column = 0; column < seed.width; column++)
                {
                    // Unity's first row is at the bottom.
                    Color32 colour = colours[(seed.height - 1 - row) * seed.width + column];
                    int at = (row * seed.width + column) * 4;
                    pixels[at] = colour.r;
                    pixels[at + 1] = colour.g;
                    pixels[at + 2] = colour.b;
                    pixels[at + 3] = 255;
                }
            }
            SetSeed(pixels, seed.width, seed.height);
            return true;
        }

        private void Update()
        {
            NoteUpdate();
        }

        private void NoteUpdate()
        {
            Volatile.Write(ref lastUpdate, Clock.NowNs);
        }

        /// <summary>Whether the game has not updated for half a second, as while an editor pauses it or another program is in front.</summary>
        private bool IsHeld
        {
            get { return Clock.NowNs - Volatile.Read(ref lastUpdate) > 500000000; }
        }

        private void SetState(WorldState now, string what)
        {
            lock (changing)
            {
                state = now;
                message = what;
            }
        }

        private void Fail(string why)
        {
            SetState(WorldState.Failed, why);
            Debug.LogError("Cairn: " + why, this);
        }

        /// <summary>The world's thread, from loading to its end.</summary>
        private sealed class WorldThread
        {
            private readonly CairnWorld owner;
            private readonly WorldOptions options;
            private readonly RolloutOptions rolloutOptions;
            private readonly WorldProcessor processor;
            private readonly CairnInput input;
            private readonly byte[] seed;
            private readonly int width;
            private readonly int height;
            private readonly Thread thread;
            private readonly ManualResetEvent stopping = new ManualResetEvent(false);
            private volatile Device device;

            internal WorldThread(CairnWorld owner)
            {
                this.owner = owner;
                string path = owner.bundle;
                if (path.Length > 0 && !Path.IsPathRooted(path)) path = Path.Combine(Application.streamingAssetsPath, path);
                options = new WorldOptions
                {
                    Path = path.Length == 0 ? null : path,
                    OperatingPoint = owner.operatingPoint.Length == 0 ? null : owner.operatingPoint,
                    FitWindow = true,
                    Progress = OnProgress,
                };
                rolloutOptions = new RolloutOptions { Seed = (ulong)(uint)owner.noise };
                processor = owner.processor;
                input = owner.input;
                seed = owner.seedPixels;
                width = owner.seedWidth;
                height = owner.seedHeight;
                thread = new Thread(Run) { IsBackground = true, Name = "Cairn world" };
                thread.Start();
            }

            internal Device Device
            {
                get { return device; }
            }

            /// <summary>Stops the thread and waits for the step that is being made.</summary>
            internal void Stop()
            {
                stopping.Set();
                thread.Join();
                stopping.Close();
            }

            private bool IsStopping
            {
                get { return stopping.WaitOne(0); }
            }

            private bool OnProgress(LoadStage stage, long done, long total)
            {
                string what = stage == LoadStage.Reading ? "Reading the bundle" : "Preparing the graphs";
                owner.SetState(WorldState.Loading, $"{what}: {(total > 0 ? 100 * done / total : 0)} %");
                return !IsStopping;
            }

            private void Run()
            {
                try
                {
                    using (Device shown = Plugin.CreateDevice())
                    using (Device other = processor == WorldProcessor.Processor ? Cairn.Device.Cpu() : null)
                    using (World world = (other ?? shown).LoadWorld(options))
                    using (Rollout rollout = world.CreateRollout(rolloutOptions))
                    {
                        rollout.Append(new PictureView(seed, width, height));
                        device = shown;
                        try
                        {
                            Play(rollout);
                        }
                        finally
                        {
                            // Before the device is destroyed: presenters use it as long as they see it.
                            device = null;
                        }
                    }
                }
                catch (CairnException why) when (why.Result == Result.Cancelled && IsStopping)
                {
                    // The component was disabled during the load.
                }
                catch (Exception why)
                {
                    owner.SetState(WorldState.Failed, why.Message);
                    // Without the component as context, because it belongs to the main thread.
                    Debug.LogError("Cairn: " + why.Message);
                }
            }

            /// <summary>Makes one anchor per interval until stopped, while the game updates.</summary>
            private void Play(Rollout rollout)
            {
                RolloutInfo info = rollout.Info;
                long interval = 1000000000 / Math.Max(1, info.LatentsPerSecond);
                owner.SetState(WorldState.Running, $"{info.OperatingPoint}: {info.LatentsPerSecond} anchors a second");
                // The player's input while the world was loading is not for its first step. Keys that are still held stay held.
                if (input != null) input.Take();
                // Loading may have taken longer than an update may.
                owner.NoteUpdate();
                long next = Clock.NowNs;
                bool wasHeld = false;
                while (!IsStopping)
                {
                    if (owner.IsHeld)
                    {
                        wasHeld = true;
                        stopping.WaitOne(20);
                        continue;
                    }
                    if (wasHeld)
                    {
                        // The player's input during a pause is discarded.
                        if (input != null) input.Take();
                        next = Clock.NowNs;
                        wasHeld = false;
                    }
                    rollout.Step(input == null ? default(Controls) : input.Take());
                    using (Anchor anchor = rollout.Anchor()) owner.Show(anchor);
                    // A world that is too slow does not catch up later.
                    next = Math.Max(next + interval, Clock.NowNs);
                    long left = (next - Clock.NowNs) / 1000000;
                    if (left > 0) stopping.WaitOne((int)left);
                }
            }
        }

        private void Show(Anchor anchor)
        {
            lock (changing) anchors++;
            CairnPresenter[] all;
            lock (presenters) all = presenters.ToArray();
            // Outside the lock: a presenter's first anchor compiles pipelines, and Unity's main thread must not wait for that.
            foreach (CairnPresenter presenter in all) presenter.Push(this, anchor);
        }
    }
}
