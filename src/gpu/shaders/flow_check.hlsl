// Forward-backward consistency check: motion is trusted if it matches, stays inside the picture, and the reverse flow leads back.

#include "constants.hlsli"
#include "flow.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Level))
    {
        return;
    }
    uint pixel = at.y * Level.x + at.x;
    precise float2 v = motion_at(AtDense.x, pixel);
    precise float2 target = float2(at.xy) + v;
    bool is_trusted = Work.Load(AtTrusted + 4 * pixel) != 0 && all(target >= 0) && all(target <= float2(Level - 1));
    if (is_trusted)
    {
        precise float2 nearest = floor(target + 0.5);
        uint2 other = uint2(nearest) >> CheckedHalvings;
        precise float2 back = motion_at(AtDense.y, other.y * CheckedLevel.x + other.x) * float(1u << CheckedHalvings);
        precise float2 sum = v + back;
        precise float return_error = sum.x * sum.x + sum.y * sum.y;
        precise float tolerance = CONSISTENCY_TOLERANCE + CONSISTENCY_TOLERANCE_PER_LENGTH * (v.x * v.x + v.y * v.y + back.x * back.x + back.y * back.y);
        is_trusted = return_error <= tolerance;
    }
    Work.Store(AtTrusted + 4 * pixel, is_trusted ? 1 : 0);
}
