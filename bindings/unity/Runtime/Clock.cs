using System.Diagnostics;

namespace Cairn.Unity
{
    /// <summary>The clock for the arrival of anchors and the display of frames: it may be read on any thread and continues in pauses.</summary>
    public static class Clock
    {
        private static readonly Stopwatch Running = Stopwatch.StartNew();

        /// <summary>Nanoseconds since the clock's first use.</summary>
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
