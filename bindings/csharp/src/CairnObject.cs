using System;
using System.Runtime.InteropServices;
using System.Threading;

namespace Cairn
{
    /// <summary>
    /// An object of the library. <see cref="Dispose"/>, the end of a using block, or the garbage collector gives it back.
    /// </summary>
    /// <remarks>
    /// Objects keep what they need alive, so they may be closed in any order. What is closed throws
    /// <see cref="ObjectDisposedException"/> when it is used; a call that another thread closes it under throws
    /// <see cref="CairnException"/> with <see cref="Result.InvalidHandle"/> or <see cref="Result.Cancelled"/>. Neither touches memory
    /// that is gone: a handle is a number that the library looks up.
    /// </remarks>
    public abstract class CairnObject : IDisposable
    {
        private readonly Handle handle;

        internal CairnObject(IntPtr value, Func<IntPtr, int> destroy)
        {
            handle = new Handle(value, destroy);
        }

        /// <summary>Whether it was closed.</summary>
        public bool IsClosed
        {
            get { return handle.IsDone; }
        }

        /// <summary>Gives the object back, and waits for calls on it that are in flight; a second time does nothing.</summary>
        /// <exception cref="CairnException">
        /// <see cref="Result.Busy"/> from within a callback of a call on the object, which then stays open.
        /// </exception>
        public void Dispose()
        {
            handle.Destroy();
        }

        /// <summary>The number to hand to the library.</summary>
        internal IntPtr Value
        {
            get
            {
                if (handle.IsDone) throw new ObjectDisposedException(GetType().Name);
                return handle.DangerousGetHandle();
            }
        }

        /// <summary>
        /// Throws where a call on this object failed; else gives its result. The object lives until then: collected within the call, it
        /// would be destroyed under it.
        /// </summary>
        internal int Done(int result)
        {
            GC.KeepAlive(this);
            CairnException.ThrowIfFailed(result);
            return result;
        }

        /// <summary>Throws where a function failed that makes an object; else gives its handle, which the function has written by now.</summary>
        internal static IntPtr Made(int result, ref IntPtr value)
        {
            CairnException.ThrowIfFailed(result);
            return value;
        }

        /// <summary>
        /// A handle that is given back once. Calls do not count in it: the library itself ends them or waits for them when an object is
        /// destroyed, which a count would put off until they have ended by themselves.
        /// </summary>
        private sealed class Handle : SafeHandle
        {
            private readonly Func<IntPtr, int> destroy;
            private int done;

            internal Handle(IntPtr value, Func<IntPtr, int> destroy) : base(IntPtr.Zero, true)
            {
                this.destroy = destroy;
                SetHandle(value);
            }

            public override bool IsInvalid
            {
                get { return handle == IntPtr.Zero; }
            }

            internal bool IsDone
            {
                get { return Volatile.Read(ref done) != 0; }
            }

            internal void Destroy()
            {
                if (Interlocked.Exchange(ref done, 1) != 0) return;
                int result = destroy(handle);
                if (result < 0)
                {
                    Volatile.Write(ref done, 0);
                    CairnException.ThrowIfFailed(result);
                }
                SetHandleAsInvalid();
            }

            protected override bool ReleaseHandle()
            {
                // Nobody is there to be told of a failure.
                return Interlocked.Exchange(ref done, 1) != 0 || destroy(handle) >= 0;
            }
        }
    }

    /// <summary>Arguments that have no words in the library's own numbers.</summary>
    internal static class Check
    {
        internal static uint NotNegative(int number, string parameter)
        {
            if (number < 0) throw new ArgumentOutOfRangeException(parameter, number, "It must not be negative");
            return (uint)number;
        }

        internal static ulong NotNegative(long number, string parameter)
        {
            if (number < 0) throw new ArgumentOutOfRangeException(parameter, number, "It must not be negative");
            return (ulong)number;
        }

        internal static T NotNull<T>(T given, string parameter) where T : class
        {
            if (given == null) throw new ArgumentNullException(parameter);
            return given;
        }
    }

    /// <summary>Marks what the library calls, for compilers that translate ahead of time: they look for an attribute of this name.</summary>
    [AttributeUsage(AttributeTargets.Method)]
    internal sealed class MonoPInvokeCallbackAttribute : Attribute
    {
        internal MonoPInvokeCallbackAttribute(Type type)
        {
            Type = type;
        }

        internal Type Type { get; }
    }
}
