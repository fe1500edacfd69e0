// Halves the luma of both anchors: means of 2 x 2 pixels; an odd last column counts twice.

#include "flow.hlsli"

float finer(uint picture, uint2 at)
{
    return asfloat(Work.Load(of_two(AtFinerLuma, picture) + 4 * (at.y * FinerLevel.x + at.x)));
}

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Level))
    {
        return;
    }
    uint2 low = 2 * at.xy;
    uint2 high = min(low + 1, FinerLevel - 1);
    float a = finer(at.z, low);
    float b = finer(at.z, uint2(low.x, high.y));
    precise float pair = 0.5 * (a + b);
    precise float four = 0.25 * ((a + finer(at.z, uint2(high.x, low.y))) + (b + finer(at.z, high)));
    Work.Store(of_two(AtLuma, at.z) + 4 * (at.y * Level.x + at.x), asuint(high.x == low.x ? pair : four));
}
