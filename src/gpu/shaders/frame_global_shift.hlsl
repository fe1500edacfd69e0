// Global motion: the shift with the largest correlation; for equal ones no shift wins, then the first in row order. One group.

#include "frame.hlsli"
#include "frame_cut.hlsli"

static const uint THREADS = 256;

groupshared float Best[THREADS];
groupshared uint Which[THREADS];

[numthreads(256, 1, 1)]
void main(uint thread : SV_GroupIndex)
{
    uint2 reach = shift_reach();
    uint2 count = 2 * reach + 1;
    // No shift comes first.
    uint unshifted = reach.y * count.x + reach.x;
    float best = asfloat(Small.Load(AtShifts + 4 * unshifted));
    uint which = 0;
    [loop]
    for (uint i = thread; i < count.x * count.y; i += THREADS)
    {
        float correlation = asfloat(Small.Load(AtShifts + 4 * i));
        which = correlation > best ? i + 1 : which;
        best = max(best, correlation);
    }
    Best[thread] = best;
    Which[thread] = which;
    GroupMemoryBarrierWithGroupSync();
    for (uint half = THREADS / 2; half > 0; half /= 2)
    {
        if (thread < half)
        {
            float other = Best[thread + half];
            bool is_better = other > Best[thread] || other == Best[thread] && Which[thread + half] < Which[thread];
            if (is_better)
            {
                Best[thread] = other;
                Which[thread] = Which[thread + half];
            }
        }
        GroupMemoryBarrierWithGroupSync();
    }
    if (thread == 0)
    {
        uint found = Which[0] == 0 ? unshifted : Which[0] - 1;
        int2 shift = int2(found % count.x, found / count.x) - int2(reach);
        Small.Store2(GLOBAL_SHIFT, uint2(int(CUT_TINY_FACTOR) * shift));
    }
}
