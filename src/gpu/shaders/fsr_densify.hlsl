// Expands tiled motion and depth to one value per pixel, as providers require.

cbuffer Constants : register(b0)
{
    uint2 Size;        // size of the picture
    uint MotionTile;   // tile size of motion, in pixels
    uint DepthTile;    // tile size of depth
};

Texture2D<float2> Motion : register(t0);
Texture2D<float> Depth : register(t1);
RWTexture2D<float2> EachMotion : register(u0);
RWTexture2D<float> EachDepth : register(u1);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Size))
    {
        return;
    }
    EachMotion[at.xy] = Motion.Load(int3(at.xy / MotionTile, 0));
    EachDepth[at.xy] = Depth.Load(int3(at.xy / DepthTile, 0));
}
