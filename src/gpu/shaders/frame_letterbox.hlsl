// Letterbox bars: rows and columns at the border that are uniform and equal in both anchors. A group scans one row, or eight columns;
// threads stop as soon as the result is known.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_colour.hlsli"

groupshared uint Low[8];
groupshared uint High[8];

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
    while (is_in_picture(at) && (low > high || high - low <= LETTERBOX_MAX_RANGE))
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
    if (thread < (is_row ? 1u : 8u) && High[thread] > Low[thread] && High[thread] - Low[thread] > LETTERBOX_MAX_RANGE)
    {
        uint number = is_row ? group.x : 8 * (group.x - Size.y) + thread;
        Small.InterlockedMin(is_row ? TOP : LEFT, number);
        Small.InterlockedMax(is_row ? BOTTOM : RIGHT, number + 1);
    }
}
