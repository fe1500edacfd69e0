// The paper's guidance on the latent grid: gradient of the mean difference of two latents, and pseudo-depth. One group computes all cells.
// Sums and differences are double floats, as the CPU computes them in double precision: where neighbours differ little, the gradient would
// otherwise be rounding errors.

#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Grid;      // width, height
    uint2 First;     // index of the first element of the previous and of the current latent
    uint Channels;
    uint Half;       // 1: half floats, 0: floats
};

ByteAddressBuffer Previous : register(t0);
ByteAddressBuffer Current : register(t1);
// Per cell the sum of differences as a double float, then gradient along x, along y, and depth.
RWByteAddressBuffer Cells : register(u0);

static const uint THREADS = 256;
static const uint WORDS = 5;
// Differences and sums of any floats stay finite at this scale.
static const float SMALL = 1.0 / 65536.0;

groupshared float Lowest[THREADS];
groupshared float Highest[THREADS];

// a + b as a double float.
float2 sum(float a, float b)
{
    precise float s = a + b;
    precise float v = s - a;
    precise float rest = (a - (s - v)) + (b - v);
    return float2(s, rest);
}

float2 sum_of(uint cell)
{
    float2 total = 0;
    uint cells = Grid.x * Grid.y;
    for (uint channel = 0; channel < Channels; channel++)
    {
        uint index = channel * cells + cell;
        float before = load_number(Previous, First.x + index, Half != 0) * SMALL;
        float now = load_number(Current, First.y + index, Half != 0) * SMALL;
        float2 difference = sum(now, -before);
        float2 next = sum(total.x, difference.x);
        precise float rest = next.y + (total.y + difference.y);
        total = sum(next.x, rest);
    }
    return total;
}

// A double float divided by an integer below 4096, correctly rounded: the quotient is multiplied back in two parts, whose products are
// exact, and the remainder is divided as well.
float quotient(float2 total, float n)
{
    precise float q = total.x / n;
    precise float wide = 4097 * q;
    precise float high = wide - (wide - q);
    precise float low = q - high;
    precise float rest = ((total.x - high * n) - low * n) + total.y;
    precise float result = q + rest / n;
    return result;
}

float slope(uint2 low, uint2 high, uint apart)
{
    if (apart == 0)
    {
        return 0;
    }
    float2 a = asfloat(Cells.Load2((low.y * Grid.x + low.x) * WORDS * 4));
    float2 b = asfloat(Cells.Load2((high.y * Grid.x + high.x) * WORDS * 4));
    float2 difference = sum(b.x, -a.x);
    precise float rest = difference.y + (b.y - a.y);
    float steep = quotient(sum(difference.x, rest), float(apart) * float(Channels));
    // Infinite beyond the range of floats, as on the CPU.
    return is_finite(steep) ? steep / SMALL : 0;
}

[numthreads(THREADS, 1, 1)]
void main(uint thread : SV_GroupIndex)
{
    uint cells = Grid.x * Grid.y;
    float lowest = asfloat(0x7f7fffff);
    float highest = -lowest;
    for (uint cell = thread; cell < cells; cell += THREADS)
    {
        Cells.Store2(cell * WORDS * 4, asuint(sum_of(cell)));
        float value = load_number(Current, First.y + cell, Half != 0);
        if (is_finite(value))
        {
            lowest = min(lowest, value);
            highest = max(highest, value);
        }
    }
    Lowest[thread] = lowest;
    Highest[thread] = highest;
    AllMemoryBarrierWithGroupSync();
    for (uint half = THREADS / 2; half > 0; half /= 2)
    {
        if (thread < half)
        {
            Lowest[thread] = min(Lowest[thread], Lowest[thread + half]);
            Highest[thread] = max(Highest[thread], Highest[thread + half]);
        }
        GroupMemoryBarrierWithGroupSync();
    }
    // A quarter of each value, so that no difference overflows.
    lowest = Lowest[0] * 0.25;
    float span = Highest[0] * 0.25 - lowest;
    for (uint i = thread; i < cells; i += THREADS)
    {
        uint2 at = uint2(i % Grid.x, i / Grid.x);
        uint2 before = uint2(at.x > 0 ? at.x - 1 : 0, at.y > 0 ? at.y - 1 : 0);
        uint2 after = min(at + 1, Grid - 1);
        float across = slope(uint2(before.x, at.y), uint2(after.x, at.y), after.x - before.x);
        float down = slope(uint2(at.x, before.y), uint2(at.x, after.y), after.y - before.y);
        float value = load_number(Current, First.y + i, Half != 0);
        float depth = is_finite(value) && span > 0 ? (value * 0.25 - lowest) / span : 0;
        Cells.Store3((i * WORDS + 2) * 4, asuint(float3(across, down, depth)));
    }
}
