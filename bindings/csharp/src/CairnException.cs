using System;

namespace Cairn
{
    /// <summary>What a call of the library answered; the numbers are those of cairn.h.</summary>
    public enum Result
    {
        /// <summary>It worked.</summary>
        Ok = Native.OK,
        /// <summary>Not an error: what was asked for is not there yet.</summary>
        NotReady = Native.NOT_READY,
        /// <summary>Not an error: a text was longer than its room.</summary>
        Truncated = Native.TRUNCATED,
        /// <summary>Not an error: the queue is full and nothing was taken.</summary>
        QueueFull = Native.QUEUE_FULL,
        /// <summary>An argument is outside its range, not finite, or missing.</summary>
        InvalidArgument = Native.ERROR_INVALID_ARGUMENT,
        /// <summary>The object was closed while it was used.</summary>
        InvalidHandle = Native.ERROR_INVALID_HANDLE,
        /// <summary>Library and assembly do not fit: a struct has a size that the library does not know.</summary>
        StructSize = Native.ERROR_STRUCT_SIZE,
        /// <summary>The object is in use by another call that allows no second one beside it. Nothing was done.</summary>
        Busy = Native.ERROR_BUSY,
        /// <summary>A valid request that this build, system, device or world cannot serve.</summary>
        Unsupported = Native.ERROR_UNSUPPORTED,
        /// <summary>More memory is needed than there is, or than was allowed.</summary>
        OutOfMemory = Native.ERROR_OUT_OF_MEMORY,
        /// <summary>The operating system refused a file operation.</summary>
        Io = Native.ERROR_IO,
        /// <summary>The world's bundle is damaged, tampered with, or breaks the format.</summary>
        InvalidBundle = Native.ERROR_INVALID_BUNDLE,
        /// <summary>ONNX Runtime is missing or has the wrong version.</summary>
        RuntimeMissing = Native.ERROR_RUNTIME_MISSING,
        /// <summary>ONNX Runtime or the device failed while running.</summary>
        Device = Native.ERROR_DEVICE,
        /// <summary>A saved state is damaged, or belongs to another world.</summary>
        InvalidState = Native.ERROR_INVALID_STATE,
        /// <summary>The work was asked to stop.</summary>
        Cancelled = Native.ERROR_CANCELLED,
        /// <summary>An earlier call on this object failed by a fault of the library. It can only be closed.</summary>
        Poisoned = Native.ERROR_POISONED,
        /// <summary>A fault of the library. Please report the message.</summary>
        Internal = Native.ERROR_INTERNAL,
        /// <summary>The graphics device is gone. Close what was made on it, and make a new device.</summary>
        DeviceRemoved = Native.ERROR_DEVICE_REMOVED,
    }

    /// <summary>
    /// A call of the library failed. The message is the library's own: function, offending argument or file, cause and remedy.
    /// <c>catch (CairnException e) when (e.Result == Result.Busy)</c> tells one failure from another.
    /// </summary>
    public class CairnException : Exception
    {
        /// <summary>A failure with its message and the parts of it, empty where there is none.</summary>
        public CairnException(Result result, string message, string function, string field, string cause, string remedy) : base(message)
        {
            Result = result;
            Function = function;
            Field = field;
            Cause = cause;
            Remedy = remedy;
        }

        /// <summary>What the library answered. A newer library may answer with numbers that have no name here.</summary>
        public Result Result { get; }

        /// <summary>The function that failed, by its name in cairn.h; empty where none was called.</summary>
        public string Function { get; }

        /// <summary>The argument, file or field that is wrong, such as "options.threads"; may be empty.</summary>
        public string Field { get; }

        /// <summary>What is wrong.</summary>
        public string Cause { get; }

        /// <summary>What can be done; may be empty.</summary>
        public string Remedy { get; }

        /// <summary>Throws what this thread's latest call has to say, where its result is an error.</summary>
        internal static void ThrowIfFailed(int result)
        {
            if (result < 0) throw Last(result);
        }

        private static unsafe CairnException Last(int result)
        {
            Native.Functions c = Library.C;
            Func<uint, string> part = which => Text.Read((text, capacity, length) => c.last_error_part(which, text, capacity, length));
            string message = Text.Read((text, capacity, length) => c.last_error(text, capacity, length));
            return new CairnException(
                (Result)result, message, part(Native.LAST_ERROR_FUNCTION), part(Native.LAST_ERROR_FIELD), part(Native.LAST_ERROR_CAUSE),
                part(Native.LAST_ERROR_REMEDY));
        }
    }

    /// <summary>Cairn's shared library is missing, or is not one that this assembly can use.</summary>
    public sealed class LibraryException : CairnException
    {
        internal LibraryException(string file, string cause, string remedy, Result result = Result.Io)
            : base(result, $"{file}: {cause}. {remedy}", "", file, cause, remedy)
        {
        }
    }
}
