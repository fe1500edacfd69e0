// Fills pixels that neither anchor shows, with bilinear interpolation between the tiles' colours. A group per tile.

#include "frame.hlsli"
#include "frame_colour.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    uint hidden = Small.Load(AtHidden + 8 * (group.y * Tiles.x + group.x) + 4 * (index >> 5));
    if ((hidden >> (index & 31) & 1) == 0)
    {
        return;
    }
    float2 last = float2(Tiles - 1);
    precise float2 position = (float2(thread.xy) + 0.5) / TILE - 0.5;
    position = min(max(position, 0), last);
    uint2 first = min(uint2(position), Tiles - 1);
    uint2 next = min(first + 1, Tiles - 1);
    float2 t = position - float2(first);
    float4 colour = 0;
    float weight = 0;
    [unroll]
    for (uint corner = 0; corner < 4; corner++)
    {
        uint2 cell = uint2((corner & 1) != 0 ? next.x : first.x, corner >= 2 ? next.y : first.y);
        float wx = (corner & 1) != 0 ? t.x : 1 - t.x;
        float wy = corner >= 2 ? t.y : 1 - t.y;
        uint at = AtTileColours + 20 * (cell.y * Tiles.x + cell.x);
        precise float4 added = colour + asfloat(Small.Load4(at)) * wx * wy;
        precise float added_weight = weight + asfloat(Small.Load(at + 16)) * wx * wy;
        colour = added;
        weight = added_weight;
    }
    float4 levels = colour / max(weight, 1e-6);
    float4 whole = floor(min(max(levels + 0.5, 0), 255));
    float4 wide = rounded_to_half(levels / 255);
    float4 raw = whole;
    if (IsFloat != 0)
    {
        raw = wide;
    }
    store_pixel(int2(thread.xy), raw);
}
