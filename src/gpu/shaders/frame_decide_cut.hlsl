// Whether a cut lies between the anchors: if most blocks are nowhere to be found, or fewer and the distribution of brightness has
// changed as well. The first turn only says whether it may be one. One group.

#include "frame.hlsli"
#include "frame_cut.hlsli"

static const uint THREADS = 256;
static const float ENOUGH = 0.125;
static const float CUT_ALONE = 0.85;
static const float CUT_WITH_HISTOGRAM = 0.6;
static const float DISTANCE = 0.3;

groupshared uint Bins[64];
groupshared uint Count[3];

[numthreads(256, 1, 1)]
void main(uint thread : SV_GroupIndex)
{
    if (thread < 64)
    {
        Bins[thread] = 0;
    }
    if (thread < 3)
    {
        Count[thread] = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    uint2 blocks = (Reduced + BLOCK - 1) / BLOCK;
    uint i;
    [loop]
    for (i = thread; i < blocks.x * blocks.y; i += THREADS)
    {
        InterlockedAdd(Count[min(Small.Load(AtBlocks + 4 * i), 2)], 1);
    }
    uint pixels = Reduced.x * Reduced.y;
    if (Turn == 0)
    {
        [loop]
        for (i = thread; i < 2 * pixels; i += THREADS)
        {
            InterlockedAdd(Bins[(i < pixels ? 0 : 32) + Small.Load(AtLumas + 4 * i) / 8], 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (thread != 0)
    {
        return;
    }
    float apart = asfloat(Small.Load(HISTOGRAM_DISTANCE));
    if (Turn == 0)
    {
        uint sum = 0;
        [loop]
        for (i = 0; i < 32; i++)
        {
            sum += max(Bins[i], Bins[i + 32]) - min(Bins[i], Bins[i + 32]);
        }
        apart = float(sum) / float(2 * pixels);
        Small.Store(HISTOGRAM_DISTANCE, asuint(apart));
    }
    float telling = float(Count[1] + Count[2]);
    float unexplained = telling > ENOUGH * float(blocks.x * blocks.y) ? float(Count[2]) / telling : 0;
    bool may_be = unexplained >= CUT_ALONE || unexplained >= CUT_WITH_HISTOGRAM && apart >= DISTANCE;
    if (IsStated != 0)
    {
        unexplained = 1;
    }
    Small.Store(UNEXPLAINED, asuint(unexplained));
    if (Turn == 0)
    {
        Small.Store(IS_DOUBTED, may_be ? 1 : 0);
    }
    else if (may_be)
    {
        Small.Store(IS_CUT, 1);
    }
}
