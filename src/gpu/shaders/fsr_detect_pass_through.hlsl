// Detects a provider that passes frames through. Counts samples with more than two pixels of motion where the generated frame should differ
// from the current one; those where it is the current frame; and those where it is black.

cbuffer Constants : register(b0)
{
    uint2 Size;       // size of the frames
    uint2 MotionSize;
    float2 Scale;     // from motion units to pixels of the frames
    uint2 Step;       // from one sample to the next
    uint2 Samples;
};

Texture2D<float4> Generated : register(t0);
Texture2D<float4> Frame : register(t1);
Texture2D<float2> Motion : register(t2);
RWByteAddressBuffer Counts : register(u0); // samples, equal to the current frame, black

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Samples))
    {
        return;
    }
    uint2 pixel = at.xy * Step + Step / 2;
    float2 v = Motion.Load(int3(pixel * MotionSize / Size, 0)) * Scale;
    // Motion leads from this frame to the previous one. Content of the generated frame at `pixel` is at `from` in this frame.
    int2 from = int2(round(float2(pixel) - v / 2));
    if (dot(v, v) < 4 || any(from < 0) || any(from >= int2(Size)))
    {
        return;
    }
    float3 here = Frame.Load(int3(pixel, 0)).rgb;
    float3 there = Frame.Load(int3(from, 0)).rgb;
    float3 generated = Generated.Load(int3(pixel, 0)).rgb;
    if (any(abs(here - there) > 8.0 / 255))
    {
        Counts.InterlockedAdd(0, 1u);
        if (all(abs(generated - here) < 0.6 / 255))
        {
            Counts.InterlockedAdd(4, 1u);
        }
        if (all(generated <= 0) && any(here > 8.0 / 255))
        {
            Counts.InterlockedAdd(8, 1u);
        }
    }
}
