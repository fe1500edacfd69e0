// What happens where surfaces meet: the rim of a surface belongs to what is in front; without depth, to what matches better. A
// group to a tile.

#include "frame.hlsli"
#include "frame_colour.hlsli"

static const float RIM = 38;
static const float WORST_MATCH = 250;
static const uint UNKNOWN_MATCH = 24;

groupshared uint IsApart;
groupshared uint IsChanged;

uint2 given(int2 at)
{
    return Scratch.Load2(8 * pixel(at));
}

// The levels by which the luma of a pixel lies outside those of the four around the place that a claim leads to.
uint match_of(int2 at, uint2 claim)
{
    int2 first = (64 * at + vector_of(claim)) >> 6;
    float luma = luma_of(stored(CURRENT, at));
    float4 there = float4(luma_of(stored(PREVIOUS, first)), luma_of(stored(PREVIOUS, first + int2(1, 0))),
        luma_of(stored(PREVIOUS, first + int2(0, 1))), luma_of(stored(PREVIOUS, first + int2(1, 1))));
    float low = min(min(there.x, there.y), min(there.z, there.w));
    float high = max(max(there.x, there.y), max(there.z, there.w));
    return uint(min(max(max(low - luma, luma - high), 0), WORST_MATCH));
}

// How far a pixel is from what is read bilinearly where a claim leads to.
float distance_of(int2 at, uint2 claim)
{
    int2 spot = 64 * at + vector_of(claim);
    float2 t = float2(spot & 63) / 64;
    int2 first = spot >> 6;
    float4 a = in_levels(stored(PREVIOUS, first));
    float4 b = in_levels(stored(PREVIOUS, first + int2(1, 0)));
    float4 c = in_levels(stored(PREVIOUS, first + int2(0, 1)));
    float4 d = in_levels(stored(PREVIOUS, first + int2(1, 1)));
    precise float4 above = a + (b - a) * t.x;
    precise float4 below = c + (d - c) * t.x;
    precise float4 apart = abs(above + (below - above) * t.y - in_levels(stored(CURRENT, at)));
    return max(max(apart.x, apart.y), apart.z);
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    bool is_flat = Small.Load(HAS_DEPTH) == 0;
    bool dilates = !is_flat && GuidanceTiles.x == 1;
    uint4 tile = tile_at(AtGivenTiles, group.xy);
    int2 at = int2(thread.xy);
    bool is_here = is_on(at) && !is_cut();
    if (index == 0)
    {
        IsApart = 0;
        IsChanged = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    if (index < 9 && tile.z == SMOOTH)
    {
        int2 other = int2(group.xy) + int2(index % 3, index / 3) - 1;
        if (all(other >= 0) && all(other < int2(Tiles)))
        {
            uint4 beside = tile_at(AtGivenTiles, uint2(other));
            if (beside.z == ROUGH || !alike(beside.xy, tile.xy))
            {
                InterlockedOr(IsApart, 1);
            }
        }
    }
    GroupMemoryBarrierWithGroupSync();
    bool is_kept = tile.z == SMOOTH && !((dilates || is_flat && IsPair != 0) && IsApart != 0);
    if (is_kept)
    {
        tile.xy = is_flat ? marked(tile.xy, UNKNOWN_MATCH) : tile.xy;
        if (is_here)
        {
            Field.Store2(8 * pixel(at), tile.xy);
        }
    }
    else if (is_here)
    {
        uint2 own = given(at);
        uint2 key = own;
        if (is_flat && IsPair != 0)
        {
            key = marked(own, match_of(at, own));
            InterlockedOr(IsChanged, 1);
        }
        else if (dilates)
        {
            uint2 front = EMPTY;
            [loop]
            for (int v = max(at.y - 1, 0); v <= min(at.y + 1, int(Size.y) - 1); v++)
            {
                [loop]
                for (int u = max(at.x - 1, 0); u <= min(at.x + 1, int(Size.x) - 1); u++)
                {
                    front = nearer_of(front, given(int2(u, v)));
                }
            }
            if (is_nearer(front, own) && !alike(front, own))
            {
                bool fits = IsPair == 0;
                if (!fits)
                {
                    float of_front = distance_of(at, front);
                    fits = of_front <= RIM && of_front < distance_of(at, own);
                }
                if (fits)
                {
                    key = front;
                    InterlockedOr(IsChanged, 1);
                }
            }
        }
        Field.Store2(8 * pixel(at), key);
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0)
    {
        bool is_rough = !is_kept && (tile.z == ROUGH || IsChanged != 0);
        uint4 kept = uint4(tile.xy, SMOOTH, 0);
        uint4 rough = uint4(EMPTY, ROUGH, 0);
        if (is_rough)
        {
            kept = rough;
        }
        Small.Store4(AtFieldTiles + 16 * (group.y * Tiles.x + group.x), kept);
    }
}
