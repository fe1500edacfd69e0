using System;
using System.Collections.Generic;
using System.Linq;
using System.Runtime.InteropServices;
using System.Threading;

namespace Cairn
{
    /// <summary>
    /// An object of the library. <see cref="Dispose"/>, the end of a using block, or the garbage collector destroys it.
    /// </summary>
    /// <remarks>
    /// Objects keep what they need alive, so they may be closed in any order. Using a closed object throws
    /// <see cref="ObjectDisposedException"/>; a call during which another thread closes the object throws <see cref="CairnException"/>
    /// with <see cref="Result.InvalidHandle"/> or <see cref="Result.Cancelled"/>. Neither accesses freed memory: a handle is a number
    /// that the library looks up.
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

        /// <summary>Destroys the object after waiting for calls on it that are in flight; a second call does nothing.</summary>
        /// <exception cref="CairnException">
        /// <see cref="Result.Busy"/> from within a callback of a call on the object, which then stays open.
        /// </exception>
        public void Dispose()
        {
            handle.Destroy();
        }

        /// <summary>The handle to pass to the library.</summary>
        internal IntPtr Value
        {
            get
            {
                if (handle.IsDone) throw new ObjectDisposedException(GetType().Name);
                return handle.DangerousGetHandle();
            }
        }

        /// <summary>
        /// Throws if a call on this object failed, otherwise returns its result. Keeps the object alive until then: otherwise it could be
        /// collected and destroyed during the call.
        /// </summary>
        internal int CheckResult(int result)
        {
            GC.KeepAlive(this);
            CairnException.ThrowIfFailed(result);
            return result;
        }

        /// <summary>Throws if a function that makes an object failed, otherwise returns its handle, which the function has written.</summary>
        internal static IntPtr CheckCreated(int result, ref IntPtr value)
        {
            CairnException.ThrowIfFailed(result);
            return value;
        }

        /// <summary>
        /// A handle that is destroyed once. Calls in flight do not add references to it: when an object is destroyed, the library itself
        /// ends or awaits its calls, which references would delay until the calls end by themselves.
        /// </summary>
        private sealed class Handle : SafeHandle
        {
            private readonly Func<IntPtr, int> destroy;
            private int done;

            internal Handle(IntPtr value, Func<IntPtr, int> destroy) : base(IntPtr.Zero, true)
            {
                this.destroy = destroy;
                SetHandle(value);
                LiveHandles.Add(value, destroy);
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
                LiveHandles.Remove(handle);
                SetHandleAsInvalid();
            }

            protected override bool ReleaseHandle()
            {
                if (Interlocked.Exchange(ref done, 1) != 0) return true;
                int result = destroy(handle);
                LiveHandles.Remove(handle);
                // A failure cannot be reported here.
                return result >= 0;
            }
        }
    }

    /// <summary>
    /// Handles of this domain's objects that are not destroyed yet, also of objects that are garbage already. They keep no object alive.
    /// </summary>
    internal static class LiveHandles
    {
        /// <summary>By handle, the function that destroys it. Handles of all kinds of objects differ.</summary>
        private static readonly Dictionary<IntPtr, Func<IntPtr, int>> All = new Dictionary<IntPtr, Func<IntPtr, int>>();

        internal static void Add(IntPtr value, Func<IntPtr, int> destroy)
        {
            lock (All) All[value] = destroy;
        }

        internal static void Remove(IntPtr value)
        {
            lock (All) All.Remove(value);
        }

        /// <summary>
        /// Destroys the objects, for a domain that is being unloaded. Their finalizers may run later: the library ignores a handle that it has
        /// destroyed. Returns whether there were any.
        /// </summary>
        internal static bool DestroyAll()
        {
            KeyValuePair<IntPtr, Func<IntPtr, int>>[] left;
            lock (All)
            {
                left = All.ToArray();
                All.Clear();
            }
            // Outside the lock, because destruction waits for calls on other threads.
            foreach (KeyValuePair<IntPtr, Func<IntPtr, int>> each in left) each.Value(each.Key);
            return left.Length > 0;
        }
    }

    /// <summary>Checks arguments that the library's unsigned numbers and handles cannot express.</summary>
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

    /// <summary>Marks functions that the library calls, for ahead-of-time compilers: they look for an attribute of this name.</summary>
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
