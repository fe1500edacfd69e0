using System;
using System.IO;
using System.Text;

namespace Cairn
{
    /// <summary>
    /// What a player does by world time, in the format of control scripts. It does not change, and may be used from any thread.
    /// </summary>
    public sealed unsafe class Script : CairnObject
    {
        /// <summary>Reads a control script.</summary>
        /// <param name="text">In the format of control scripts.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/> with line and column of what is wrong; <see cref="Result.Unsupported"/> for a newer
        /// version of the format.
        /// </exception>
        public Script(string text) : this(Create(text))
        {
        }

        internal Script(IntPtr value) : base(value, handle => Library.C.script_destroy(handle))
        {
        }

        /// <summary>The script of a file; also throws what reading a file throws.</summary>
        /// <param name="path">Of the file.</param>
        /// <exception cref="CairnException">As for a text.</exception>
        public static Script Read(string path)
        {
            return new Script(File.ReadAllText(path, new UTF8Encoding(false, true)));
        }

        /// <summary>How long it lasts in world time: to its end where it has one, else until the last thing happens.</summary>
        public TimeSpan Duration
        {
            get
            {
                ulong microseconds = 0;
                Done(Library.C.script_get_duration(Value, &microseconds));
                return TimeSpan.FromTicks((long)microseconds * Microseconds.Ticks);
            }
        }

        /// <summary>It in the canonical form of the format.</summary>
        public string Text
        {
            get
            {
                IntPtr script = Value;
                string text = Cairn.Text.Read((at, capacity, length) => Library.C.script_get_text(script, at, capacity, length));
                GC.KeepAlive(this);
                return text;
            }
        }

        /// <summary>The controls of a latent step; after the script's end nothing moves.</summary>
        /// <param name="latent">The number that the step will have, from 1; 0 is the seed's, which has no controls.</param>
        /// <param name="latentsPerSecond">Of the rollout, 1 to 240.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>.</exception>
        public Controls Controls(long latent, int latentsPerSecond)
        {
            var native = new Native.controls { struct_size = (uint)sizeof(Native.controls) };
            ulong number = Check.NotNegative(latent, nameof(latent));
            Done(Library.C.script_get_controls(Value, number, Check.NotNegative(latentsPerSecond, nameof(latentsPerSecond)), &native));
            return new Controls(native);
        }

        private static IntPtr Create(string text)
        {
            byte[] bytes = Cairn.Text.Encode(Check.NotNull(text, nameof(text)), nameof(text));
            fixed (byte* at = bytes)
            {
                IntPtr script = IntPtr.Zero;
                return Made(Library.C.script_create(at, (UIntPtr)(bytes.Length - 1), &script), ref script);
            }
        }
    }

    /// <summary>
    /// Collects what a player does and makes a <see cref="Script"/> of it. Times are of the world, and events come in order. One call at a
    /// time; a second one beside it throws <see cref="Result.Busy"/>.
    /// </summary>
    public sealed unsafe class Recorder : CairnObject
    {
        /// <summary>An empty recording.</summary>
        /// <exception cref="CairnException"><see cref="Result.OutOfMemory"/>.</exception>
        public Recorder() : base(Create(), handle => Library.C.recorder_destroy(handle))
        {
        }

        /// <summary>A key or mouse button went down or up; repeats are ignored.</summary>
        /// <param name="time">When.</param>
        /// <param name="key">Which one.</param>
        /// <param name="down">Down, or up.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also where the recording is full.</exception>
        public void Key(TimeSpan time, Key key, bool down)
        {
            Done(Library.C.recorder_key(Value, Microseconds.Of(time), (uint)key, down ? 1u : 0u));
        }

        /// <summary>The mouse moved by raw counts.</summary>
        /// <param name="time">When.</param>
        /// <param name="x">Right positive.</param>
        /// <param name="y">Down positive.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also where the recording is full.</exception>
        public void Mouse(TimeSpan time, float x, float y)
        {
            Done(Library.C.recorder_mouse(Value, Microseconds.Of(time), x, y));
        }

        /// <summary>The wheel turned.</summary>
        /// <param name="time">When.</param>
        /// <param name="notches">Up positive.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also where the recording is full.</exception>
        public void Scroll(TimeSpan time, int notches)
        {
            Done(Library.C.recorder_scroll(Value, Microseconds.Of(time), notches));
        }

        /// <summary>A latent step got these controls; a script of all steps gives them back bit for bit.</summary>
        /// <param name="latent">The number that the step has, from 1.</param>
        /// <param name="latentsPerSecond">Of the rollout, 1 to 240.</param>
        /// <param name="controls">Of the step.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also where the recording is full.</exception>
        public void Step(long latent, int latentsPerSecond, Controls controls)
        {
            Native.controls native = controls.Struct();
            ulong number = Check.NotNegative(latent, nameof(latent));
            Done(Library.C.recorder_step(Value, number, Check.NotNegative(latentsPerSecond, nameof(latentsPerSecond)), &native));
        }

        /// <summary>A script of what was recorded; keys that are held are released at its end. The recording goes on.</summary>
        /// <param name="end">When it ends.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/> where something happened later.</exception>
        public Script Script(TimeSpan end)
        {
            IntPtr script = IntPtr.Zero;
            int result = Done(Library.C.recorder_make_script(Value, Microseconds.Of(end), &script));
            return new Script(Made(result, ref script));
        }

        private static IntPtr Create()
        {
            IntPtr recorder = IntPtr.Zero;
            return Made(Library.C.recorder_create(&recorder), ref recorder);
        }
    }

    internal static class Microseconds
    {
        /// <summary>Ticks of a TimeSpan in one.</summary>
        internal const long Ticks = TimeSpan.TicksPerMillisecond / 1000;

        internal static ulong Of(TimeSpan time)
        {
            if (time < TimeSpan.Zero) throw new ArgumentOutOfRangeException(nameof(time), time, "It must not be before the start");
            return (ulong)(time.Ticks / Ticks);
        }
    }
}
