// Output pass: scales the columns of the rows that scale_rows.hlsl wrote, converts to the target's colours and format, and writes black
// bars where the picture does not fill the target.

#include "half_float.hlsli"
#include "srgb.hlsli"

cbuffer Constants : register(b0)
{
    uint2 From;         // width of the rows, and their number
    uint2 To;           // size of the picture
    uint AtTaps;        // byte offset of the column tables
    uint Taps;          // number of weights per column
    uint2 Target;       // size of the target
    uint2 At;           // the picture's top left pixel in the target
    uint Pitch;         // bytes per row
    uint TargetFormat;  // 0 RGBA8, 1 BGRA8, 2 RGB10A2, 3 RGBA16F, 4 R11G11B10F
    uint Encoding;      // 0: sRGB; 1: linear; 2: PQ with BT.2020 primaries
    float White;        // white level: linear value, or nits for PQ
};

ByteAddressBuffer Between : register(t0);
ByteAddressBuffer Tables : register(t1);
RWByteAddressBuffer Finished : register(u0);

float4 held(uint2 at)
{
    uint2 words = Between.Load2(8 * (at.y * From.x + at.x));
    uint4 parts = uint4(words.x & 0xffff, words.x >> 16, words.y & 0xffff, words.y >> 16);
    return float4(parts) / 64 - 256;
}

// Linear colours from sRGB to BT.2020 primaries (ITU-R BT.2087).
float3 bt2020_from_srgb(float3 colour)
{
    return float3(dot(colour, float3(0.6274, 0.3293, 0.0433)), dot(colour, float3(0.0691, 0.9195, 0.0114)),
        dot(colour, float3(0.0164, 0.0880, 0.8956)));
}

// PQ encoding (SMPTE ST 2084) of a luminance in nits.
float3 pq(float3 nits)
{
    float3 power = pow(min(max(nits, 0.000001), 10000) / 10000, 0.1593017578125);
    return pow((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power), 78.84375);
}

// sRGB-encoded colours in the target's encoding.
float4 encoded(float4 colour_in_srgb)
{
    float3 colour = colour_in_srgb.rgb;
    [branch]
    if (Encoding != 0)
    {
        float3 linear_colour = float3(linear_from_srgb(colour_in_srgb.x), linear_from_srgb(colour_in_srgb.y), linear_from_srgb(colour_in_srgb.z));
        if (Encoding == 1)
        {
            colour = linear_colour * White;
        }
        else
        {
            colour = pq(bt2020_from_srgb(linear_colour) * White);
        }
    }
    return float4(colour, colour_in_srgb.w);
}

void write(uint2 at, float4 v)
{
    uint place = at.y * Pitch;
    if (TargetFormat == 3)
    {
        uint4 h = uint4(half_from_float(v.x), half_from_float(v.y), half_from_float(v.z), half_from_float(v.w));
        Finished.Store2(place + 8 * at.x, uint2(h.x | h.y << 16, h.z | h.w << 16));
        return;
    }
    if (TargetFormat == 4)
    {
        Finished.Store(place + 4 * at.x, r11g11b10_from_float(v.xyz));
        return;
    }
    float4 top = TargetFormat == 2 ? float4(1023, 1023, 1023, 3) : float4(255, 255, 255, 255);
    uint4 levels = uint4(floor(min(max(v, 0), 1) * top + 0.5));
    uint first = TargetFormat == 1 ? levels.z : levels.x;
    uint third = TargetFormat == 1 ? levels.x : levels.z;
    uint bits = TargetFormat == 2 ? first | levels.y << 10 | third << 20 | levels.w << 30
                             : first | levels.y << 8 | third << 16 | levels.w << 24;
    Finished.Store(place + 4 * at.x, bits);
}

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Target))
    {
        return;
    }
    uint2 inside = at.xy - At;
    float4 levels = float4(0, 0, 0, 255);
    [branch]
    if (all(at.xy >= At) && all(inside < To))
    {
        uint table = AtTaps + inside.x * 4 * (Taps + 1);
        uint first = Tables.Load(table);
        levels = 0;
        [loop]
        for (uint tap = 0; tap < Taps; tap++)
        {
            levels += asfloat(Tables.Load(table + 4 * (tap + 1))) * held(uint2(first + tap, inside.y));
        }
    }
    write(at.xy, encoded(min(max(levels, 0), 255) / 255));
}
