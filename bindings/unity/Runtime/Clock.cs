using System.Diagnostics;

namespace Cairn.Unity
{
    /// <summary>The clock that anchors come by and frames are shown by: it runs on all threads and does not stand still in pauses.</summary>
    public static class Clock
    {
        private static readonly Stopwatch Running = Stopwatch.StartNew();

        /// <summary>Nanoseconds since the first use.</summary>
        public static long NowNs
        {
            get
            {
                long ticks = Running.ElapsedTicks;
                long whole = ticks / Stopwatch.Frequency;
                return whole * 1000000000 + (ticks - whole * Stopwatch.Frequency) * 1000000000 / Stopwatch.Frequency;
            }
        }
    }
}
