// Takes the places of what leaves the picture away from their owners. A group to a tile.

#include "frame.hlsli"
#include "frame_reprojection.hlsli"
#include "frame_border.hlsli"

groupshared uint Freed;

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    if (index == 0)
    {
        Freed = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 at = int2(thread.xy);
    if (is_on(at) && !is_cut() && !has_past() && !is_empty(leaving_at(at)))
    {
        uint place = 8 * pixel(at);
        if (!is_empty(Places.Load2(place)))
        {
            Places.Store2(place, EMPTY);
            InterlockedAdd(Freed, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0 && Freed != 0)
    {
        uint tile = AtTiles + 16 * (group.y * Tiles.x + group.x);
        uint2 state = Small.Load2(tile + 8);
        Small.Store2(tile + 8, uint2(ROUGH, state.y + Freed));
    }
}
