using System;
using System.Runtime.InteropServices;

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

    /// <summary>
    /// Calls a job so many times, at the same time on as many threads as it likes, the calling one among them, and returns when these
    /// calls have returned. What is left undone the library does itself. It is called on threads that call the library, also on several at
    /// once; what it throws is lost.
    /// </summary>
    /// <param name="jobs">How many calls are of use.</param>
    /// <param name="job">Takes a share of the work that no other call has. Not to be called after this has returned.</param>
    public delegate void JobRunner(int jobs, Action job);

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

        private static readonly Native.run_callback Callback = Run;
        private static readonly IntPtr CallbackAddress = Marshal.GetFunctionPointerForDelegate(Callback);
        private static readonly object Changing = new object();
        private static GCHandle current;

        static Threads()
        {
            // The library outlives a domain that an editor unloads, and would still call into it.
            AppDomain.CurrentDomain.DomainUnload += (sender, told) => End();
        }

        /// <summary>
        /// Has a job system of the program's do the work in place of the library's own threads, for the whole process. Results do not
        /// depend on it.
        /// </summary>
        /// <param name="runner">Runs jobs; null for the library's own threads.</param>
        /// <param name="concurrency">The most jobs that run at the same time, 1 to 1024. Without a runner it is of no use.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.Busy"/> while there is an object; <see cref="Result.InvalidArgument"/>.
        /// </exception>
        public static void UseJobs(JobRunner runner, int concurrency)
        {
            if (concurrency < 0) throw new ArgumentOutOfRangeException(nameof(concurrency));
            GCHandle next = runner == null ? default(GCHandle) : GCHandle.Alloc(runner);
            lock (Changing)
            {
                var scheduler = new Native.scheduler
                {
                    struct_size = (uint)sizeof(Native.scheduler),
                    concurrency = (uint)concurrency,
                    run = CallbackAddress,
                    user = runner == null ? null : (void*)GCHandle.ToIntPtr(next),
                };
                int result = Library.C.set_scheduler(runner == null ? null : &scheduler);
                GCHandle gone = result < 0 ? next : current;
                if (result >= 0) current = next;
                if (gone.IsAllocated) gone.Free();
                CairnException.ThrowIfFailed(result);
            }
        }

        private static void End()
        {
            if (current.IsAllocated) Library.C.set_scheduler(null);
        }

        [MonoPInvokeCallback(typeof(Native.run_callback))]
        internal static void Run(void* user, uint jobs, IntPtr job, void* data)
        {
            try
            {
                var runner = (JobRunner)GCHandle.FromIntPtr((IntPtr)user).Target;
                var call = (Native.job)Marshal.GetDelegateForFunctionPointer(job, typeof(Native.job));
                runner((int)jobs, () => call(data));
            }
            catch (Exception)
            {
                // The library runs the remaining jobs itself.
            }
        }
    }
}
