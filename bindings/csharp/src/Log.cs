using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>How important a message is.</summary>
    public enum LogLevel
    {
        /// <summary>No message at all.</summary>
        Off = Native.LOG_OFF,
        /// <summary>Something failed.</summary>
        Error = Native.LOG_ERROR,
        /// <summary>Something is odd, and the work goes on.</summary>
        Warning = Native.LOG_WARNING,
        /// <summary>What a user may want to know.</summary>
        Info = Native.LOG_INFO,
        /// <summary>What a developer may want to know.</summary>
        Debug = Native.LOG_DEBUG,
        /// <summary>Everything.</summary>
        Trace = Native.LOG_TRACE,
    }

    /// <summary>
    /// Gets one message, on whatever thread has something to say, also on several at once. What it throws is lost: nothing may be thrown
    /// through the library.
    /// </summary>
    /// <param name="level">How important it is.</param>
    /// <param name="target">The part of the library, such as "cairn::onnxruntime".</param>
    /// <param name="message">What it says.</param>
    public delegate void LogSink(LogLevel level, string target, string message);

    /// <summary>The library's log. There is one for the whole process; without a sink nothing is logged.</summary>
    public static unsafe class Log
    {
        private static readonly Native.log_callback Callback = Take;
        private static readonly IntPtr CallbackAddress = Marshal.GetFunctionPointerForDelegate(Callback);
        private static readonly object Changing = new object();
        private static GCHandle current;

        static Log()
        {
            // The library outlives what an editor unloads, and would go on calling into it.
            AppDomain.CurrentDomain.DomainUnload += (sender, told) => End();
            AppDomain.CurrentDomain.ProcessExit += (sender, told) => End();
        }

        /// <summary>
        /// Sends messages of at least that importance to a sink. When this returns, the sink before it is not running and will not be
        /// called again.
        /// </summary>
        /// <param name="sink">Gets them; null ends logging.</param>
        /// <param name="level">The least important ones that it gets.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.Busy"/> from within a sink; <see cref="Result.Unsupported"/> where the library is part of a program whose own
        /// logger has the log; <see cref="Result.InvalidArgument"/>.
        /// </exception>
        public static void To(LogSink sink, LogLevel level = LogLevel.Warning)
        {
            GCHandle next = sink == null ? default(GCHandle) : GCHandle.Alloc(sink);
            lock (Changing)
            {
                int result = sink == null
                    ? Library.C.set_log_callback(Native.LOG_OFF, IntPtr.Zero, null)
                    : Library.C.set_log_callback((uint)level, CallbackAddress, (void*)GCHandle.ToIntPtr(next));
                GCHandle gone = result < 0 ? next : current;
                if (result >= 0) current = next;
                if (gone.IsAllocated) gone.Free();
                CairnException.ThrowIfFailed(result);
            }
        }

        private static void End()
        {
            if (current.IsAllocated) Library.C.set_log_callback(Native.LOG_OFF, IntPtr.Zero, null);
        }

        [MonoPInvokeCallback(typeof(Native.log_callback))]
        internal static void Take(uint level, byte* target, byte* message, void* user)
        {
            try
            {
                var sink = (LogSink)GCHandle.FromIntPtr((IntPtr)user).Target;
                sink((LogLevel)level, Text.Decode((IntPtr)target), Text.Decode((IntPtr)message));
            }
            catch (Exception)
            {
                // Nobody above this can be told.
            }
        }
    }
}
