// Detail of the reduced pictures: luma - local mean. A thread per pixel.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_cut.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 thread : SV_DispatchThreadID)
{
    if (any(thread.xy >= Reduced))
    {
        return;
    }
    int2 first = max(int2(thread.xy) - CUT_DETAIL_REACH, 0);
    int2 last = min(int2(thread.xy) + CUT_DETAIL_REACH, int2(Reduced) - 1);
    uint sum = 0;
    [loop]
    for (int y = first.y; y <= last.y; y++)
    {
        [loop]
        for (int x = first.x; x <= last.x; x++)
        {
            sum += luma_at(thread.z, uint2(x, y));
        }
    }
    int2 side = last - first + 1;
    // The added half keeps exact quotients from rounding down.
    precise float mean = (float(sum) + 0.5) / float(side.x * side.y);
    int detail = int(luma_at(thread.z, thread.xy)) - int(mean);
    Small.Store(AtDetails + 4 * (thread.z * Reduced.x * Reduced.y + thread.y * Reduced.x + thread.x), uint(detail));
}
