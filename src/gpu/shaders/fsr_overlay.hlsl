// Composites an anchor's static overlay onto a generated frame.

cbuffer Constants : register(b0)
{
    uint2 Size;  // of all three textures
};

Texture2D<float4> Anchor : register(t0);
Texture2D<float> Mask : register(t1);
RWTexture2D<float4> Generated : register(u0);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (all(at.xy < Size) && Mask.Load(int3(at.xy, 0)) > 0)
    {
        Generated[at.xy] = Anchor.Load(int3(at.xy, 0));
    }
}
