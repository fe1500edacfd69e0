// Which motions to trust: those that show the same at their end, in the picture, and are undone there by the way back.

#include "flow.hlsli"

static const float SLACK = 0.5;
static const float SLACK_PER_LENGTH = 0.01;

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Level))
    {
        return;
    }
    uint pixel = at.y * Level.x + at.x;
    precise float2 v = motion_at(AtDense.x, pixel);
    precise float2 there = float2(at.xy) + v;
    bool is_trusted = Work.Load(AtTrusted + 4 * pixel) != 0 && all(there >= 0) && all(there <= float2(Level - 1));
    if (is_trusted)
    {
        precise float2 nearest = floor(there + 0.5);
        uint2 other = uint2(nearest) >> CheckedHalvings;
        precise float2 back = motion_at(AtDense.y, other.y * CheckedLevel.x + other.x) * float(1u << CheckedHalvings);
        precise float2 sum = v + back;
        precise float miss = sum.x * sum.x + sum.y * sum.y;
        precise float allowed = SLACK + SLACK_PER_LENGTH * (v.x * v.x + v.y * v.y + back.x * back.x + back.y * back.y);
        is_trusted = miss <= allowed;
    }
    Work.Store(AtTrusted + 4 * pixel, is_trusted ? 1 : 0);
}
