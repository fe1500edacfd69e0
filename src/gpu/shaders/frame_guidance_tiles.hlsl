// The motion of the current anchor as it is given: sanitised, and sorted into smooth and rough tiles. A group to a tile.

#include "frame.hlsli"

static const int SMOOTH_GIVEN = 48;

groupshared int2 Low;
groupshared int2 High;
groupshared uint Near;
groupshared uint Bars;
groupshared uint HasDepth;

// What a guidance says of a pixel.
uint2 told(int2 at)
{
    float2 motion = Motion.Load(int3(uint2(at) / GuidanceTiles.x, 0));
    float depth = Depth.Load(int3(uint2(at) / GuidanceTiles.y, 0));
    uint2 bits = asuint(motion) & 0x7f800000;
    bool is_motion = all(bits != 0x7f800000);
    int2 limit = min(64 * int2(Size), LONGEST);
    int2 v = is_motion ? clamp(int2(round(motion * 64)), -limit, limit) : 0;
    // What is no number is farthest.
    depth = depth < 1 ? depth : 1;
    depth = depth > 0 ? depth : 0;
    return key_of(rank_of_nearness(1 - depth), 0, v);
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    if (index == 0)
    {
        Low = 0x7fffffff;
        High = int(0x80000000);
        Near = 0xffff;
        Bars = 0;
        HasDepth = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 at = int2(thread.xy);
    bool is_here = is_on(at) && !is_cut();
    bool is_bar = is_still(at);
    uint2 key = EMPTY;
    if (is_here)
    {
        key = told(at);
        int2 v = vector_of(key);
        InterlockedMin(Low.x, v.x);
        InterlockedMin(Low.y, v.y);
        InterlockedMax(High.x, v.x);
        InterlockedMax(High.y, v.y);
        InterlockedMin(Near, rank_of(key));
        if (is_bar)
        {
            InterlockedAdd(Bars, 1);
        }
        if (rank_of(key) != rank_of(told(int2(0, 0))))
        {
            InterlockedOr(HasDepth, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    uint2 of_tile = EMPTY;
    uint kind = SMOOTH;
    uint2 side = extent(group.xy);
    if (Bars == side.x * side.y)
    {
        of_tile = key_of(0, 0, 0);
    }
    else if (Bars == 0 && all(High - Low <= SMOOTH_GIVEN))
    {
        of_tile = key_of(Near, 0, (Low + High) >> 1);
    }
    else
    {
        kind = ROUGH;
    }
    if (is_here)
    {
        uint2 own = is_bar ? key_of(0, 0, 0) : key;
        Scratch.Store2(8 * pixel(at), kind == ROUGH ? own : of_tile);
    }
    if (index == 0)
    {
        Small.Store4(AtGivenTiles + 16 * (group.y * Tiles.x + group.x), uint4(of_tile, kind, 0));
        if (HasDepth != 0)
        {
            Small.InterlockedOr(HAS_DEPTH, 1);
        }
    }
}
