// Pixels for a phase after the current anchor, as if its motion went on. A group to a tile.

#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_tile_result.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    int2 at = int2(thread.xy);
    bool is_here = is_on(at);
    bool is_live = is_here && !is_cut();
    bool is_hidden = false;
    bool is_loose = false;
    float4 colour = 0;
    if (is_live)
    {
        uint4 tile = tile_at(AtTiles, group.xy);
        uint2 key = Places.Load2(8 * pixel(at));
        bool is_whole = tile.z == SMOOTH && all(extent(group.xy) == uint2(TILE, TILE));
        int reach = WHOLE - phase_of(LandingPhase, key, is_whole ? TILE * int2(group.xy) + TILE / 2 : at);
        int2 spot = 64 * at + part(vector_of(key), -reach);
        colour = sampled(CURRENT, spot);
        is_loose = mark_of(key) == HOLE;
        int2 from;
        if (is_loose && nearest(spot, from))
        {
            // What stands there now is in front of it, and would be seen twice.
            uint2 shown = own_of_field(from);
            is_hidden = !alike(shown, key) && is_nearer(shown, key);
        }
    }
    else if (is_here)
    {
        colour = stored(CURRENT, at);
    }
    if (is_here && !is_hidden)
    {
        show(at, colour);
    }
    note_tile(group.xy, index, is_here, is_hidden, in_levels(colour), is_loose);
}
