// A colour for each tile, which what is hidden there takes: what is known of a tile outweighs what the tiles around lend it, by
// twos, fours and so on. A group to a square of 16 x 16 tiles.

#include "frame.hlsli"

static const float LENT = 1.0 / 16.0;

groupshared float4 Colours[341];
groupshared float Weights[341];

[numthreads(16, 16, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    bool is_needed = Small.Load(IS_HIDDEN) != 0;
    float4 colour = 0;
    float weight = 0;
    uint number = thread.y * Tiles.x + thread.x;
    if (is_needed && all(thread.xy < Tiles))
    {
        colour = asfloat(Small.Load4(AtKnown + 20 * number));
        weight = asfloat(Small.Load(AtKnown + 20 * number + 16));
    }
    Colours[index] = colour;
    Weights[index] = weight;
    GroupMemoryBarrierWithGroupSync();
    // Up: levels of 16 x 16, 8 x 8 and so on, one after the other.
    uint below = 0;
    uint above = 256;
    uint side = 8;
    [unroll]
    for (uint up = 1; up < 5; up++)
    {
        if (index < side * side)
        {
            uint first = below + 2 * (index / side) * 2 * side + 2 * (index % side);
            uint beneath = first + 2 * side;
            precise float4 colours = ((Colours[first] + Colours[first + 1]) + Colours[beneath]) + Colours[beneath + 1];
            precise float weights = ((Weights[first] + Weights[first + 1]) + Weights[beneath]) + Weights[beneath + 1];
            Colours[above + index] = colours;
            Weights[above + index] = weights;
        }
        GroupMemoryBarrierWithGroupSync();
        below = above;
        above += side * side;
        side /= 2;
    }
    // Down again: `below` is the level of one cell now.
    above = below;
    side = 2;
    [unroll]
    for (uint down = 1; down < 5; down++)
    {
        below = above - side * side;
        if (index < side * side)
        {
            uint parent = above + (index / side / 2) * (side / 2) + index % side / 2;
            float lent = LENT / max(Weights[parent], LENT);
            precise float4 lent_colour = Colours[below + index] + Colours[parent] * lent;
            precise float lent_weight = Weights[below + index] + Weights[parent] * lent;
            Colours[below + index] = lent_colour;
            Weights[below + index] = lent_weight;
        }
        GroupMemoryBarrierWithGroupSync();
        above = below;
        side *= 2;
    }
    if (is_needed && all(thread.xy < Tiles))
    {
        Small.Store4(AtCells + 20 * number, asuint(Colours[index]));
        Small.Store(AtCells + 20 * number + 16, asuint(Weights[index]));
        if (Weights[index] == 0)
        {
            Small.InterlockedOr(IS_BLANK, 1);
        }
    }
}
