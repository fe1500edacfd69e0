// Claims for the places that nothing claims: each borrows one from the left, the right, above or below, or the farthest of a
// square of tiles around. A group to a tile.

#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_reprojection.hlsli"
#include "frame_border.hlsli"

static const int NEAR = 24;

// What claims a place by itself: what was borrowed meanwhile does not count.
uint2 own_at(int2 at)
{
    uint2 key = Places.Load2(8 * pixel(at));
    return mark_of(key) == Mark || is_empty(key) ? EMPTY : key;
}

bool is_contradicted(int2 at, uint2 key)
{
    int reach = WHOLE - phase_of(LandingPhase, key, at);
    int2 there;
    if (!nearest(64 * at - part(vector_of(key), reach), there))
    {
        return false;
    }
    uint2 shown = own_of_field(there);
    return alike(shown, key) || is_nearer(key, shown);
}

uint2 farthest_around(uint2 tile)
{
    uint2 found = tile_at(AtTiles, tile).xy;
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
    return is_empty(found) ? key_of(0xffff, 0, 0) : found;
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID)
{
    int2 at = int2(thread.xy);
    if (is_cut() || tile_at(AtTiles, group.xy).w == 0 || !is_on(at) || !is_empty(Places.Load2(8 * pixel(at))))
    {
        return;
    }
    bool is_shown = Mark == ORPHAN;
    float luma = 0;
    if (is_shown)
    {
        luma = luma_of(stored(PREVIOUS, at));
    }
    uint2 best = EMPTY;
    uint3 least = 0xffffffff;
    [loop]
    for (int side = 0; side < 4; side++)
    {
        int2 step = side == 0 ? int2(-1, 0) : side == 1 ? int2(1, 0) : side == 2 ? int2(0, -1) : int2(0, 1);
        uint2 key = EMPTY;
        int away = 0;
        [loop]
        while (away < NEAR && is_empty(key) && is_on(at + (away + 1) * step))
        {
            away++;
            key = own_at(at + away * step);
        }
        if (is_empty(key))
        {
            continue;
        }
        uint contradicted = is_contradicted(at, key) ? 1 : 0;
        uint nearness = 0xffff - rank_of(key);
        uint3 cost = uint3(contradicted, nearness, uint(away));
        if (is_shown)
        {
            float apart = abs(luma - luma_of(stored(PREVIOUS, at + away * step)));
            cost = uint3(contradicted, uint(min(apart, 255)) + uint(away), nearness);
        }
        bool is_better = cost.x < least.x || cost.x == least.x && (cost.y < least.y || cost.y == least.y && cost.z < least.z);
        if (is_better)
        {
            least = cost;
            best = key;
        }
    }
    if (is_shown && has_past())
    {
        best = past_or(at, best);
    }
    if (is_empty(best))
    {
        best = farthest_around(group.xy);
    }
    best = marked(best, Mark);
    if (is_shown && !has_past())
    {
        uint2 leaves = leaving_at(at);
        best = is_empty(leaves) ? best : leaves;
    }
    Places.Store2(8 * pixel(at), best);
}
