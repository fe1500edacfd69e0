// Upsamples motion and depth to one value per pixel of a larger picture: motion is interpolated if the vectors are similar, otherwise
// nearest, so that nothing moves with the mean of two motions.

#include "constants.hlsli"

cbuffer Constants : register(b0)
{
    uint2 From;        // size of the picture
    uint2 To;          // size of the larger picture
    uint MotionTile;   // tile size of motion, in pixels of the picture
    uint DepthTile;    // tile size of depth
};

Texture2D<float2> Motion : register(t0);
Texture2D<float> Depth : register(t1);
RWTexture2D<float2> LargeMotion : register(u0);
RWTexture2D<float> LargeDepth : register(u1);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= To))
    {
        return;
    }
    float2 scale = float2(To) / float2(From);
    // Position in the picture, from its corner.
    float2 position = (float2(at.xy) + 0.5) / scale;
    uint2 pixel = min(uint2(position), From - 1);
    int2 last = int2((From - 1) / MotionTile);
    float2 cell = position / MotionTile - 0.5;
    int2 first = int2(floor(cell));
    float2 part = cell - float2(first);
    float2 v00 = Motion.Load(int3(min(max(first, 0), last), 0));
    float2 v10 = Motion.Load(int3(min(max(first + int2(1, 0), 0), last), 0));
    float2 v01 = Motion.Load(int3(min(max(first + int2(0, 1), 0), last), 0));
    float2 v11 = Motion.Load(int3(min(max(first + 1, 0), last), 0));
    float2 difference = max(max(v00, v10), max(v01, v11)) - min(min(v00, v10), min(v01, v11));
    float2 moved = Motion.Load(int3(pixel / MotionTile, 0));
    if (all(difference <= RESAMPLE_MAX_DIFFERENCE))
    {
        moved = lerp(lerp(v00, v10, part.x), lerp(v01, v11, part.x), part.y);
    }
    LargeMotion[at.xy] = moved * scale;
    LargeDepth[at.xy] = Depth.Load(int3(pixel / DepthTile, 0));
}
