// Splats keys (forward warp): uniform tiles as a whole, others pixel by pixel. The smallest key at each destination pixel is kept; as a key
// has two words, run 0 resolves the upper one and run 1 the lower one among keys with the same upper word. Run 0 also computes the coverage
// of destination tiles. A group per tile.

#include "frame.hlsli"

void splat(int2 at, uint2 key)
{
    int2 end = TILE * int2(Tiles);
    if (any(at < -1) || any(at > end))
    {
        return;
    }
    uint in_tile = 8 * uint((at.y + 1) * (end.x + 2) + at.x + 1);
    if (Run == 0)
    {
        Scratch.InterlockedMin(in_tile, key.x);
    }
    else if (Scratch.Load(in_tile) == key.x)
    {
        Scratch.InterlockedMin(in_tile + 4, key.y);
    }
}

void splat_pixel(int2 at, uint2 key)
{
    splat(at, key);
    if (Run == 0 && all(at >= 0) && all(at < TILE * int2(Tiles)))
    {
        Small.InterlockedOr(AtCoverage + 40 * (uint(at.y) / TILE * Tiles.x + uint(at.x) / TILE) + 36, 1u);
    }
}

// Adds a uniform tile to the coverage of a destination tile that it overlaps.
void add_coverage(int2 first, int2 last, int2 tile, uint2 key)
{
    int2 start = max(first, TILE * tile);
    int2 end = min(last, TILE * tile + TILE - 1);
    if (any(tile < 0) || any(tile >= int2(Tiles)) || any(end < start))
    {
        return;
    }
    uint at = AtCoverage + 40 * uint(tile.y * int(Tiles.x) + tile.x);
    int2 v = vector_of(key);
    uint area = uint((end.x - start.x + 1) * (end.y - start.y + 1));
    uint2 ordered = ordered_uint(v);
    Small.InterlockedMin(at, ordered.x);
    Small.InterlockedMin(at + 4, ordered.y);
    Small.InterlockedMax(at + 8, ordered.x);
    Small.InterlockedMax(at + 12, ordered.y);
    // Overflow beyond 32 bits cancels out where the sums are used.
    Small.InterlockedAdd(at + 16, uint(v.x) * area);
    Small.InterlockedAdd(at + 20, uint(v.y) * area);
    Small.InterlockedAdd(at + 24, area);
    Small.InterlockedMin(at + 28, key.x >> 8);
    Small.InterlockedMax(at + 32, depth_key_of(key));
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint3 in_tile : SV_GroupThreadID)
{
    int2 at = int2(thread.xy);
    if (is_cut() || !is_in_picture(at))
    {
        return;
    }
    uint4 tile = tile_at(AtFieldTiles, group.xy);
    if (tile.z == UNIFORM)
    {
        int2 corner = TILE * int2(group.xy);
        int fraction = PHASE_ONE - phase_of(SplatPhase, tile.xy, corner + TILE / 2);
        int2 target = warped(corner, vector_of(tile.xy), fraction);
        splat(target + int2(in_tile.xy), tile.xy);
        if (Run == 0 && all(in_tile.xy == 0))
        {
            int2 last = target + int2(extent(group.xy)) - 1;
            int2 first_tile = target >> 3;
            int2 last_tile = last >> 3;
            for (int row = first_tile.y; row <= last_tile.y; row++)
            {
                for (int column = first_tile.x; column <= last_tile.x; column++)
                {
                    add_coverage(target, last, int2(column, row), tile.xy);
                }
            }
        }
    }
    else
    {
        uint2 key = field_key(at);
        if (!is_empty(key))
        {
            splat_pixel(warped(at, vector_of(key), PHASE_ONE - phase_of(SplatPhase, key, at)), key);
        }
    }
    if (SplatsInherited != 0)
    {
        uint2 key = PreviousKeys.Load2(8 * pixel_index(at));
        if (tag_of(key) == PREVIOUS_ONLY)
        {
            splat_pixel(warped(at, vector_of(key), -phase_of(SplatPhase, key, at)), key);
        }
    }
}
