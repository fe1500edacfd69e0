using System;
using System.Runtime.InteropServices;
using System.Threading;

namespace Cairn
{
    /// <summary>How the system schedules the library's own threads.</summary>
    public enum WorkerPriority
    {
        /// <summary>Below normal, so that a game's threads run first.</summary>
        BelowNormal = Native.PRIORITY_BELOW_NORMAL,
        /// <summary>Normal; on Linux that of the thread whose call starts them.</summary>
        Normal = Native.PRIORITY_NORMAL,
        /// <summary>Lowest.</summary>
        Lowest = Native.PRIORITY_LOWEST,
    }

    /// <summary>
    /// Calls a job up to a number of times, on any number of threads at the same time, including the calling one, and returns when these calls
    /// have returned. The library does the rest itself. It is called on threads that call the library, also on several at once. Its exceptions
    /// are discarded.
    /// </summary>
    /// <param name="jobs">The largest useful number of calls.</param>
    /// <param name="job">Each call does a different share of the work. Do not call it after the runner has returned.</param>
    public delegate void JobRunner(int jobs, Action job);

    /// <summary>The threads that share the library's work on pictures with the calling thread.</summary>
    public static unsafe class Threads
    {
        /// <summary>
        /// Sets the number and the priority of the library's own threads, for the whole process. They start with the first work that is shared
        /// and end with the last object. Their number changes no result.
        /// </summary>
        /// <param name="count">
        /// Number of threads, 1 to 1024, in addition to the calling ones; 0 for one less than the physical cores that this process may use, but at
        /// least one.
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
            AppDomain.CurrentDomain.DomainUnload += (sender, arguments) => End();
        }

        /// <summary>
        /// Makes the library share its work on the program's job system instead of its own threads, for the whole process. This changes no
        /// result. If the application domain is unloaded, as when an editor reloads scripts, the library gets its own threads back; objects of
        /// the domain that are still open then are destroyed.
        /// </summary>
        /// <param name="runner">Runs jobs; null for the library's own threads.</param>
        /// <param name="concurrency">The largest number of jobs that run at the same time, 1 to 1024. Ignored without a runner.</param>
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

        /// <summary>
        /// Takes the runner from the library before its domain is unloaded. The library keeps a runner while there is an object, so objects that
        /// are still open, or are garbage, are destroyed first.
        /// </summary>
        private static void End()
        {
            lock (Changing)
            {
                if (!current.IsAllocated) return;
                for (int attempt = 0; attempt < 100; attempt++)
                {
                    if (Library.C.set_scheduler(null) != (int)Result.Busy) return;
                    // If there are none, another thread may be destroying the last one.
                    if (!LiveHandles.DestroyAll()) Thread.Sleep(10);
                }
                Console.Error.WriteLine(
                    "Cairn: the library keeps a job runner of unloaded code and will crash when it calls it, because objects that were made "
                    + "without this assembly are still open. Destroy them before scripts are reloaded.");
            }
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
