// Difference of two pictures: the sum of absolute differences over a grid of samples, of colours clamped to [0, 1] in steps of 1/255.

cbuffer Constants : register(b0)
{
    uint2 First;   // first sample
    uint2 Step;    // step between samples
    uint2 Samples; // columns and rows of samples, at most 512 x 512, so that the sum fits 32 bits
    uint At;       // byte offset of the sum
};

Texture2D<float4> Found : register(t0);
Texture2D<float4> Expected : register(t1);
RWByteAddressBuffer Sums : register(u0);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Samples))
    {
        return;
    }
    int3 pixel = int3(First + at.xy * Step, 0);
    // min returns its other argument for NaN, so that NaN counts as 1.
    float3 found = max(min(Found.Load(pixel).rgb, 1), 0);
    float3 expected = max(min(Expected.Load(pixel).rgb, 1), 0);
    uint3 steps = uint3(abs(found - expected) * 255 + 0.5);
    Sums.InterlockedAdd(At, steps.x + steps.y + steps.z);
}
