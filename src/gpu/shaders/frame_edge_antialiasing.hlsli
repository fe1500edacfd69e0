// Anti-aliasing of edges that no depth confirms: in tiles that contain an edge, and at uncovered pixels, a pixel is blended with its
// neighbours in the tile.

#include "constants.hlsli"

groupshared float4 Sharp[64];
groupshared uint HiddenBits[2];
groupshared int MinVector[2];
groupshared int MaxVector[2];

// A neighbour's colour if it is in the tile and not hidden; else the thread's own.
float4 neighbour(uint index, bool is_in_active_area, uint other)
{
    uint source = is_in_active_area ? other : index;
    source = (HiddenBits[source >> 5] >> (source & 31) & 1) != 0 ? index : source;
    return Sharp[source];
}

// The blended colour of each of the tile's 64 threads, which all call this. Only complete mixed tiles are blended.
float4 antialiased(uint index, uint2 key, bool is_mixed, bool is_hidden, bool is_static_pixel, float4 colour)
{
    if (index < 2)
    {
        HiddenBits[index] = 0;
        MinVector[index] = int(0x7fffffff);
        MaxVector[index] = int(0x80000000);
    }
    Sharp[index] = colour;
    GroupMemoryBarrierWithGroupSync();
    uint tag = tag_of(key);
    int2 v = vector_of(key);
    InterlockedOr(HiddenBits[index >> 5], (is_hidden ? 1u : 0u) << (index & 31));
    InterlockedMin(MinVector[0], v.x);
    InterlockedMin(MinVector[1], v.y);
    InterlockedMax(MaxVector[0], v.x);
    InterlockedMax(MaxVector[1], v.y);
    GroupMemoryBarrierWithGroupSync();
    bool is_edge = MaxVector[0] - MinVector[0] > EDGE_ANTIALIASING_EDGE_MOTION || MaxVector[1] - MinVector[1] > EDGE_ANTIALIASING_EDGE_MOTION;
    bool is_blended = is_mixed && (is_edge || tag == PREVIOUS_ONLY || tag == HOLE) && !is_hidden && !is_static_pixel;
    float4 left = neighbour(index, (index & 7) > 0, index - 1);
    float4 right = neighbour(index, (index & 7) < 7, index + 1);
    float4 above = neighbour(index, index >= 8, index - 8);
    float4 below = neighbour(index, index < 56, index + 8);
    float4 blended = colour;
    [branch]
    if (IsFloat == 0)
    {
        int4 sum = int4(left) + int4(right) + int4(above) + int4(below);
        blended = float4((int4(colour) * (128 - 4 * EDGE_ANTIALIASING_NEIGHBOUR_WEIGHT) + sum * EDGE_ANTIALIASING_NEIGHBOUR_WEIGHT + 64) >> 7);
    }
    else
    {
        float4 own = finite4(colour);
        precise float4 difference = (((finite4(left) - own) + (finite4(right) - own)) + (finite4(above) - own)) + (finite4(below) - own);
        precise float4 step_to_neighbours = difference * (EDGE_ANTIALIASING_NEIGHBOUR_WEIGHT / 128.0);
        precise float4 blended_float = own + step_to_neighbours;
        blended = rounded_to_half(blended_float);
    }
    return is_blended ? blended : colour;
}
