// Letterbox bars: rows and columns at the border that are uniform and equal in both anchors. A group scans one row, or eight columns;
// threads stop as soon as the result is known. Every eighth row's colours are also summed.

#include "frame.hlsli"
#include "frame_colour.hlsli"

static const uint MAX_RANGE = 3;
static const int SAMPLE_STEP = 8;

groupshared uint Low[8];
groupshared uint High[8];
groupshared float4 Brightness[2][64];

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
    while (is_in_picture(at) && (low > high || high - low <= MAX_RANGE))
    {
        uint before = whole_luma(load_pixel(PREVIOUS, at));
        uint after = whole_luma(load_pixel(CURRENT, at));
        low = min(low, min(before, after));
        high = max(high, max(before, after));
        at += step;
    }
    uint entry = is_row ? 0 : thread & 7;
    InterlockedMin(Low[entry], low);
    InterlockedMax(High[entry], high);
    GroupMemoryBarrierWithGroupSync();
    if (thread < (is_row ? 1u : 8u) && High[thread] > Low[thread] && High[thread] - Low[thread] > MAX_RANGE)
    {
        uint number = is_row ? group.x : 8 * (group.x - Size.y) + thread;
        Small.InterlockedMin(is_row ? TOP : LEFT, number);
        Small.InterlockedMax(is_row ? BOTTOM : RIGHT, number + 1);
    }
    if (!is_row || group.x % SAMPLE_STEP != 0)
    {
        return;
    }
    float4 before = 0;
    float4 after = 0;
    for (int x = SAMPLE_STEP * thread; x < int(Size.x); x += SAMPLE_STEP * 64)
    {
        before += in_levels(load_pixel(PREVIOUS, int2(x, group.x)));
        after += in_levels(load_pixel(CURRENT, int2(x, group.x)));
    }
    Brightness[0][thread] = before;
    Brightness[1][thread] = after;
    GroupMemoryBarrierWithGroupSync();
    for (uint half = 32; half > 0; half /= 2)
    {
        if (thread < half)
        {
            Brightness[0][thread] += Brightness[0][thread + half];
            Brightness[1][thread] += Brightness[1][thread + half];
        }
        GroupMemoryBarrierWithGroupSync();
    }
    if (thread < 2)
    {
        Small.Store4(AtRowSums + 32 * (group.x / SAMPLE_STEP) + 16 * thread, asuint(Brightness[thread][0]));
    }
}
