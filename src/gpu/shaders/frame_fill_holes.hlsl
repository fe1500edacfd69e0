// Hole filling: each hole inherits the best of the nearest keys to the left, right, above and below, or else the farthest key of a square
// of tiles around. A group per tile.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_reprojection.hlsli"

// A pixel's own key: keys that were inherited meanwhile do not count.
uint2 own_key(int2 at)
{
    uint2 key = SplatKeys.Load2(8 * pixel_index(at));
    return tag_of(key) == InheritedTag || is_empty(key) ? EMPTY : key;
}

bool is_contradicted(int2 at, uint2 key)
{
    int fraction = PHASE_ONE - phase_of(SplatPhase, key, at);
    int2 there;
    if (!nearest_pixel(64 * at - scaled(vector_of(key), fraction), there))
    {
        return false;
    }
    uint2 key_there = field_key(there);
    return similar_motion(key_there, key) || is_in_front(key, key_there);
}

uint2 farthest_around(uint2 tile)
{
    uint2 found = tile_at(AtSplatTiles, tile).xy;
    uint2 size = Tiles;
    uint level = AtLevels;
    [loop]
    for (uint side = 1; side < max(Tiles.x, Tiles.y) && is_empty(found); side *= 2)
    {
        size = (size + 1) / 2;
        tile /= 2;
        found = Small.Load2(level + 8 * (tile.y * size.x + tile.x));
        level += 8 * size.x * size.y;
    }
    return is_empty(found) ? pack(0xffff, 0, 0) : found;
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID)
{
    int2 at = int2(thread.xy);
    if (is_cut() || tile_at(AtSplatTiles, group.xy).w == 0 || !is_in_picture(at) || !is_empty(SplatKeys.Load2(8 * pixel_index(at))))
    {
        return;
    }
    bool is_visible_in_previous = InheritedTag == PREVIOUS_ONLY;
    float luma = 0;
    if (is_visible_in_previous)
    {
        luma = luma_of(load_pixel(PREVIOUS, at));
    }
    uint2 best = EMPTY;
    uint3 least = 0xffffffff;
    [loop]
    for (int side = 0; side < 4; side++)
    {
        int2 step = side == 0 ? int2(-1, 0) : side == 1 ? int2(1, 0) : side == 2 ? int2(0, -1) : int2(0, 1);
        uint2 key = EMPTY;
        int distance = 0;
        [loop]
        while (distance < HOLE_FILLING_SEARCH_RADIUS && is_empty(key) && is_in_picture(at + (distance + 1) * step))
        {
            distance++;
            key = own_key(at + distance * step);
        }
        if (is_empty(key))
        {
            continue;
        }
        uint contradicted = is_contradicted(at, key) ? 1 : 0;
        uint far_first_key = 0xffff - depth_key_of(key);
        uint3 cost = uint3(contradicted, far_first_key, uint(distance));
        if (is_visible_in_previous)
        {
            float luma_difference = abs(luma - luma_of(load_pixel(PREVIOUS, at + distance * step)));
            cost = uint3(contradicted, uint(min(luma_difference, 255)) + uint(distance), far_first_key);
        }
        bool is_better = cost.x < least.x || cost.x == least.x && (cost.y < least.y || cost.y == least.y && cost.z < least.z);
        if (is_better)
        {
            least = cost;
            best = key;
        }
    }
    if (is_visible_in_previous && has_reprojection())
    {
        best = reprojected_or(at, best);
    }
    if (is_empty(best))
    {
        best = farthest_around(group.xy);
    }
    best = with_tag(best, InheritedTag);
    SplatKeys.Store2(8 * pixel_index(at), best);
}
