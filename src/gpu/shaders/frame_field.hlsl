// Refines keys at the edges of surfaces: foreground is dilated over its anti-aliased edge; without depth, keys are tagged with their match
// errors. A group per tile.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_colour.hlsli"

groupshared uint HasOtherMotion;
groupshared uint IsChanged;

uint2 guidance_key(int2 at)
{
    return Scratch.Load2(8 * pixel_index(at));
}

// Levels by which a pixel's luma exceeds the range of the 2x2 pixels around the position to which its key leads.
uint match_error(int2 at, uint2 key)
{
    int2 first = (64 * at + vector_of(key)) >> 6;
    float luma = luma_of(load_pixel(CURRENT, at));
    float4 there = float4(luma_of(load_pixel(PREVIOUS, first)), luma_of(load_pixel(PREVIOUS, first + int2(1, 0))),
        luma_of(load_pixel(PREVIOUS, first + int2(0, 1))), luma_of(load_pixel(PREVIOUS, first + int2(1, 1))));
    float low = min(min(there.x, there.y), min(there.z, there.w));
    float high = max(max(there.x, there.y), max(there.z, there.w));
    return uint(min(max(max(low - luma, luma - high), 0), MAX_MATCH_ERROR));
}

// Difference between a pixel and the bilinear sample at the position to which a key leads, in levels.
float colour_distance(int2 at, uint2 key)
{
    int2 position = 64 * at + vector_of(key);
    float2 t = float2(position & 63) / 64;
    int2 first = position >> 6;
    float4 a = in_levels(load_pixel(PREVIOUS, first));
    float4 b = in_levels(load_pixel(PREVIOUS, first + int2(1, 0)));
    float4 c = in_levels(load_pixel(PREVIOUS, first + int2(0, 1)));
    float4 d = in_levels(load_pixel(PREVIOUS, first + int2(1, 1)));
    precise float4 above = a + (b - a) * t.x;
    precise float4 below = c + (d - c) * t.x;
    precise float4 difference = abs(above + (below - above) * t.y - in_levels(load_pixel(CURRENT, at)));
    return max(max(difference.x, difference.y), difference.z);
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    bool is_flat = Small.Load(HAS_DEPTH) == 0;
    bool can_dilate = !is_flat && GuidanceTiles.x == 1;
    uint4 tile = tile_at(AtGuidanceTiles, group.xy);
    int2 at = int2(thread.xy);
    bool is_inside = is_in_picture(at) && !is_cut();
    if (index == 0)
    {
        HasOtherMotion = 0;
        IsChanged = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    if (index < 9 && tile.z == UNIFORM)
    {
        int2 other = int2(group.xy) + int2(index % 3, index / 3) - 1;
        if (all(other >= 0) && all(other < int2(Tiles)))
        {
            uint4 neighbour = tile_at(AtGuidanceTiles, uint2(other));
            if (neighbour.z == MIXED || !similar_motion(neighbour.xy, tile.xy))
            {
                InterlockedOr(HasOtherMotion, 1);
            }
        }
    }
    GroupMemoryBarrierWithGroupSync();
    bool is_kept = tile.z == UNIFORM && !((can_dilate || is_flat && IsPair != 0) && HasOtherMotion != 0);
    if (is_kept)
    {
        tile.xy = is_flat ? with_tag(tile.xy, FIELD_UNKNOWN_MATCH_ERROR) : tile.xy;
        if (is_inside)
        {
            FieldKeys.Store2(8 * pixel_index(at), tile.xy);
        }
    }
    else if (is_inside)
    {
        uint2 own = guidance_key(at);
        uint2 key = own;
        if (is_flat && IsPair != 0)
        {
            key = with_tag(own, match_error(at, own));
            InterlockedOr(IsChanged, 1);
        }
        else if (can_dilate)
        {
            uint2 foreground = EMPTY;
            [loop]
            for (int v = max(at.y - 1, 0); v <= min(at.y + 1, int(Size.y) - 1); v++)
            {
                [loop]
                for (int u = max(at.x - 1, 0); u <= min(at.x + 1, int(Size.x) - 1); u++)
                {
                    foreground = nearer_of(foreground, guidance_key(int2(u, v)));
                }
            }
            if (is_in_front(foreground, own) && !similar_motion(foreground, own))
            {
                bool fits = IsPair == 0;
                if (!fits)
                {
                    float foreground_distance = colour_distance(at, foreground);
                    fits = foreground_distance <= FIELD_DILATION_TOLERANCE && foreground_distance < colour_distance(at, own);
                }
                if (fits)
                {
                    key = foreground;
                    InterlockedOr(IsChanged, 1);
                }
            }
        }
        FieldKeys.Store2(8 * pixel_index(at), key);
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0)
    {
        bool is_mixed = !is_kept && (tile.z == MIXED || IsChanged != 0);
        uint4 kept = uint4(tile.xy, UNIFORM, 0);
        uint4 mixed = uint4(EMPTY, MIXED, 0);
        if (is_mixed)
        {
            kept = mixed;
        }
        Small.Store4(AtFieldTiles + 16 * (group.y * Tiles.x + group.x), kept);
    }
}
