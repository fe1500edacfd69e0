using System;

namespace Cairn
{
    /// <summary>How the system schedules the library's own threads.</summary>
    public enum WorkerPriority
    {
        /// <summary>Below those of a game.</summary>
        BelowNormal = Native.PRIORITY_BELOW_NORMAL,
        /// <summary>As a thread of the program.</summary>
        Normal = Native.PRIORITY_NORMAL,
        /// <summary>Behind all others.</summary>
        Lowest = Native.PRIORITY_LOWEST,
    }

    /// <summary>The threads on which the library shares its work on pictures with the thread that calls it.</summary>
    public static unsafe class Threads
    {
        /// <summary>
        /// Sets how many threads of its own the library has, and their priority, for the whole process. They start with the first work to be
        /// shared and end with the last object. Results do not depend on how many there are.
        /// </summary>
        /// <param name="count">
        /// 1 to 1024, beside those that call; 0 for one less than the physical cores this process may use, at least one.
        /// </param>
        /// <param name="priority">Their priority.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.Busy"/> while there is an object; <see cref="Result.InvalidArgument"/>.
        /// </exception>
        public static void Set(int count, WorkerPriority priority = WorkerPriority.BelowNormal)
        {
            if (count < 0) throw new ArgumentOutOfRangeException(nameof(count));
            var options = new Native.thread_options
            {
                struct_size = (uint)sizeof(Native.thread_options),
                threads = (uint)count,
                priority = (uint)priority,
            };
            CairnException.ThrowIfFailed(Library.C.set_threads(&options));
        }
    }
}
