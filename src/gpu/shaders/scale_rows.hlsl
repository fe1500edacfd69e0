// Scales a picture vertically: each row is a weighted sum of source rows, in levels of 1/255. Filters overshoot at edges, so sums are
// stored in 1/64 level with an offset of 256 levels.

cbuffer Constants : register(b0)
{
    uint2 From;   // size of the picture
    uint2 To;     // size of the result
    uint AtTaps;  // byte offset of the row tables: first source row, then its weights
    uint Taps;    // number of weights
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
