// Luma of both anchors in code values, full size or halved: means of 2 x 2 pixels; an odd last column counts twice.

#include "flow.hlsli"

float luma_of(uint picture, uint2 at)
{
    float3 c = colour_of(picture, at);
    precise float luma = (0.299 * c.x + 0.587 * c.y) + 0.114 * c.z;
    return luma;
}

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Level))
    {
        return;
    }
    uint position = of_two(AtLuma, at.z) + 4 * (at.y * Level.x + at.x);
    float luma;
    [branch]
    if (IsHalved == 0)
    {
        luma = luma_of(at.z, at.xy);
    }
    else
    {
        uint2 low = 2 * at.xy;
        uint2 high = min(low + 1, Size - 1);
        float a = luma_of(at.z, low);
        float b = luma_of(at.z, uint2(low.x, high.y));
        precise float pair = 0.5 * (a + b);
        precise float four = 0.25 * ((a + luma_of(at.z, uint2(high.x, low.y))) + (b + luma_of(at.z, high)));
        luma = high.x == low.x ? pair : four;
    }
    Work.Store(position, asuint(luma));
}
