// How far one picture is from another: the sum of the differences of their inner parts, on a grid of samples, of colours that
// are clamped to [0, 1] and counted in steps of 1/255.

cbuffer Constants : register(b0)
{
    uint2 First;   // the first sample
    uint2 Step;    // from one sample to the next
    uint2 Samples; // across and down, at most 512 x 512, so that the sum fits
    uint At;       // the byte that the sum is added to
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
    int3 place = int3(First + at.xy * Step, 0);
    // A minimum takes the number of a number and what is none, so what is not a number counts as 1.
    float3 found = max(min(Found.Load(place).rgb, 1), 0);
    float3 expected = max(min(Expected.Load(place).rgb, 1), 0);
    uint3 steps = uint3(abs(found - expected) * 255 + 0.5);
    Sums.InterlockedAdd(At, steps.x + steps.y + steps.z);
}
