// Removes the keys of pixels that border foreground covers. A group per tile.

#include "frame.hlsli"
#include "frame_reprojection.hlsli"
#include "frame_border.hlsli"

groupshared uint Cleared;

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    if (index == 0)
    {
        Cleared = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 at = int2(thread.xy);
    if (is_in_picture(at) && !is_cut() && !has_reprojection() && !is_empty(border_key(at)))
    {
        uint address = 8 * pixel_index(at);
        if (!is_empty(SplatKeys.Load2(address)))
        {
            SplatKeys.Store2(address, EMPTY);
            InterlockedAdd(Cleared, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0 && Cleared != 0)
    {
        uint tile = AtSplatTiles + 16 * (group.y * Tiles.x + group.x);
        uint2 state = Small.Load2(tile + 8);
        Small.Store2(tile + 8, uint2(MIXED, state.y + Cleared));
    }
}
