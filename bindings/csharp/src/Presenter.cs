using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Whether a generator is used.</summary>
    public enum Preference
    {
        /// <summary>Where it can be.</summary>
        Auto = Native.PREFER_AUTO,
        /// <summary>It is, or there is no presenter.</summary>
        Require = Native.PREFER_REQUIRE,
        /// <summary>It is not.</summary>
        Never = Native.PREFER_NEVER,
    }

    /// <summary>What the colours of frames mean.</summary>
    public enum ColourSpace
    {
        /// <summary>Display-referred sRGB, as pictures are.</summary>
        Srgb = Native.COLOUR_SRGB,
        /// <summary>Linear light of the same primaries, 1 being white; for <see cref="PixelFormat.Rgba16F"/> only.</summary>
        Linear = Native.COLOUR_LINEAR,
        /// <summary>Linear light of the same primaries, 1 being 80 nits; for <see cref="PixelFormat.Rgba16F"/> only.</summary>
        ScRgb = Native.COLOUR_SCRGB,
        /// <summary>The curve of PQ with the primaries of BT.2020; for <see cref="PixelFormat.Rgb10A2"/> only.</summary>
        Hdr10 = Native.COLOUR_HDR10,
    }

    /// <summary>What a frame is.</summary>
    public enum FrameSource
    {
        /// <summary>An anchor.</summary>
        Anchor = Native.FRAME_ANCHOR,
        /// <summary>A picture that the later anchor brought with it.</summary>
        Decoded = Native.FRAME_DECODED,
        /// <summary>Generated between two anchors.</summary>
        Generated = Native.FRAME_GENERATED,
        /// <summary>Generated beyond the last anchor, as the next one is late.</summary>
        Extrapolated = Native.FRAME_EXTRAPOLATED,
        /// <summary>A picture that stands, as nothing can be generated.</summary>
        Held = Native.FRAME_HELD,
    }

    /// <summary>A frame of a presenter.</summary>
    public struct Frame
    {
        private readonly Native.frame from;

        internal Frame(Native.frame from)
        {
            this.from = from;
        }

        /// <summary>Place in the stream: anchor i, counted from 0 as they came, has place i times the multiplier.</summary>
        public long Position
        {
            get { return (long)from.position; }
        }

        /// <summary>When it is due.</summary>
        public long SinceNs
        {
            get { return (long)from.since_ns; }
        }

        /// <summary>When the next one is due, if no anchor is late.</summary>
        public long UntilNs
        {
            get { return (long)from.until_ns; }
        }

        /// <summary>Number of the anchor that it shows or starts from.</summary>
        public long Previous
        {
            get { return (long)from.previous; }
        }

        /// <summary>Number of the anchor that it leads to; the same where it leads to none.</summary>
        public long Current
        {
            get { return (long)from.current; }
        }

        /// <summary>What it is.</summary>
        public FrameSource Source
        {
            get { return (FrameSource)from.source; }
        }

        /// <summary>Intervals from the previous anchor, 0 to 1.</summary>
        public float T
        {
            get { return (float)from.t; }
        }

        /// <summary>A cut keeps it from being generated.</summary>
        public bool IsCut
        {
            get { return (from.flags & Native.FRAME_CUT) != 0; }
        }

        /// <summary>It is the very picture that was drawn before.</summary>
        public bool IsRepeated
        {
            get { return (from.flags & Native.FRAME_REPEATED) != 0; }
        }

        /// <summary>An anchor in place of a frame that is not prepared yet; only where frames are made on Direct3D 12.</summary>
        public bool IsUnprepared
        {
            get { return (from.flags & Native.FRAME_UNPREPARED) != 0; }
        }
    }

    /// <summary>How anchors are shown. As it is made: two frames to an anchor, one interval after they come.</summary>
    public sealed class PresenterOptions
    {
        /// <summary>Frames to an anchor: 1, 2, 3, 4 or 6; 0 for 2.</summary>
        public int Multiplier { get; set; }

        /// <summary>Width of the frames in pixels; 0 with a height of 0 for the anchors'.</summary>
        public int Width { get; set; }

        /// <summary>Height of the frames in pixels.</summary>
        public int Height { get; set; }

        /// <summary>Nanoseconds from one anchor to the next; 0 for what the first anchor's rate says.</summary>
        public long IntervalNs { get; set; }

        /// <summary>Nanoseconds from when an anchor comes until it is due; 0 for an interval.</summary>
        public long DelayNs { get; set; }

        /// <summary>Where an anchor is late the last one stands; its motion does not go on.</summary>
        public bool HoldLate { get; set; }

        /// <summary>After a late anchor frames are shown sooner, until anchors are due after the delay again.</summary>
        public bool CatchUp { get; set; }

        /// <summary>Frames are generated also where the anchor brings decoded pictures for them.</summary>
        public bool NoDecoded { get; set; }

        /// <summary>In frames of another shape the anchors keep theirs, with black beside or above them.</summary>
        public bool Letterbox { get; set; }

        /// <summary>Anchors that may wait for their time, 1 to 64; 0 for 4.</summary>
        public int Capacity { get; set; }

        /// <summary>Where motion comes from when an anchor comes without guidance.</summary>
        public MotionSource Motion { get; set; }

        /// <summary>What the colours of frames mean.</summary>
        public ColourSpace ColourSpace { get; set; }

        /// <summary>How bright the white of pictures is in scRGB and HDR10, 1 to 10000 nits; 0 for 203. 0 for the others.</summary>
        public int WhiteNits { get; set; }

        /// <summary>AMD FidelityFX frame generation, for frames that are recorded for Direct3D 12.</summary>
        public Preference Fsr { get; set; }

        /// <summary>The library's own shaders, for Direct3D 12.</summary>
        public Preference Shader { get; set; }

        /// <summary>The library's own generator on the processor.</summary>
        public Preference Cpu { get; set; }

        /// <summary>AMD FidelityFX upscaling, for frames for Direct3D 12 that are larger than anchors.</summary>
        public Preference Upscaler { get; set; }
    }

    /// <summary>
    /// Shows a stream of anchors at a steady rate: it is given anchors as they come, knows which frame is due when, and makes it.
    /// </summary>
    /// <remarks>
    /// It reads no clock: every time is yours, in nanoseconds from wherever you like. <see cref="TryDraw"/> is one at a time, and a second
    /// one beside it throws <see cref="Result.Busy"/>; all else may be called from any thread, also while a frame is drawn.
    /// </remarks>
    public sealed unsafe class Presenter : CairnObject
    {
        /// <summary>A presenter.</summary>
        /// <param name="options">How anchors are shown; null for the defaults.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>; <see cref="Result.Unsupported"/> for a required generator that is not there;
        /// <see cref="Result.OutOfMemory"/>.
        /// </exception>
        public Presenter(PresenterOptions options = null) : base(Create(options ?? new PresenterOptions()), handle => Library.C.presenter_destroy(handle))
        {
        }

        /// <summary>What it has done, and with what.</summary>
        public PresenterStatistics Statistics
        {
            get
            {
                var native = new Native.presenter_statistics { struct_size = (uint)sizeof(Native.presenter_statistics) };
                Done(Library.C.presenter_get_statistics(Value, &native));
                return new PresenterStatistics(native);
            }
        }

        /// <summary>
        /// Gives it the next anchor. It keeps what it needs, so that anchor and guidance may be closed. What comes without a number one
        /// above the last, or as a cut, has nothing generated before it.
        /// </summary>
        /// <param name="anchor">The anchor.</param>
        /// <param name="nowNs">When it came.</param>
        /// <param name="guidance">Of the anchor before and this one; null to have the presenter find it.</param>
        /// <returns>False where as many wait as may, and it was not taken.</returns>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/> for another size than the first anchor's, and for a first one without a rate where the
        /// options have no interval.
        /// </exception>
        public bool TryPush(Anchor anchor, long nowNs, Guidance guidance = null)
        {
            IntPtr pushed = Check.NotNull(anchor, nameof(anchor)).Value;
            IntPtr given = guidance == null ? IntPtr.Zero : guidance.Value;
            int result = Library.C.presenter_push(Value, pushed, given, Check.NotNegative(nowNs, nameof(nowNs)));
            GC.KeepAlive(anchor);
            GC.KeepAlive(guidance);
            return Done(result) == Native.OK;
        }

        /// <summary>Says which frame is due. Takes less than a microsecond.</summary>
        /// <param name="nowNs">When it will be shown.</param>
        /// <param name="frame">What it is.</param>
        /// <returns>False before the first anchor came.</returns>
        public bool TryQuery(long nowNs, out Frame frame)
        {
            Native.frame native = EmptyFrame();
            int result = Done(Library.C.presenter_query(Value, Check.NotNegative(nowNs, nameof(nowNs)), &native));
            frame = new Frame(native);
            return result == Native.OK;
        }

        /// <summary>Makes the frame that is due and writes it into memory of yours.</summary>
        /// <param name="nowNs">When it will be shown.</param>
        /// <param name="target">Of the frames' size.</param>
        /// <param name="frame">What was drawn.</param>
        /// <returns>False before the first anchor came; nothing is written then.</returns>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>, <see cref="Result.Busy"/>, <see cref="Result.OutOfMemory"/>; no pixel is written then.
        /// </exception>
        public bool TryDraw(long nowNs, PictureTarget target, out Frame frame)
        {
            fixed (byte* pixels = &MemoryMarshal.GetReference(target.Pixels))
            {
                Native.target native = target.At(pixels);
                Native.frame drawn = EmptyFrame();
                int result = Done(Library.C.presenter_draw(Value, Check.NotNegative(nowNs, nameof(nowNs)), &native, &drawn));
                frame = new Frame(drawn);
                return result == Native.OK;
            }
        }

        /// <summary>Changes the size of the frames, as a window's changes. The stream goes on.</summary>
        /// <param name="width">In pixels; 0 with a height of 0 for the anchors'.</param>
        /// <param name="height">In pixels.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>.</exception>
        public void Resize(int width, int height)
        {
            Done(Library.C.presenter_resize(Value, Check.NotNegative(width, nameof(width)), Check.NotNegative(height, nameof(height))));
        }

        /// <summary>
        /// Says what lies over the anchors from the next frame on and stands still while they move, like a HUD. Frames that a Direct3D
        /// device makes heed it.
        /// </summary>
        /// <param name="mask">A byte to a pixel of an anchor, row by row, 0 where nothing lies over it; empty, with 0 for both sizes, for nothing known.</param>
        /// <param name="width">The anchors'.</param>
        /// <param name="height">The anchors'.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public void SetOverlay(ReadOnlySpan<byte> mask, int width, int height)
        {
            fixed (byte* at = &MemoryMarshal.GetReference(mask))
            {
                uint columns = Check.NotNegative(width, nameof(width));
                Done(Library.C.presenter_set_overlay(Value, at, (UIntPtr)mask.Length, columns, Check.NotNegative(height, nameof(height))));
            }
        }

        /// <summary>Holds frames for Direct3D 12 to so many nanoseconds of the device's time each; 0 for no budget.</summary>
        /// <param name="frameNs">For each frame that is shown, on average over an interval.</param>
        public void SetBudget(long frameNs)
        {
            Done(Library.C.presenter_set_budget(Value, Check.NotNegative(frameNs, nameof(frameNs))));
        }

        /// <summary>Forgets all anchors and when they came: the next one is a first again, of any size.</summary>
        public void Reset()
        {
            Done(Library.C.presenter_reset(Value));
        }

        private static IntPtr Create(PresenterOptions options)
        {
            int flags = (options.HoldLate ? Native.PRESENTER_HOLD_LATE : 0) | (options.CatchUp ? Native.PRESENTER_CATCH_UP : 0)
                | (options.NoDecoded ? Native.PRESENTER_NO_DECODED : 0) | (options.Letterbox ? Native.PRESENTER_LETTERBOX : 0);
            var native = new Native.presenter_options
            {
                struct_size = (uint)sizeof(Native.presenter_options),
                multiplier = Check.NotNegative(options.Multiplier, nameof(options)),
                width = Check.NotNegative(options.Width, nameof(options)),
                height = Check.NotNegative(options.Height, nameof(options)),
                interval_ns = Check.NotNegative(options.IntervalNs, nameof(options)),
                delay_ns = Check.NotNegative(options.DelayNs, nameof(options)),
                flags = (uint)flags,
                capacity = Check.NotNegative(options.Capacity, nameof(options)),
                motion = (uint)options.Motion,
                colour_space = (uint)options.ColourSpace,
                fsr = (uint)options.Fsr,
                shader = (uint)options.Shader,
                cpu = (uint)options.Cpu,
                white_nits = Check.NotNegative(options.WhiteNits, nameof(options)),
                upscaler = (uint)options.Upscaler,
            };
            IntPtr presenter = IntPtr.Zero;
            return Made(Library.C.presenter_create(&native, &presenter), ref presenter);
        }

        private static Native.frame EmptyFrame()
        {
            return new Native.frame { struct_size = (uint)sizeof(Native.frame) };
        }
    }
}
