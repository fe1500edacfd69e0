// Upscales a frame, as far as the double needs it: this frame, bilinear, blended with the previous output along the motion, weighted by the
// reactive mask.

#include "curves.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Size;         // size of the output
    uint2 RenderSize;   // size of the frame
    uint2 MotionSize;
    float2 Scale;       // from motion to render pixels
    float2 Jitter;      // camera jitter, in render pixels
    float Sharpness;
    float PreExposure;  // factor by which the frame was multiplied
    uint Flags;
    float2 HeldJitter;  // camera jitter contained in motion, in render pixels
};

static const uint RESET = 1, EXPOSED = 2, REACTIVE = 4, TRANSPARENT = 8, INVERTED = 16, SRGB = 32, PQ = 64, JITTERED = 128;

Texture2D<float4> Color : register(t0);
Texture2D<float> Exposure : register(t1);
Texture2D<float4> Before : register(t2);
Texture2D<float2> Motion : register(t3);
Texture2D<float> Depth : register(t4);
Texture2D<float> Reactive : register(t5);
Texture2D<float> Transparency : register(t6);
RWTexture2D<float4> Output : register(u0);

float3 decoded(float3 c)
{
    if ((Flags & SRGB) != 0)
    {
        return of_srgb(c);
    }
    if ((Flags & PQ) != 0)
    {
        return 10 * of_pq(c);
    }
    return c;
}

float3 encoded(float3 light)
{
    light = max(light, 0);
    if ((Flags & SRGB) != 0)
    {
        return to_srgb(light);
    }
    if ((Flags & PQ) != 0)
    {
        return to_pq(light / 10);
    }
    return light;
}

// Bilinear sample of this frame, or of the previous output, in linear light.
float3 between(float2 at, bool is_before)
{
    int2 last = int2(is_before ? Size : RenderSize) - 1;
    at = clamp(at, 0, float2(last));
    int2 low = int2(floor(at));
    float2 t = at - low;
    float3 sum = 0;
    [loop]
    for (uint i = 0; i < 4; i++)
    {
        int2 place = min(low + int2(i & 1, i >> 1), last);
        float weight = ((i & 1) != 0 ? t.x : 1 - t.x) * ((i & 2) != 0 ? t.y : 1 - t.y);
        sum += weight * decoded(is_before ? Before.Load(int3(place, 0)).rgb : Color.Load(int3(place, 0)).rgb);
    }
    return sum;
}

[numthreads(8, 8, 1)]
void main(uint3 id : SV_DispatchThreadID)
{
    if (any(id.xy >= Size))
    {
        return;
    }
    float2 ratio = float2(RenderSize) / float2(Size);
    float2 at = (float2(id.xy) + 0.5) * ratio - 0.5 + Jitter;
    float3 now = between(at, false);
    if (Sharpness > 0)
    {
        float3 round = between(at + float2(1, 0), false) + between(at - float2(1, 0), false);
        round += between(at + float2(0, 1), false) + between(at - float2(0, 1), false);
        now = max(now + Sharpness * (now - round / 4), 0);
    }
    float3 mixed = now;
    int2 centre = clamp(int2(round(at)), int2(0, 0), int2(RenderSize) - 1);
    // Motion of the nearest neighbour.
    int2 nearest = centre;
    float depth = Depth.Load(int3(centre, 0));
    [loop]
    for (uint i = 0; i < 9; i++)
    {
        int2 place = clamp(centre + int2(uint2(i % 3, i / 3)) - 1, int2(0, 0), int2(RenderSize) - 1);
        float d = Depth.Load(int3(place, 0));
        if ((Flags & INVERTED) != 0 ? d > depth : d < depth)
        {
            depth = d;
            nearest = place;
        }
    }
    int2 place = int2((float2(nearest) + 0.5) * float2(MotionSize) / float2(RenderSize));
    float2 v = Motion.Load(int3(place, 0)) * Scale;
    v = all(MotionSize == Size) ? v : v / ratio;
    v -= (Flags & JITTERED) != 0 ? HeldJitter / ratio : float2(0, 0);
    float2 then = float2(id.xy) + v;
    if ((Flags & RESET) == 0 && all(then >= 0) && all(then <= float2(Size) - 1))
    {
        float weight = 0.5;
        weight *= (Flags & REACTIVE) != 0 ? 1 - saturate(Reactive.Load(int3(centre, 0))) : 1;
        weight *= (Flags & TRANSPARENT) != 0 ? 1 - saturate(Transparency.Load(int3(centre, 0))) / 2 : 1;
        // Bright pixels get less weight, as after tone mapping.
        float exposure = ((Flags & EXPOSED) != 0 ? Exposure.Load(int3(0, 0, 0)) : 1) / PreExposure;
        float3 a = now * exposure, b = between(then, true) * exposure;
        float3 shown = lerp(a / (1 + a), b / (1 + b), weight);
        mixed = shown / max(1 - shown, 1e-4) / exposure;
    }
    Output[id.xy] = float4(encoded(mixed), 1);
}
