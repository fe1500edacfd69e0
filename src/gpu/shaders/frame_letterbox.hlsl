// Letterbox bars: rows and columns from an edge on that are even and the same in both anchors. A group looks at one row, or at
// eight columns; a thread goes no farther than it takes to know. Of every eighth row the light is summed as well.

#include "frame.hlsli"
#include "frame_colour.hlsli"

static const uint EVEN = 3;
static const int SPARSE = 8;

groupshared uint Low[8];
groupshared uint High[8];
groupshared float4 Light[2][64];

[numthreads(64, 1, 1)]
void main(uint3 group : SV_GroupID, uint thread : SV_GroupIndex)
{
    bool is_row = group.x < Size.y;
    if (thread < 8)
    {
        Low[thread] = 255;
        High[thread] = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int column = is_row ? int(thread) : int(8 * (group.x - Size.y) + (thread & 7));
    int2 at = is_row ? int2(thread, group.x) : int2(column, thread >> 3);
    int2 step = is_row ? int2(64, 0) : int2(0, 8);
    uint low = 255;
    uint high = 0;
    while (is_on(at) && (low > high || high - low <= EVEN))
    {
        uint before = whole_luma(stored(PREVIOUS, at));
        uint after = whole_luma(stored(CURRENT, at));
        low = min(low, min(before, after));
        high = max(high, max(before, after));
        at += step;
    }
    uint entry = is_row ? 0 : thread & 7;
    InterlockedMin(Low[entry], low);
    InterlockedMax(High[entry], high);
    GroupMemoryBarrierWithGroupSync();
    if (thread < (is_row ? 1u : 8u) && High[thread] > Low[thread] && High[thread] - Low[thread] > EVEN)
    {
        uint number = is_row ? group.x : 8 * (group.x - Size.y) + thread;
        Small.InterlockedMin(is_row ? TOP : LEFT, number);
        Small.InterlockedMax(is_row ? BOTTOM : RIGHT, number + 1);
    }
    if (!is_row || group.x % SPARSE != 0)
    {
        return;
    }
    float4 before = 0;
    float4 after = 0;
    for (int x = SPARSE * thread; x < int(Size.x); x += SPARSE * 64)
    {
        before += in_levels(stored(PREVIOUS, int2(x, group.x)));
        after += in_levels(stored(CURRENT, int2(x, group.x)));
    }
    Light[0][thread] = before;
    Light[1][thread] = after;
    GroupMemoryBarrierWithGroupSync();
    for (uint half = 32; half > 0; half /= 2)
    {
        if (thread < half)
        {
            Light[0][thread] += Light[0][thread + half];
            Light[1][thread] += Light[1][thread + half];
        }
        GroupMemoryBarrierWithGroupSync();
    }
    if (thread < 2)
    {
        Small.Store4(AtRows + 32 * (group.x / SPARSE) + 16 * thread, asuint(Light[thread][0]));
    }
}
