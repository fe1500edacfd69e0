// Sanitises motion for a provider: a vector that is not finite becomes 0, and none exceeds the picture. Providers march along vectors pixel
// by pixel, so that a wrong one would stall the device.

#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Size;    // width, height
    float2 Limit;  // largest components, in units of the texture
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
