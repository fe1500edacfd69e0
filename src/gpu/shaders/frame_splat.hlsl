// Claims go to another time: smooth tiles as a whole, others pixel by pixel. Of those that land on one place the smallest key wins;
// as a key has two words, the upper is settled in the first turn and the lower, among those that have it, in the second. The first
// also notes what covers each tile. A group to a tile.

#include "frame.hlsli"

void claim(int2 at, uint2 key)
{
    int2 end = TILE * int2(Tiles);
    if (any(at < -1) || any(at > end))
    {
        return;
    }
    uint place = 8 * uint((at.y + 1) * (end.x + 2) + at.x + 1);
    if (Turn == 0)
    {
        Scratch.InterlockedMin(place, key.x);
    }
    else if (Scratch.Load(place) == key.x)
    {
        Scratch.InterlockedMin(place + 4, key.y);
    }
}

void claim_pixel(int2 at, uint2 key)
{
    claim(at, key);
    if (Turn == 0 && all(at >= 0) && all(at < TILE * int2(Tiles)))
    {
        Small.InterlockedOr(AtCovers + 40 * (uint(at.y) / TILE * Tiles.x + uint(at.x) / TILE) + 36, 1);
    }
}

// Notes what a smooth tile covers of the tile that a corner of it lies on.
void cover(int2 first, int2 last, int2 tile, uint2 key)
{
    int2 start = max(first, TILE * tile);
    int2 end = min(last, TILE * tile + TILE - 1);
    if (any(tile < 0) || any(tile >= int2(Tiles)) || any(end < start))
    {
        return;
    }
    uint at = AtCovers + 40 * uint(tile.y * int(Tiles.x) + tile.x);
    int2 v = vector_of(key);
    uint area = uint((end.x - start.x + 1) * (end.y - start.y + 1));
    Small.InterlockedMin(at, v.x);
    Small.InterlockedMin(at + 4, v.y);
    Small.InterlockedMax(at + 8, v.x);
    Small.InterlockedMax(at + 12, v.y);
    // What is beyond 32 bits cancels out again, see where sums are used.
    Small.InterlockedAdd(at + 16, uint(v.x) * area);
    Small.InterlockedAdd(at + 20, uint(v.y) * area);
    Small.InterlockedAdd(at + 24, area);
    Small.InterlockedMin(at + 28, key.x >> 8);
    Small.InterlockedMax(at + 32, rank_of(key));
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint3 place : SV_GroupThreadID)
{
    int2 at = int2(thread.xy);
    if (is_cut() || !is_on(at))
    {
        return;
    }
    uint4 tile = tile_at(AtFieldTiles, group.xy);
    if (tile.z == SMOOTH)
    {
        int2 corner = TILE * int2(group.xy);
        int reach = WHOLE - phase_of(LandingPhase, tile.xy, corner + TILE / 2);
        int2 to = landed(corner, vector_of(tile.xy), reach);
        claim(to + int2(place.xy), tile.xy);
        if (Turn == 0 && all(place.xy == 0))
        {
            int2 last = to + int2(extent(group.xy)) - 1;
            int2 first_tile = to >> 3;
            int2 last_tile = last >> 3;
            for (int row = first_tile.y; row <= last_tile.y; row++)
            {
                for (int column = first_tile.x; column <= last_tile.x; column++)
                {
                    cover(to, last, int2(column, row), tile.xy);
                }
            }
        }
    }
    else
    {
        uint2 key = own_of_field(at);
        if (!is_empty(key))
        {
            claim_pixel(landed(at, vector_of(key), WHOLE - phase_of(LandingPhase, key, at)), key);
        }
    }
    if (Borrows != 0)
    {
        uint2 key = Owners.Load2(8 * pixel(at));
        if (mark_of(key) == ORPHAN)
        {
            claim_pixel(landed(at, vector_of(key), -phase_of(LandingPhase, key, at)), key);
        }
    }
}
