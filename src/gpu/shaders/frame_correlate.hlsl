// Correlation of the tiny pictures for each shift of the current one, over the overlapping part. A group per shift.

#include "frame.hlsli"
#include "frame_cut.hlsli"

groupshared uint Sums[6];

// a b, upper word first.
uint2 product(uint a, uint b)
{
    uint low = (a & 0xffff) * (b & 0xffff);
    uint across = (a >> 16) * (b & 0xffff) + (low >> 16);
    uint other = (a & 0xffff) * (b >> 16) + (across & 0xffff);
    return uint2((a >> 16) * (b >> 16) + (across >> 16) + (other >> 16), other << 16 | low & 0xffff);
}

// a b - c d.
float difference(uint a, uint b, uint c, uint d)
{
    uint2 left = product(a, b);
    uint2 right = product(c, d);
    bool is_negative = left.x < right.x || left.x == right.x && left.y < right.y;
    uint2 more = is_negative ? right : left;
    uint2 less = is_negative ? left : right;
    uint2 rest = uint2(more.x - less.x - (more.y < less.y ? 1 : 0), more.y - less.y);
    float apart = float(rest.x) * 4294967296.0 + float(rest.y);
    return is_negative ? -apart : apart;
}

[numthreads(64, 1, 1)]
void main(uint3 group : SV_GroupID, uint thread : SV_GroupIndex)
{
    int2 size = int2(tiny_size());
    int2 shift = int2(group.xy) - int2(shift_reach());
    if (thread < 6)
    {
        Sums[thread] = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 first = max(-shift, 0);
    int2 end = min(size, size - shift);
    uint width = uint(max(end.x - first.x, 0));
    uint pixels = width * uint(max(end.y - first.y, 0));
    uint sums[5] = { 0, 0, 0, 0, 0 };
    if (Small.Load(IS_CUT_SUSPECTED) != 0)
    {
        [loop]
        for (uint i = thread; i < pixels; i += 64)
        {
            int2 at = first + int2(i % width, i / width);
            int2 there = at + shift;
            uint a = Small.Load(AtTiny + 4 * uint(size.x * size.y + at.y * size.x + at.x));
            uint b = Small.Load(AtTiny + 4 * uint(there.y * size.x + there.x));
            sums[0] += a;
            sums[1] += a * a;
            sums[2] += b;
            sums[3] += b * b;
            sums[4] += a * b;
        }
    }
    [unroll]
    for (uint s = 0; s < 5; s++)
    {
        InterlockedAdd(Sums[s], sums[s]);
    }
    GroupMemoryBarrierWithGroupSync();
    if (thread == 0)
    {
        float here = difference(pixels, Sums[1], Sums[0], Sums[0]);
        float there = difference(pixels, Sums[3], Sums[2], Sums[2]);
        float both = difference(pixels, Sums[4], Sums[0], Sums[2]);
        float2 deviations = float2(sqrt(here), sqrt(there)) / float(pixels);
        float correlation = both / (float(pixels) * float(pixels)) / (deviations.x * deviations.y);
        uint across = 2 * shift_reach().x + 1;
        Small.Store(AtShifts + 4 * (group.y * across + group.x), asuint(all(deviations > 0) ? correlation : 0));
    }
}
