// Replaces untrusted motion by that of the nearest trusted pixels along eight rays, extrapolated, weighted by distance and colour
// similarity. Only untrusted pixels are written, and only trusted ones read.

#include "constants.hlsli"
#include "flow.hlsli"
#include "flow_trust.hlsli"

// Motion of a trusted pixel, extrapolated linearly by `distance` steps against `ray`.
float2 extrapolated(int2 position, int2 ray, int distance)
{
    int steps = max(distance, CONSISTENCY_MIN_GRADIENT_STEPS);
    int2 behind = position + steps * ray;
    float2 v = motion_at(AtDense.x, uint(position.y) * Level.x + uint(position.x));
    if (is_in_level(behind) && is_trusted(uint2(behind)))
    {
        precise float2 slope = (v - motion_at(AtDense.x, uint(behind.y) * Level.x + uint(behind.x))) / float(steps);
        precise float2 extrapolated_motion = v + slope * float(distance);
        v = max(abs(slope.x), abs(slope.y)) < CONSISTENCY_EDGE_GRADIENT ? extrapolated_motion : v;
    }
    return v;
}

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Level) || !is_filled(at.xy) || is_interpolated(at.xy))
    {
        return;
    }
    float3 own = colour_of(OF_CURRENT, at.xy << Halvings);
    precise float weights = 0;
    precise float2 sum = 0;
    [loop]
    for (uint ray = 0; ray < 8; ray++)
    {
        int2 step = ray < 2 ? int2(1, 0) : ray < 4 ? int2(0, 1) : ray == 4 || ray == 7 ? int2(1, 1) : int2(-1, 1);
        step = ray == 1 || ray == 3 || ray > 5 ? -step : step;
        bool is_found = false;
        [loop]
        for (uint n = 0; n < 14 && !is_found; n++)
        {
            int distance = int(CONSISTENCY_STEPS[n]);
            int2 there = int2(at.xy) + step * distance;
            if (!is_in_level(there))
            {
                break;
            }
            is_found = is_trusted(uint2(there));
            if (is_found)
            {
                precise float3 difference = colour_of(OF_CURRENT, uint2(there) << Halvings) - own;
                precise float squared_difference = (difference.x * difference.x + difference.y * difference.y + difference.z * difference.z) / 3;
                precise float similarity = 1 + squared_difference / (CONSISTENCY_COLOUR_SCALE * CONSISTENCY_COLOUR_SCALE);
                precise float weight = 1 / (similarity * similarity * float(distance));
                weights += weight;
                sum += weight * extrapolated(there, step, distance);
            }
        }
    }
    if (weights > 0)
    {
        precise float2 mean = sum / weights;
        Work.Store2(AtDense.x + 8 * (at.y * Level.x + at.x), asuint(mean));
    }
}
