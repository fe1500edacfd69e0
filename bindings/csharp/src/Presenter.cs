using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Use of a generator.</summary>
    public enum Preference
    {
        /// <summary>Use it if possible.</summary>
        Auto = Native.PREFER_AUTO,
        /// <summary>Use it; creating the presenter fails if it is not available.</summary>
        Require = Native.PREFER_REQUIRE,
        /// <summary>Do not use it.</summary>
        Never = Native.PREFER_NEVER,
    }

    /// <summary>Colour space of frames.</summary>
    public enum ColourSpace
    {
        /// <summary>Display-referred sRGB, like pictures.</summary>
        Srgb = Native.COLOUR_SRGB,
        /// <summary>Linear light with sRGB primaries, 1 is white; for <see cref="PixelFormat.Rgba16F"/> only.</summary>
        Linear = Native.COLOUR_LINEAR,
        /// <summary>Linear light with sRGB primaries, 1 is 80 nits; for <see cref="PixelFormat.Rgba16F"/> only.</summary>
        ScRgb = Native.COLOUR_SCRGB,
        /// <summary>PQ transfer function with BT.2020 primaries; for <see cref="PixelFormat.Rgb10A2"/> only.</summary>
        Hdr10 = Native.COLOUR_HDR10,
    }

    /// <summary>Kind of a frame.</summary>
    public enum FrameSource
    {
        /// <summary>An anchor.</summary>
        Anchor = Native.FRAME_ANCHOR,
        /// <summary>A further picture that the decoder made together with the later anchor.</summary>
        Decoded = Native.FRAME_DECODED,
        /// <summary>Generated between two anchors.</summary>
        Generated = Native.FRAME_GENERATED,
        /// <summary>Extrapolated beyond the last anchor, because the next one is late.</summary>
        Extrapolated = Native.FRAME_EXTRAPOLATED,
        /// <summary>A repeated picture, because nothing can be generated.</summary>
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

        /// <summary>Position in the stream: the anchor pushed as number i, from 0, has position i times the multiplier.</summary>
        public long Position
        {
            get { return (long)from.position; }
        }

        /// <summary>Time at which it is due.</summary>
        public long SinceNs
        {
            get { return (long)from.since_ns; }
        }

        /// <summary>Time at which the next one is due, unless an anchor is late.</summary>
        public long UntilNs
        {
            get { return (long)from.until_ns; }
        }

        /// <summary>Number of the anchor that it shows or starts from.</summary>
        public long Previous
        {
            get { return (long)from.previous; }
        }

        /// <summary>Number of the anchor at the interval's end; equal to the other one if there is no interval.</summary>
        public long Current
        {
            get { return (long)from.current; }
        }

        /// <summary>Kind of the frame.</summary>
        public FrameSource Source
        {
            get { return (FrameSource)from.source; }
        }

        /// <summary>Phase: intervals since the previous anchor, 0 to 1.</summary>
        public float T
        {
            get { return (float)from.t; }
        }

        /// <summary>Whether it was not generated because of a cut.</summary>
        public bool IsCut
        {
            get { return (from.flags & Native.FRAME_CUT) != 0; }
        }

        /// <summary>Whether it is the same picture as the one drawn before.</summary>
        public bool IsRepeated
        {
            get { return (from.flags & Native.FRAME_REPEATED) != 0; }
        }

        /// <summary>Whether it is an anchor shown instead of a frame that is not prepared yet; only for frames made on Direct3D 12.</summary>
        public bool IsUnprepared
        {
            get { return (from.flags & Native.FRAME_UNPREPARED) != 0; }
        }
    }

    /// <summary>How anchors are shown. Defaults: two frames per anchor, delayed by one interval.</summary>
    public sealed class PresenterOptions
    {
        /// <summary>Frames per anchor: 1, 2, 3, 4 or 6; 0 for 2.</summary>
        public int Multiplier { get; set; }

        /// <summary>Width of the frames in pixels; 0 with a height of 0 for the anchors'.</summary>
        public int Width { get; set; }

        /// <summary>Height of the frames in pixels.</summary>
        public int Height { get; set; }

        /// <summary>Nanoseconds between anchors; 0 to use the first anchor's rate.</summary>
        public long IntervalNs { get; set; }

        /// <summary>Nanoseconds from the arrival of an anchor until it is due; 0 for one interval.</summary>
        public long DelayNs { get; set; }

        /// <summary>If an anchor is late, hold the last one instead of extrapolating.</summary>
        public bool HoldLate { get; set; }

        /// <summary>After a late anchor, show frames sooner until anchors are due after the normal delay again.</summary>
        public bool CatchUp { get; set; }

        /// <summary>Generate frames even if the anchor has decoded pictures for them.</summary>
        public bool NoDecoded { get; set; }

        /// <summary>If frames have another aspect ratio than the anchors, add black bars instead of stretching.</summary>
        public bool Letterbox { get; set; }

        /// <summary>Maximum number of waiting anchors, 1 to 64; 0 for 4.</summary>
        public int Capacity { get; set; }

        /// <summary>Source of motion for anchors without guidance.</summary>
        public MotionSource Motion { get; set; }

        /// <summary>Colour space of frames.</summary>
        public ColourSpace ColourSpace { get; set; }

        /// <summary>Luminance of the pictures' white in scRGB and HDR10, 1 to 10000 nits; 0 for 203. Must be 0 for other colour spaces.</summary>
        public int WhiteNits { get; set; }

        /// <summary>AMD FidelityFX frame generation, for frames recorded for Direct3D 12.</summary>
        public Preference Fsr { get; set; }

        /// <summary>The library's own shaders, for Direct3D 12.</summary>
        public Preference Shader { get; set; }

        /// <summary>The library's own generator on the processor.</summary>
        public Preference Cpu { get; set; }

        /// <summary>AMD FidelityFX upscaling, for frames for Direct3D 12 that are larger than anchors.</summary>
        public Preference Upscaler { get; set; }
    }

    /// <summary>
    /// Shows a stream of anchors at a steady rate: receives anchors as they come, decides which frame is due when, and makes it.
    /// </summary>
    /// <remarks>
    /// It reads no clock: all times are yours, in nanoseconds from any origin. <see cref="TryDraw"/> excludes itself: a concurrent second
    /// call throws <see cref="Result.Busy"/>. Everything else may be called from any thread, also while a frame is drawn.
    /// </remarks>
    public sealed unsafe class Presenter : CairnObject
    {
        /// <summary>A presenter.</summary>
        /// <param name="options">Settings; null for the defaults.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>; <see cref="Result.Unsupported"/> for a required generator that is not available;
        /// <see cref="Result.OutOfMemory"/>.
        /// </exception>
        public Presenter(PresenterOptions options = null) : base(Create(options ?? new PresenterOptions()), handle => Library.C.presenter_destroy(handle))
        {
        }

        /// <summary>Statistics.</summary>
        public PresenterStatistics Statistics
        {
            get
            {
                var native = new Native.presenter_statistics { struct_size = (uint)sizeof(Native.presenter_statistics) };
                CheckResult(Library.C.presenter_get_statistics(Value, &native));
                return new PresenterStatistics(native);
            }
        }

        /// <summary>
        /// Pushes the next anchor. The presenter keeps its own references, so anchor and guidance may be closed. For an anchor whose number is
        /// not one above the last, or that is a cut, nothing is generated before it.
        /// </summary>
        /// <param name="anchor">The anchor.</param>
        /// <param name="nowNs">Time of its arrival.</param>
        /// <param name="guidance">Guidance from the previous anchor to this one; null to let the presenter extract it.</param>
        /// <returns>False if the maximum number of anchors is waiting; the anchor was not added.</returns>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/> for another size than the first anchor's, and for a first anchor without a rate if the options
        /// have no interval.
        /// </exception>
        public bool TryPush(Anchor anchor, long nowNs, Guidance guidance = null)
        {
            IntPtr pushed = Check.NotNull(anchor, nameof(anchor)).Value;
            IntPtr given = guidance == null ? IntPtr.Zero : guidance.Value;
            int result = Library.C.presenter_push(Value, pushed, given, Check.NotNegative(nowNs, nameof(nowNs)));
            GC.KeepAlive(anchor);
            GC.KeepAlive(guidance);
            return CheckResult(result) == Native.OK;
        }

        /// <summary>Returns the frame that is due. Takes less than a microsecond.</summary>
        /// <param name="nowNs">Time at which it will be shown.</param>
        /// <param name="frame">The frame's properties.</param>
        /// <returns>False before the first anchor.</returns>
        public bool TryQuery(long nowNs, out Frame frame)
        {
            Native.frame native = EmptyFrame();
            int result = CheckResult(Library.C.presenter_query(Value, Check.NotNegative(nowNs, nameof(nowNs)), &native));
            frame = new Frame(native);
            return result == Native.OK;
        }

        /// <summary>Draws the frame that is due into your memory.</summary>
        /// <param name="nowNs">Time at which it will be shown.</param>
        /// <param name="target">Must have the frames' size.</param>
        /// <param name="frame">Properties of the drawn frame.</param>
        /// <returns>False before the first anchor; nothing is written then.</returns>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>, <see cref="Result.Busy"/>, <see cref="Result.OutOfMemory"/>; no pixel is written then.
        /// </exception>
        public bool TryDraw(long nowNs, PictureTarget target, out Frame frame)
        {
            fixed (byte* pixels = &MemoryMarshal.GetReference(target.Pixels))
            {
                Native.target native = target.At(pixels);
                Native.frame drawn = EmptyFrame();
                int result = CheckResult(Library.C.presenter_draw(Value, Check.NotNegative(nowNs, nameof(nowNs)), &native, &drawn));
                frame = new Frame(drawn);
                return result == Native.OK;
            }
        }

        /// <summary>Changes the size of the frames, for example with a window. The stream continues.</summary>
        /// <param name="width">In pixels; 0 with a height of 0 for the anchors'.</param>
        /// <param name="height">In pixels.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>.</exception>
        public void Resize(int width, int height)
        {
            CheckResult(Library.C.presenter_resize(Value, Check.NotNegative(width, nameof(width)), Check.NotNegative(height, nameof(height))));
        }

        /// <summary>
        /// Sets the mask of a static overlay that covers the anchors, such as a HUD, from the next frame on. All generators use it.
        /// </summary>
        /// <param name="mask">A byte per pixel of an anchor, row by row, 0 where nothing covers it; empty, with both sizes 0, if unknown.</param>
        /// <param name="width">The anchors' width.</param>
        /// <param name="height">The anchors' height.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public void SetOverlay(ReadOnlySpan<byte> mask, int width, int height)
        {
            fixed (byte* at = &MemoryMarshal.GetReference(mask))
            {
                uint columns = Check.NotNegative(width, nameof(width));
                CheckResult(Library.C.presenter_set_overlay(Value, at, (UIntPtr)mask.Length, columns, Check.NotNegative(height, nameof(height))));
            }
        }

        /// <summary>Sets a budget of device time for frames on Direct3D 12; 0 for none.</summary>
        /// <param name="frameNs">Nanoseconds per presented frame, averaged over an interval.</param>
        public void SetBudget(long frameNs)
        {
            CheckResult(Library.C.presenter_set_budget(Value, Check.NotNegative(frameNs, nameof(frameNs))));
        }

        /// <summary>Removes all anchors and their times: the next anchor is a first one again and may have any size.</summary>
        public void Reset()
        {
            CheckResult(Library.C.presenter_reset(Value));
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
            return CheckCreated(Library.C.presenter_create(&native, &presenter), ref presenter);
        }

        private static Native.frame EmptyFrame()
        {
            return new Native.frame { struct_size = (uint)sizeof(Native.frame) };
        }
    }
}
