// Colour of each tile for inpainting: that of its visible pixels, with little weight for the surrounding 2x2, 4x4, ... tiles. A group per
// square of 16x16 tiles.

#include "constants.hlsli"
#include "frame.hlsli"

groupshared float4 Colours[341];
groupshared float Weights[341];

[numthreads(16, 16, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    bool is_needed = Small.Load(HAS_HIDDEN) != 0;
    float4 colour = 0;
    float weight = 0;
    uint number = thread.y * Tiles.x + thread.x;
    if (is_needed && all(thread.xy < Tiles))
    {
        colour = asfloat(Small.Load4(AtColourSums + 20 * number));
        weight = asfloat(Small.Load(AtColourSums + 20 * number + 16));
    }
    Colours[index] = colour;
    Weights[index] = weight;
    GroupMemoryBarrierWithGroupSync();
    // Upwards: sums of 2x2 cells.
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
    // Downwards: `below` is the level with one cell.
    above = below;
    side = 2;
    [unroll]
    for (uint down = 1; down < 5; down++)
    {
        below = above - side * side;
        if (index < side * side)
        {
            uint parent = above + (index / side / 2) * (side / 2) + index % side / 2;
            float weight_of_parent = INPAINT_PARENT_WEIGHT / max(Weights[parent], INPAINT_PARENT_WEIGHT);
            precise float4 blended_colour = Colours[below + index] + Colours[parent] * weight_of_parent;
            precise float blended_weight = Weights[below + index] + Weights[parent] * weight_of_parent;
            Colours[below + index] = blended_colour;
            Weights[below + index] = blended_weight;
        }
        GroupMemoryBarrierWithGroupSync();
        above = below;
        side *= 2;
    }
    if (is_needed && all(thread.xy < Tiles))
    {
        Small.Store4(AtTileColours + 20 * number, asuint(Colours[index]));
        Small.Store(AtTileColours + 20 * number + 16, asuint(Weights[index]));
        if (Weights[index] == 0)
        {
            Small.InterlockedOr(HAS_EMPTY_SQUARE, 1u);
        }
    }
}
