// One picture of a decoder's planes, red, green, blue, each [height, width], into a texture of another size: bilinear,
// half-pixel centres, edges repeated, numbers clamped to [0, 1] before they are mixed. The same as the processor's own, to the
// operation.

#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 From;      // width, height of a plane
    uint2 To;        // width, height of the texture
    uint First;      // the first number of the picture, counted in numbers
    uint Half;       // 1: the numbers are halves, 0: floats
    uint Levels;     // 255: rounded to bytes; 0: written as they are
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
        // What is not a number counts as 0.
        float4 corners = float4(load_number(Planes, top + low.x, Half != 0), load_number(Planes, top + high.x, Half != 0),
            load_number(Planes, bottom + low.x, Half != 0), load_number(Planes, bottom + high.x, Half != 0));
        float value = bilinear(min(max(corners, 0), 1), t);
        // How a float becomes a byte is the adapter's choice within limits; a whole number of levels leaves it none.
        precise float rounded = floor(value * Levels + 0.5) / Levels;
        pixel[channel] = Levels != 0 ? rounded : value;
    }
    Picture[at.xy] = pixel;
}
