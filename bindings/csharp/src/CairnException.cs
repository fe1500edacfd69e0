using System;

namespace Cairn
{
    /// <summary>Result of a call; the numbers are those of cairn.h.</summary>
    public enum Result
    {
        /// <summary>Success.</summary>
        Ok = Native.OK,
        /// <summary>Not an error: the result is not available yet.</summary>
        NotReady = Native.NOT_READY,
        /// <summary>Not an error: the text was longer than its buffer.</summary>
        Truncated = Native.TRUNCATED,
        /// <summary>Not an error: the queue is full and the call had no effect.</summary>
        QueueFull = Native.QUEUE_FULL,
        /// <summary>An argument is outside its range, not finite, or missing.</summary>
        InvalidArgument = Native.ERROR_INVALID_ARGUMENT,
        /// <summary>The object was closed while it was used.</summary>
        InvalidHandle = Native.ERROR_INVALID_HANDLE,
        /// <summary>Library and assembly do not match: the library does not know the size of a struct.</summary>
        StructSize = Native.ERROR_STRUCT_SIZE,
        /// <summary>Another call uses the object and excludes this one. Nothing was done.</summary>
        Busy = Native.ERROR_BUSY,
        /// <summary>A valid request that this build, system, device or world does not support.</summary>
        Unsupported = Native.ERROR_UNSUPPORTED,
        /// <summary>More memory is needed than is available or allowed.</summary>
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
        /// <summary>The work was cancelled.</summary>
        Cancelled = Native.ERROR_CANCELLED,
        /// <summary>An earlier call on this object hit a bug in the library. The object can only be closed.</summary>
        Poisoned = Native.ERROR_POISONED,
        /// <summary>A bug in the library. Please report the message.</summary>
        Internal = Native.ERROR_INTERNAL,
        /// <summary>The graphics device was lost. Close the objects made on it, and make a new device.</summary>
        DeviceRemoved = Native.ERROR_DEVICE_REMOVED,
    }

    /// <summary>
    /// A call of the library failed. The message is the library's own: function, offending argument or file, cause and remedy.
    /// <c>catch (CairnException e) when (e.Result == Result.Busy)</c> tells one failure from another.
    /// </summary>
    public class CairnException : Exception
    {
        /// <summary>A failure with its message and the message's parts, which may be empty.</summary>
        public CairnException(Result result, string message, string function, string field, string cause, string remedy) : base(message)
        {
            Result = result;
            Function = function;
            Field = field;
            Cause = cause;
            Remedy = remedy;
        }

        /// <summary>The result. A newer library may return numbers that have no name here.</summary>
        public Result Result { get; }

        /// <summary>Name in cairn.h of the function that failed; empty if none was called.</summary>
        public string Function { get; }

        /// <summary>The argument, file or field that is wrong, such as "options.threads"; may be empty.</summary>
        public string Field { get; }

        /// <summary>What is wrong.</summary>
        public string Cause { get; }

        /// <summary>The remedy; may be empty.</summary>
        public string Remedy { get; }

        /// <summary>Throws the last error of this thread if the result is an error.</summary>
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
