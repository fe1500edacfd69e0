// Completes a frame of AMD's library, which writes red into alpha: with the anchor's alpha, and the anchor's static overlay.

cbuffer Constants : register(b0)
{
    uint2 Size;  // of all textures
    uint HasMask;
};

Texture2D<float4> Generated : register(t0);
Texture2D<float4> Anchor : register(t1);
Texture2D<float> Mask : register(t2);
RWTexture2D<float4> Frame : register(u0);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (all(at.xy < Size))
    {
        int3 pixel = int3(at.xy, 0);
        float4 anchor = Anchor.Load(pixel);
        bool isOverlay = HasMask != 0 && Mask.Load(pixel) > 0;
        Frame[at.xy] = isOverlay ? anchor : float4(Generated.Load(pixel).rgb, anchor.a);
    }
}
