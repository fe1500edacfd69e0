// A picture whose true place is known: waves of three directions, moved to the right. Without waves, one colour. Two such lie over
// one another where they are apart.

cbuffer Constants : register(b0)
{
    uint2 Size;   // width, height
    float2 Base;  // the mean of red, and of green and blue
    float Moved;  // to the right, in pixels
    float Waves;  // their height
    float Scale;  // of a pixel: 1 for a picture of 640 columns
    float Apart;  // of each from the middle of both, in pixels
};

RWTexture2D<float4> Picture : register(u0);

float3 waves_at(float2 at)
{
    float2 p = at * Scale;
    return sin(float3(p.x * 0.05, p.y * 0.07 + p.x * 0.02, p.x * 0.03 - p.y * 0.04));
}

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Size))
    {
        return;
    }
    float3 waves = (waves_at(float2(at.x - Moved - Apart, at.y)) + waves_at(float2(at.x - Moved + Apart, at.y))) / 2;
    Picture[at.xy] = float4(Base.xyy + Waves * waves, 1);
}
