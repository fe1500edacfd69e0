// Motion as a provider can be given it: a vector with a component that is not finite becomes none, and none is longer than the
// picture. Providers march along a vector pixel by pixel, so that a wild one holds the device up.

#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Size;    // width, height
    float2 Limit;  // the longest in x and in y, as the texture counts
};

Texture2D<float2> From : register(t0);
RWTexture2D<float2> To : register(u0);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Size))
    {
        return;
    }
    float2 v = From.Load(int3(at.xy, 0));
    To[at.xy] = is_finite(v.x) && is_finite(v.y) ? clamp(v, -Limit, Limit) : float2(0, 0);
}
