// Decides whether there is a cut between the anchors: if most blocks have no match, or fewer and the luma histograms differ as well. Run 0
// only decides whether one is suspected. One group.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_cut.hlsli"

static const uint THREADS = 256;

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
    uint2 blocks = (Reduced + CUT_BLOCK - 1) / CUT_BLOCK;
    uint i;
    [loop]
    for (i = thread; i < blocks.x * blocks.y; i += THREADS)
    {
        InterlockedAdd(Count[min(Small.Load(AtBlocks + 4 * i), 2)], 1);
    }
    uint pixels = Reduced.x * Reduced.y;
    if (Run == 0)
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
    float histogram_distance = asfloat(Small.Load(HISTOGRAM_DISTANCE));
    if (Run == 0)
    {
        uint sum = 0;
        [loop]
        for (i = 0; i < 32; i++)
        {
            sum += max(Bins[i], Bins[i + 32]) - min(Bins[i], Bins[i + 32]);
        }
        histogram_distance = float(sum) / float(2 * pixels);
        Small.Store(HISTOGRAM_DISTANCE, asuint(histogram_distance));
    }
    float with_detail = float(Count[1] + Count[2]);
    float unexplained = with_detail > CUT_MIN_SHARE * float(blocks.x * blocks.y) ? float(Count[2]) / with_detail : 0;
    bool is_suspected = unexplained >= CUT_ALONE || unexplained >= CUT_WITH_HISTOGRAM && histogram_distance >= CUT_HISTOGRAM_DISTANCE;
    if (IsCutStated != 0)
    {
        unexplained = 1;
    }
    Small.Store(UNEXPLAINED, asuint(unexplained));
    if (Run == 0)
    {
        Small.Store(IS_CUT_SUSPECTED, is_suspected ? 1 : 0);
    }
    else if (is_suspected)
    {
        Small.Store(IS_CUT, 1);
    }
}
