// Reactive mask: where history is not to be trusted, the difference between a frame and the same frame without transparent objects.

cbuffer Constants : register(b0)
{
    uint2 Size;
    uint2 RenderSize;
    uint2 MotionSize;
    float Scale;
    float Threshold;
    float Value;
    uint Flags;
};

static const uint TONEMAP = 1, INVERSE_TONEMAP = 2, THRESHOLD = 4, COMPONENTS_MAX = 8;

Texture2D<float4> Opaque : register(t0);
Texture2D<float4> Color : register(t1);
RWTexture2D<float> Mask : register(u0);

float3 mapped(float3 c)
{
    float brightest = max(max(c.r, 0), max(c.g, c.b));
    if ((Flags & TONEMAP) != 0)
    {
        c /= brightest + 1;
    }
    if ((Flags & INVERSE_TONEMAP) != 0)
    {
        c /= max(1.0 / 32, 1 - brightest);
    }
    return c;
}

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Size))
    {
        return;
    }
    float3 apart = abs(mapped(Color.Load(int3(at.xy, 0)).rgb) - mapped(Opaque.Load(int3(at.xy, 0)).rgb));
    float mask = Scale * ((Flags & COMPONENTS_MAX) != 0 ? max(apart.r, max(apart.g, apart.b)) : length(apart));
    if ((Flags & THRESHOLD) != 0)
    {
        mask = mask < Threshold ? 0 : Value;
    }
    Mask[at.xy] = mask;
}
