using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Severity of a message.</summary>
    public enum LogLevel
    {
        /// <summary>No messages.</summary>
        Off = Native.LOG_OFF,
        /// <summary>Errors.</summary>
        Error = Native.LOG_ERROR,
        /// <summary>Warnings; the work continues.</summary>
        Warning = Native.LOG_WARNING,
        /// <summary>Information for users.</summary>
        Info = Native.LOG_INFO,
        /// <summary>Information for developers.</summary>
        Debug = Native.LOG_DEBUG,
        /// <summary>All messages.</summary>
        Trace = Native.LOG_TRACE,
    }

    /// <summary>
    /// Receives one message, on any thread, possibly on several threads at once. Exceptions are discarded, because none may pass through
    /// the library.
    /// </summary>
    /// <param name="level">Severity.</param>
    /// <param name="target">The part of the library, such as "cairn::onnxruntime".</param>
    /// <param name="message">Text.</param>
    public delegate void LogSink(LogLevel level, string target, string message);

    /// <summary>The library's log. There is one for the whole process; without a sink nothing is logged.</summary>
    public static unsafe class Log
    {
        private static readonly Native.log_callback Callback = OnMessage;
        private static readonly IntPtr CallbackAddress = Marshal.GetFunctionPointerForDelegate(Callback);
        private static readonly object Changing = new object();
        private static GCHandle current;
        // Whether this thread runs a sink. The lock of To is held while the library waits for that.
        [ThreadStatic]
        private static bool isInSink;

        static Log()
        {
            // The library outlives a domain that an editor unloads, and would still call into it.
            AppDomain.CurrentDomain.DomainUnload += (sender, arguments) => End();
            AppDomain.CurrentDomain.ProcessExit += (sender, arguments) => End();
        }

        /// <summary>
        /// Sends messages of at least this severity to a sink. After the call returns, the previous sink is not running and is not called
        /// again.
        /// </summary>
        /// <param name="sink">Receiver of messages; null ends logging.</param>
        /// <param name="level">Lowest severity that is sent.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.Busy"/> from within a sink; <see cref="Result.Unsupported"/> if the library is linked into a program that has set
        /// a logger of its own; <see cref="Result.InvalidArgument"/>.
        /// </exception>
        public static void To(LogSink sink, LogLevel level = LogLevel.Warning)
        {
            if (isInSink)
            {
                const string why = "this is called from within a sink";
                throw new CairnException(Result.Busy, why, "cairn_set_log_callback", "", why, "Call it after the sink has returned");
            }
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
        internal static void OnMessage(uint level, byte* target, byte* message, void* user)
        {
            // While the sink is replaced, a message of its own may reach the next one.
            bool isNested = isInSink;
            try
            {
                isInSink = true;
                var sink = (LogSink)GCHandle.FromIntPtr((IntPtr)user).Target;
                sink((LogLevel)level, Text.Decode((IntPtr)target), Text.Decode((IntPtr)message));
            }
            catch (Exception)
            {
                // An exception cannot be reported above this.
            }
            finally
            {
                isInSink = isNested;
            }
        }
    }
}
