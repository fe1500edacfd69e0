// The motion of the whole picture: that of a plane before a moving camera, on which most of the grid agrees. One group to a
// direction; least squares, again and again, each sample counting the less the farther it was off. The order of operations is that of
// the processor.

#include "flow.hlsli"

static const uint THREADS = 64;
static const uint SUMS = 21;
static const uint N = 8;
static const uint ROUNDS = 5;
static const float KNOWN = 4;
static const float NOISE = 1;
static const float RIDGE = 1e-5;

groupshared float Sums[SUMS][THREADS];
groupshared float Totals[SUMS];
groupshared float Numbers[N];
groupshared uint IsKnown;

// Which of the sums stands in each place of the upper half of the system, row by row; 21 is none.
static const uint PLACES[N * N] =
{
    0, 1, 2, 21, 21, 21, 3, 4,
    0, 3, 4, 21, 21, 21, 6, 7,
    0, 0, 5, 21, 21, 21, 7, 8,
    0, 0, 0, 0, 1, 2, 4, 5,
    0, 0, 0, 0, 3, 4, 7, 8,
    0, 0, 0, 0, 0, 5, 8, 9,
    0, 0, 0, 0, 0, 0, 10, 11,
    0, 0, 0, 0, 0, 0, 0, 12
};

// Solves the positive definite system that the sums make; none where nothing is in it.
bool solved()
{
    precise float rows[N * N];
    precise float right[N];
    precise float trace = 0;
    [unroll]
    for (uint row = 0; row < N; row++)
    {
        [unroll]
        for (uint column = row; column < N; column++)
        {
            uint sum = PLACES[row * N + column];
            rows[row * N + column] = sum < SUMS ? Totals[min(sum, SUMS - 1)] : 0;
        }
        right[row] = Totals[13 + row];
        trace += rows[row * N + row];
    }
    precise float ridge = RIDGE / N * trace;
    bool is_known = true;
    [unroll]
    for (uint i = 0; i < N; i++)
    {
        precise float pivot = rows[i * N + i] + ridge;
        rows[i * N + i] = pivot;
        // Not a number fails this too.
        is_known = is_known && pivot > 0;
        [unroll]
        for (uint j = i + 1; j < N; j++)
        {
            precise float part = rows[i * N + j] / pivot;
            [unroll]
            for (uint k = j; k < N; k++)
            {
                rows[j * N + k] -= part * rows[i * N + k];
            }
            right[j] -= part * right[i];
        }
    }
    [unroll]
    for (uint b = 0; b < N; b++)
    {
        uint last = N - 1 - b;
        [unroll]
        for (uint k = last + 1; k < N; k++)
        {
            right[last] -= rows[last * N + k] * right[k];
        }
        right[last] /= rows[last * N + last];
        Numbers[last] = right[last];
        is_known = is_known && is_finite(right[last]);
    }
    return is_known;
}

[numthreads(THREADS, 1, 1)]
void main(uint3 group : SV_GroupID, uint thread : SV_GroupIndex)
{
    uint direction = Direction + group.z;
    uint2 samples = (Cells + Step - 1) / Step;
    uint2 size = Cells * Stride;
    precise float unit = 2 / float(max(size.x, size.y));
    if (thread < N)
    {
        Numbers[thread] = 0;
    }
    if (thread == 0)
    {
        IsKnown = 1;
    }
    GroupMemoryBarrierWithGroupSync();
    [loop]
    for (uint round = 0; round < ROUNDS; round++)
    {
        float inverse = round == 0 ? 0 : round == 1 ? 0.25 : round == 2 ? 1 : 4;
        precise float sums[SUMS];
        {
            [unroll]
            for (uint s = 0; s < SUMS; s++)
            {
                sums[s] = 0;
            }
        }
        [loop]
        for (uint sample = thread; sample < samples.x * samples.y; sample += THREADS)
        {
            uint2 cell = Step * uint2(sample % samples.x, sample / samples.x);
            uint number = cell.y * Cells.x + cell.x;
            uint place = of_two(AtFound, direction) + 32 * number;
            float residual = asfloat(Work.Load(place + 12));
            float3 hessian = asfloat(Work.Load3(place + 16));
            float2 v = motion_at(of_two(AtFlow, direction), number);
            precise float information = (hessian.x + hessian.z) / (residual + NOISE);
            precise float2 p = ((float2(cell) + 0.5) * float(Stride) - 0.5 * float2(size)) * unit;
            precise float bend = Numbers[6] * p.x + Numbers[7] * p.y;
            precise float2 plane =
                float2(Numbers[0] + Numbers[1] * p.x + Numbers[2] * p.y, Numbers[3] + Numbers[4] * p.x + Numbers[5] * p.y);
            precise float2 of_model = plane + bend * p;
            precise float2 apart = v - of_model;
            precise float off = 1 + (apart.x * apart.x + apart.y * apart.y) * inverse;
            precise float w = information / (information + KNOWN) / (off * off);
            float x = p.x;
            float y = p.y;
            precise float xx = x * x;
            precise float xy = x * y;
            precise float yy = y * y;
            precise float terms[SUMS] =
            {
                1, x, y, xx, xy, yy, x * xx, x * xy, x * yy, y * yy, xx * (xx + yy), xy * (xx + yy), yy * (xx + yy),
                v.x, x * v.x, y * v.x, v.y, x * v.y, y * v.y, xx * v.x + xy * v.y, xy * v.x + yy * v.y
            };
            [unroll]
            for (uint t = 0; t < SUMS; t++)
            {
                sums[t] += w * terms[t];
            }
        }
        [unroll]
        for (uint o = 0; o < SUMS; o++)
        {
            Sums[o][thread] = sums[o];
        }
        GroupMemoryBarrierWithGroupSync();
        if (thread < SUMS)
        {
            precise float total = 0;
            [loop]
            for (uint other = 0; other < THREADS; other++)
            {
                total += Sums[thread][other];
            }
            Totals[thread] = total;
        }
        GroupMemoryBarrierWithGroupSync();
        if (thread == 0 && !solved())
        {
            IsKnown = 0;
        }
        GroupMemoryBarrierWithGroupSync();
    }
    uint model = of_two(AtModel, direction);
    if (thread < N)
    {
        Work.Store(model + 4 + 4 * thread, IsKnown != 0 ? asuint(Numbers[thread]) : 0);
    }
    if (thread == 0)
    {
        Work.Store(model, IsKnown);
    }
}
