// In place of motion that is not trusted that of the nearest trusted pixels along eight rays, drawn on to it, weighted by nearness
// and by likeness. Nobody reads what is written here meanwhile.

#include "flow.hlsli"
#include "flow_trust.hlsli"

static const uint STEPS[14] = { 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 86 };
static const float COLOUR_SCALE = 20;
static const int LEAST_REACH = 8;
static const float STEEP = 0.3;

// The motion of a trusted pixel, drawn on in a line over `distance` steps back along `ray`.
float2 drawn_on(int2 place, int2 ray, int distance)
{
    int reach = max(distance, LEAST_REACH);
    int2 behind = place + reach * ray;
    float2 v = motion_at(AtDense.x, uint(place.y) * Level.x + uint(place.x));
    if (is_in_level(behind) && is_trusted(uint2(behind)))
    {
        precise float2 slope = (v - motion_at(AtDense.x, uint(behind.y) * Level.x + uint(behind.x))) / float(reach);
        precise float2 on = v + slope * float(distance);
        v = max(abs(slope.x), abs(slope.y)) < STEEP ? on : v;
    }
    return v;
}

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Level) || !is_wanted(at.xy) || is_mean(at.xy))
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
            int distance = int(STEPS[n]);
            int2 there = int2(at.xy) + step * distance;
            if (!is_in_level(there))
            {
                break;
            }
            is_found = is_trusted(uint2(there));
            if (is_found)
            {
                precise float3 apart = colour_of(OF_CURRENT, uint2(there) << Halvings) - own;
                precise float unlike = (apart.x * apart.x + apart.y * apart.y + apart.z * apart.z) / 3;
                precise float alike = 1 + unlike / (COLOUR_SCALE * COLOUR_SCALE);
                precise float weight = 1 / (alike * alike * float(distance));
                weights += weight;
                sum += weight * drawn_on(there, step, distance);
            }
        }
    }
    if (weights > 0)
    {
        precise float2 mean = sum / weights;
        Work.Store2(AtDense.x + 8 * (at.y * Level.x + at.x), asuint(mean));
    }
}
