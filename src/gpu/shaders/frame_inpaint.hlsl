// Paints what neither anchor shows in the colours around it, between the middles of the tiles. A group to a tile.

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
    precise float2 place = (float2(thread.xy) + 0.5) / TILE - 0.5;
    place = min(max(place, 0), last);
    uint2 first = min(uint2(place), Tiles - 1);
    uint2 next = min(first + 1, Tiles - 1);
    float2 t = place - float2(first);
    float4 colour = 0;
    float weight = 0;
    [unroll]
    for (uint corner = 0; corner < 4; corner++)
    {
        uint2 cell = uint2((corner & 1) != 0 ? next.x : first.x, corner >= 2 ? next.y : first.y);
        float wx = (corner & 1) != 0 ? t.x : 1 - t.x;
        float wy = corner >= 2 ? t.y : 1 - t.y;
        uint at = AtCells + 20 * (cell.y * Tiles.x + cell.x);
        precise float4 added = colour + asfloat(Small.Load4(at)) * wx * wy;
        precise float added_weight = weight + asfloat(Small.Load(at + 16)) * wx * wy;
        colour = added;
        weight = added_weight;
    }
    float4 levels = colour / max(weight, 1e-6);
    float4 whole = floor(min(max(levels + 0.5, 0), 255));
    float4 wide = halved(levels / 255);
    float4 held = whole;
    if (IsFloat != 0)
    {
        held = wide;
    }
    show(int2(thread.xy), held);
}
