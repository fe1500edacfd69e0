using System;
using System.IO;
using System.Text;

namespace Cairn
{
    /// <summary>
    /// Player input over world time, in the format of control scripts. Immutable; may be used from any thread.
    /// </summary>
    public sealed unsafe class Script : CairnObject
    {
        /// <summary>Reads a control script.</summary>
        /// <param name="text">A control script.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/> with line and column of the error; <see cref="Result.Unsupported"/> for a newer version of the
        /// format.
        /// </exception>
        public Script(string text) : this(Create(text))
        {
        }

        internal Script(IntPtr value) : base(value, handle => Library.C.script_destroy(handle))
        {
        }

        /// <summary>Reads the script in a file; also throws exceptions of reading a file.</summary>
        /// <param name="path">Path of the file.</param>
        /// <exception cref="CairnException">As for a text.</exception>
        public static Script Read(string path)
        {
            return new Script(File.ReadAllText(path, new UTF8Encoding(false, true)));
        }

        /// <summary>Duration in world time: up to its explicit end, or if it has none, up to the end of its last event or motion.</summary>
        public TimeSpan Duration
        {
            get
            {
                ulong microseconds = 0;
                CheckResult(Library.C.script_get_duration(Value, &microseconds));
                return TimeSpan.FromTicks((long)microseconds * Microseconds.Ticks);
            }
        }

        /// <summary>The script in the format's canonical form.</summary>
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

        /// <summary>The controls of a latent step; after the script's end they are empty.</summary>
        /// <param name="latent">Number of the step's latent, from 1; 0 is the seed's, which has no controls.</param>
        /// <param name="latentsPerSecond">The rollout's, 1 to 240.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>.</exception>
        public Controls Controls(long latent, int latentsPerSecond)
        {
            var native = new Native.controls { struct_size = (uint)sizeof(Native.controls) };
            ulong number = Check.NotNegative(latent, nameof(latent));
            CheckResult(Library.C.script_get_controls(Value, number, Check.NotNegative(latentsPerSecond, nameof(latentsPerSecond)), &native));
            return new Controls(native);
        }

        private static IntPtr Create(string text)
        {
            byte[] bytes = Cairn.Text.Encode(Check.NotNull(text, nameof(text)), nameof(text));
            fixed (byte* at = bytes)
            {
                IntPtr script = IntPtr.Zero;
                return CheckCreated(Library.C.script_create(at, (UIntPtr)(bytes.Length - 1), &script), ref script);
            }
        }
    }

    /// <summary>
    /// Records player input and makes a <see cref="Script"/> from it. Times are world time, and events must come in order of time. Calls exclude
    /// each other; a concurrent one throws <see cref="Result.Busy"/>.
    /// </summary>
    public sealed unsafe class Recorder : CairnObject
    {
        /// <summary>An empty recording.</summary>
        /// <exception cref="CairnException"><see cref="Result.OutOfMemory"/>.</exception>
        public Recorder() : base(Create(), handle => Library.C.recorder_destroy(handle))
        {
        }

        /// <summary>Records that a key or mouse button went down or up; repeats are ignored.</summary>
        /// <param name="time">World time of the event.</param>
        /// <param name="key">The key.</param>
        /// <param name="down">Whether it went down.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also if the recording is full.</exception>
        public void Key(TimeSpan time, Key key, bool down)
        {
            CheckResult(Library.C.recorder_key(Value, Microseconds.Of(time), (uint)key, down ? 1u : 0u));
        }

        /// <summary>Records a motion of the mouse in raw counts.</summary>
        /// <param name="time">World time of the event.</param>
        /// <param name="x">Right positive.</param>
        /// <param name="y">Down positive.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also if the recording is full.</exception>
        public void Mouse(TimeSpan time, float x, float y)
        {
            CheckResult(Library.C.recorder_mouse(Value, Microseconds.Of(time), x, y));
        }

        /// <summary>Records a turn of the wheel.</summary>
        /// <param name="time">World time of the event.</param>
        /// <param name="notches">Up positive.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also if the recording is full.</exception>
        public void Scroll(TimeSpan time, int notches)
        {
            CheckResult(Library.C.recorder_scroll(Value, Microseconds.Of(time), notches));
        }

        /// <summary>Records the controls of a latent step; a script of all steps reproduces them bit for bit.</summary>
        /// <param name="latent">Number of the step's latent, from 1.</param>
        /// <param name="latentsPerSecond">The rollout's, 1 to 240.</param>
        /// <param name="controls">Controls of the step.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, also if the recording is full.</exception>
        public void Step(long latent, int latentsPerSecond, Controls controls)
        {
            Native.controls native = controls.Struct();
            ulong number = Check.NotNegative(latent, nameof(latent));
            CheckResult(Library.C.recorder_step(Value, number, Check.NotNegative(latentsPerSecond, nameof(latentsPerSecond)), &native));
        }

        /// <summary>Makes a script of the recording so far; keys that are held are released at its end. Recording can continue.</summary>
        /// <param name="end">World time of the script's end.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/> if an event is later.</exception>
        public Script Script(TimeSpan end)
        {
            IntPtr script = IntPtr.Zero;
            int result = CheckResult(Library.C.recorder_make_script(Value, Microseconds.Of(end), &script));
            return new Script(CheckCreated(result, ref script));
        }

        private static IntPtr Create()
        {
            IntPtr recorder = IntPtr.Zero;
            return CheckCreated(Library.C.recorder_create(&recorder), ref recorder);
        }
    }

    internal static class Microseconds
    {
        /// <summary>Ticks of a TimeSpan per microsecond.</summary>
        internal const long Ticks = TimeSpan.TicksPerMillisecond / 1000;

        internal static ulong Of(TimeSpan time)
        {
            if (time < TimeSpan.Zero) throw new ArgumentOutOfRangeException(nameof(time), time, "It must not be before the start");
            return (ulong)(time.Ticks / Ticks);
        }
    }
}
