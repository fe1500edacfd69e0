// Writes motion, in pixels of the picture and rounded to half floats, and constant depth; each pixel takes that of the finest level.

#include "constants.hlsli"
#include "flow.hlsli"
#include "flow_trust.hlsli"
#include "half_float.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (all(at.xy < DepthSize))
    {
        Depth[at.xy] = PICTURE_FLOW_FLAT_DEPTH;
    }
    if (any(at.xy >= Size))
    {
        return;
    }
    uint2 position = at.xy >> Halvings;
    position.y -= copies_above(position) ? 1 : 0;
    uint pixel = position.y * Level.x + position.x;
    float2 found;
    if (is_interpolated(position))
    {
        precise float2 mean = 0.5 * (motion_at(AtDense.x, pixel - 1) + motion_at(AtDense.x, pixel + 1));
        found = mean;
    }
    else
    {
        found = motion_at(AtDense.x, pixel);
    }
    float2 limit = float2(Size);
    // The addition turns -0 into +0.
    precise float2 motion = 0 + min(max(found * float(1u << Halvings), -limit), limit);
    Motion[at.xy] = f16tof32(uint2(half_from_float(motion.x), half_from_float(motion.y)));
}
