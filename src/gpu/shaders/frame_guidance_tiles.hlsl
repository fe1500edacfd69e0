// Converts guidance to splat keys, sanitised, and classifies tiles as uniform or mixed. A group per tile.

#include "constants.hlsli"
#include "frame.hlsli"

groupshared int2 Low;
groupshared int2 High;
groupshared uint NearestDepthKey;
groupshared uint StaticCount;
groupshared uint HasDepth;

// Key of a pixel from motion and depth.
uint2 guidance_key(int2 at)
{
    float2 motion = Motion.Load(int3(uint2(at) / GuidanceTiles.x, 0));
    float depth = Depth.Load(int3(uint2(at) / GuidanceTiles.y, 0));
    uint2 bits = asuint(motion) & 0x7f800000;
    bool is_motion = all(bits != 0x7f800000);
    int2 limit = min(64 * int2(Size), MAX_COMPONENT);
    int2 v = is_motion ? clamp(int2(round(motion * 64)), -limit, limit) : 0;
    // NaN is farthest.
    depth = depth < 1 ? depth : 1;
    depth = depth > 0 ? depth : 0;
    return pack(depth_key_from(1 - depth), 0, v);
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    if (index == 0)
    {
        Low = 0x7fffffff;
        High = int(0x80000000);
        NearestDepthKey = 0xffff;
        StaticCount = 0;
        HasDepth = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 at = int2(thread.xy);
    bool is_inside = is_in_picture(at) && !is_cut();
    bool is_static = is_in_static_mask(at);
    uint2 key = EMPTY;
    if (is_inside)
    {
        key = guidance_key(at);
        int2 v = vector_of(key);
        InterlockedMin(Low.x, v.x);
        InterlockedMin(Low.y, v.y);
        InterlockedMax(High.x, v.x);
        InterlockedMax(High.y, v.y);
        InterlockedMin(NearestDepthKey, depth_key_of(key));
        if (is_static)
        {
            InterlockedAdd(StaticCount, 1);
        }
        if (depth_key_of(key) != depth_key_of(guidance_key(int2(0, 0))))
        {
            InterlockedOr(HasDepth, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    uint2 of_tile = EMPTY;
    uint kind = UNIFORM;
    uint2 side = extent(group.xy);
    if (StaticCount == side.x * side.y)
    {
        of_tile = pack(0, 0, 0);
    }
    else if (StaticCount == 0 && all(High - Low <= FIELD_UNIFORM_RANGE))
    {
        of_tile = pack(NearestDepthKey, 0, (Low + High) >> 1);
    }
    else
    {
        kind = MIXED;
    }
    if (is_inside)
    {
        uint2 own = is_static ? pack(0, 0, 0) : key;
        Scratch.Store2(8 * pixel_index(at), kind == MIXED ? own : of_tile);
    }
    if (index == 0)
    {
        Small.Store4(AtGuidanceTiles + 16 * (group.y * Tiles.x + group.x), uint4(of_tile, kind, 0));
        if (HasDepth != 0)
        {
            Small.InterlockedOr(HAS_DEPTH, 1u);
        }
    }
}
