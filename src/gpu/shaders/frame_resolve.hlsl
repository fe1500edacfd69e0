// What a picture holds on which claims have landed: a tile that smooth ones cover for the most part, and alike, is smooth; in
// others the nearest has got each place, and cracks are closed. A group to a tile.

#include "frame.hlsli"
#include "frame_reprojection.hlsli"

static const int SMOOTH_LANDED = 48;
static const int SLOPE = 256;
static const uint ONE_SURFACE = 2048;

groupshared uint Holes;
groupshared uint Freed;
groupshared uint Claimed;
groupshared uint2 Farthest;

uint2 landed_at(int2 at)
{
    return Scratch.Load2(8 * uint((at.y + 1) * (TILE * int(Tiles.x) + 2) + at.x + 1));
}

// What stands at a place between two others.
uint2 closed(uint2 own, uint2 a, uint2 b)
{
    if (is_empty(a) || is_empty(b) || !alike(a, b))
    {
        return own;
    }
    uint2 nearer = nearer_of(a, b);
    bool is_behind = is_empty(own) || is_nearer(farther_of(a, b), own) && !alike(nearer, own);
    return is_behind ? nearer : own;
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    if (index == 0)
    {
        Holes = 0;
        Freed = 0;
        Claimed = 0;
        Farthest = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 at = int2(thread.xy);
    bool is_here = is_on(at) && !is_cut();
    uint number = group.y * Tiles.x + group.x;
    uint4 ends = Small.Load4(AtCovers + 40 * number);
    uint4 sums = Small.Load4(AtCovers + 40 * number + 16);
    uint2 last = Small.Load2(AtCovers + 40 * number + 32);
    int2 low = int2(ends.xy);
    int2 high = int2(ends.zw);
    uint area = sums.z;
    uint2 side = extent(group.xy);
    bool is_smooth = last.y == 0 && 4 * area >= 3 * side.x * side.y;
    uint2 key = EMPTY;
    if (is_smooth)
    {
        int apart = last.x - min(last.x, sums.w >> 8) <= ONE_SURFACE ? SLOPE : SMOOTH_LANDED;
        is_smooth = all(high - low <= apart);
        // Of what is above the least, as the rest of a sum may not fit 32 bits.
        uint2 above = sums.xy - uint2(low) * area;
        int2 mean = low + int2((2 * above + area) / (2 * area));
        key = key_of(sums.w >> 8, sums.w & 0xff, mean);
    }
    uint2 own = key;
    if (!is_smooth && is_here)
    {
        own = landed_at(at);
        own = closed(own, landed_at(at - int2(1, 0)), landed_at(at + int2(1, 0)));
        own = closed(own, landed_at(at - int2(0, 1)), landed_at(at + int2(0, 1)));
        if (!is_empty(own))
        {
            InterlockedMax(Farthest.x, own.x);
            InterlockedOr(Claimed, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (!is_smooth && is_here && !is_empty(own) && own.x == Farthest.x)
    {
        InterlockedMax(Farthest.y, own.y);
    }
    if (is_here)
    {
        // In the previous anchor something may stand in front that the current one does not know.
        if (Mark == ORPHAN && has_past() && !is_empty(own))
        {
            int2 of_key = is_smooth ? TILE * int2(group.xy) + TILE / 2 : at;
            if (is_covered_in_past(at, own, of_key))
            {
                own = EMPTY;
                InterlockedOr(Freed, 1);
            }
        }
        if (is_empty(own))
        {
            InterlockedAdd(Holes, 1);
        }
        Places.Store2(8 * pixel(at), own);
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0)
    {
        if (!is_smooth)
        {
            key = EMPTY;
            if (Claimed != 0)
            {
                key = Farthest;
            }
        }
        Small.Store4(AtTiles + 16 * number, uint4(key, is_smooth && Freed == 0 ? SMOOTH : ROUGH, Holes));
    }
}
