// Extrapolates the current anchor along its motion. A group per tile.

#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_tile_result.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    int2 at = int2(thread.xy);
    bool is_inside = is_in_picture(at);
    bool is_generated = is_inside && !is_cut();
    bool is_hidden = false;
    bool is_uncovered = false;
    float4 colour = 0;
    if (is_generated)
    {
        uint4 tile = tile_at(AtSplatTiles, group.xy);
        uint2 key = SplatKeys.Load2(8 * pixel_index(at));
        bool is_whole = tile.z == UNIFORM && all(extent(group.xy) == uint2(TILE, TILE));
        int fraction = PHASE_ONE - phase_of(SplatPhase, key, is_whole ? TILE * int2(group.xy) + TILE / 2 : at);
        int2 position = 64 * at + scaled(vector_of(key), -fraction);
        colour = sampled(CURRENT, position);
        is_uncovered = tag_of(key) == HOLE;
        int2 from;
        if (is_uncovered && nearest_pixel(position, from))
        {
            // The foreground at that position would be drawn twice.
            uint2 key_there = field_key(from);
            is_hidden = !similar_motion(key_there, key) && is_in_front(key_there, key);
        }
    }
    else if (is_inside)
    {
        colour = load_pixel(CURRENT, at);
    }
    if (is_inside && !is_hidden)
    {
        store_pixel(at, colour);
    }
    store_tile_result(group.xy, index, is_inside, is_hidden, in_levels(colour), is_uncovered);
}
