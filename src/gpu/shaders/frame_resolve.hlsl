// Resolves splatted keys: a tile is uniform if uniform tiles cover most of it with similar motion; in others each pixel has the nearest
// key, with cracks closed. A group per tile.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_reprojection.hlsli"

groupshared uint Holes;
groupshared uint IsOccluded;
groupshared uint HasKeys;
groupshared uint2 Farthest;

uint2 splatted_at(int2 at)
{
    return Scratch.Load2(8 * uint((at.y + 1) * (TILE * int(Tiles.x) + 2) + at.x + 1));
}

// A pixel with a crack closed between two opposite neighbours.
uint2 close_crack(uint2 own, uint2 a, uint2 b)
{
    if (is_empty(a) || is_empty(b) || !similar_motion(a, b))
    {
        return own;
    }
    uint2 nearer = nearer_of(a, b);
    bool is_behind = is_empty(own) || is_in_front(farther_of(a, b), own) && !similar_motion(nearer, own);
    return is_behind ? nearer : own;
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    if (index == 0)
    {
        Holes = 0;
        IsOccluded = 0;
        HasKeys = 0;
        Farthest = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 at = int2(thread.xy);
    bool is_inside = is_in_picture(at) && !is_cut();
    uint number = group.y * Tiles.x + group.x;
    int4 extremes = from_ordered_uint(Small.Load4(AtCoverage + 40 * number));
    uint4 sums = Small.Load4(AtCoverage + 40 * number + 16);
    uint2 rest = Small.Load2(AtCoverage + 40 * number + 32);
    int2 low = extremes.xy;
    int2 high = extremes.zw;
    uint area = sums.z;
    uint2 side = extent(group.xy);
    bool is_uniform = rest.y == 0 && 4 * area >= 3 * side.x * side.y;
    uint2 key = EMPTY;
    if (is_uniform)
    {
        int max_range = rest.x - min(rest.x, sums.w >> 8) <= SLOPE_DEPTH_KEYS ? SLOPE_MOTION : SPLAT_UNIFORM_RANGE;
        is_uniform = all(high - low <= max_range);
        // Relative to the minimum, as the whole sum may not fit 32 bits.
        uint2 above = sums.xy - uint2(low) * area;
        int2 mean = low + int2((2 * above + area) / (2 * area));
        key = pack(sums.w >> 8, sums.w & 0xff, mean);
    }
    uint2 own = key;
    if (!is_uniform && is_inside)
    {
        own = splatted_at(at);
        own = close_crack(own, splatted_at(at - int2(1, 0)), splatted_at(at + int2(1, 0)));
        own = close_crack(own, splatted_at(at - int2(0, 1)), splatted_at(at + int2(0, 1)));
        if (!is_empty(own))
        {
            InterlockedMax(Farthest.x, own.x);
            InterlockedOr(HasKeys, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (!is_uniform && is_inside && !is_empty(own) && own.x == Farthest.x)
    {
        InterlockedMax(Farthest.y, own.y);
    }
    if (is_inside)
    {
        // In the previous anchor a surface that the current one does not show may occlude the pixel.
        if (InheritedTag == PREVIOUS_ONLY && has_reprojection() && !is_empty(own))
        {
            int2 of_key = is_uniform ? TILE * int2(group.xy) + TILE / 2 : at;
            if (is_occluded_in_previous(at, own, of_key))
            {
                own = EMPTY;
                InterlockedOr(IsOccluded, 1);
            }
        }
        if (is_empty(own))
        {
            InterlockedAdd(Holes, 1);
        }
        SplatKeys.Store2(8 * pixel_index(at), own);
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0)
    {
        if (!is_uniform)
        {
            key = EMPTY;
            if (HasKeys != 0)
            {
                key = Farthest;
            }
        }
        Small.Store4(AtSplatTiles + 16 * number, uint4(key, is_uniform && IsOccluded == 0 ? UNIFORM : MIXED, Holes));
    }
}
