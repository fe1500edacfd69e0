// The rows of a picture of another height: each the weighted mean of rows of what is given, in levels of 1/255. A sum may lie beyond
// them, as filters swing over at edges, and is held in 1/64 of a level from -256 on.

cbuffer Constants : register(b0)
{
    uint2 From;   // width and height of the picture
    uint2 To;     // width and height of the one that is made
    uint AtTaps;  // byte where the tables of rows lie: for each the first that counts, and the weights from there on
    uint Taps;    // how many weights
};

Texture2D<float4> Given : register(t0);
ByteAddressBuffer Tables : register(t1);
RWByteAddressBuffer Between : register(u0);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (at.x >= From.x || at.y >= To.y)
    {
        return;
    }
    uint table = AtTaps + at.y * 4 * (Taps + 1);
    uint first = Tables.Load(table);
    float4 sum = 0;
    [loop]
    for (uint tap = 0; tap < Taps; tap++)
    {
        float4 level = floor(Given.Load(int3(at.x, first + tap, 0)) * 255 + 0.5);
        sum += asfloat(Tables.Load(table + 4 * (tap + 1))) * level;
    }
    uint4 held = uint4(min(max((sum + 256) * 64 + 0.5, 0), 65535));
    Between.Store2(8 * (at.y * From.x + at.x), uint2(held.x | held.y << 16, held.z | held.w << 16));
}
