// Resizes a decoder's planes (red, green, blue, each [height, width]) into a texture: bilinear, half-pixel centres, clamped to the border;
// values are clamped to [0, 1] before interpolation. The same operations as on the CPU.

#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 From;      // size of a plane
    uint2 To;        // size of the texture
    uint First;      // index of the picture's first element
    uint Half;       // 1: half floats, 0: floats
    uint Levels;     // 255: rounded to bytes; 0: unchanged
};

ByteAddressBuffer Planes : register(t0);
RWTexture2D<float4> Picture : register(u0);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= To))
    {
        return;
    }
    uint2 low, high;
    float2 t;
    bilinear_cells(at.x, From.x, To.x, low.x, high.x, t.x);
    bilinear_cells(at.y, From.y, To.y, low.y, high.y, t.y);
    float4 pixel = 1;
    [unroll]
    for (uint channel = 0; channel < 3; channel++)
    {
        uint plane = First + channel * From.x * From.y;
        uint top = plane + low.y * From.x;
        uint bottom = plane + high.y * From.x;
        // min and max turn NaN into 0.
        float4 corners = float4(load_number(Planes, top + low.x, Half != 0), load_number(Planes, top + high.x, Half != 0),
            load_number(Planes, bottom + low.x, Half != 0), load_number(Planes, bottom + high.x, Half != 0));
        float value = bilinear(min(max(corners, 0), 1), t);
        // Adapters may round floats to bytes differently; integer levels leave no choice.
        precise float rounded = floor(value * Levels + 0.5) / Levels;
        pixel[channel] = Levels != 0 ? rounded : value;
    }
    Picture[at.xy] = pixel;
}
