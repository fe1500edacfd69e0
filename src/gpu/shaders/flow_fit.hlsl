// Fits the global motion: that of a plane before a moving camera, by iteratively reweighted least squares over the grid. A group per
// direction. The order of operations is the CPU's.

#include "flow.hlsli"

static const uint THREADS = 64;
static const uint SUMS = 21;
static const uint N = 8;
static const uint ROUNDS = 5;
static const float HALF_WEIGHT_INFORMATION = 4;
static const float NOISE = 1;
static const float RIDGE = 1e-5;

groupshared float Sums[SUMS][THREADS];
groupshared float Totals[SUMS];
groupshared float Parameters[N];
groupshared uint HasModel;

// Index of the sum at each entry of the system's upper triangle, row by row; 21 is zero.
static const uint ENTRIES[N * N] =
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

// Solves the positive definite system; false if it is singular.
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
            uint sum = ENTRIES[row * N + column];
            rows[row * N + column] = sum < SUMS ? Totals[min(sum, SUMS - 1)] : 0;
        }
        right[row] = Totals[13 + row];
        trace += rows[row * N + row];
    }
    precise float ridge = RIDGE / N * trace;
    bool is_solved = true;
    [unroll]
    for (uint i = 0; i < N; i++)
    {
        precise float pivot = rows[i * N + i] + ridge;
        rows[i * N + i] = pivot;
        // False for NaN as well.
        is_solved = is_solved && pivot > 0;
        [unroll]
        for (uint j = i + 1; j < N; j++)
        {
            precise float factor = rows[i * N + j] / pivot;
            [unroll]
            for (uint k = j; k < N; k++)
            {
                rows[j * N + k] -= factor * rows[i * N + k];
            }
            right[j] -= factor * right[i];
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
        Parameters[last] = right[last];
        is_solved = is_solved && is_finite(right[last]);
    }
    return is_solved;
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
        Parameters[thread] = 0;
    }
    if (thread == 0)
    {
        HasModel = 1;
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
            uint position = of_two(AtFound, direction) + 32 * number;
            float residual = asfloat(Work.Load(position + 12));
            float3 hessian = asfloat(Work.Load3(position + 16));
            float2 v = motion_at(of_two(AtFlow, direction), number);
            precise float information = (hessian.x + hessian.z) / (residual + NOISE);
            precise float2 p = ((float2(cell) + 0.5) * float(Stride) - 0.5 * float2(size)) * unit;
            precise float perspective = Parameters[6] * p.x + Parameters[7] * p.y;
            precise float2 plane =
                float2(Parameters[0] + Parameters[1] * p.x + Parameters[2] * p.y, Parameters[3] + Parameters[4] * p.x + Parameters[5] * p.y);
            precise float2 of_model = plane + perspective * p;
            precise float2 difference = v - of_model;
            precise float penalty = 1 + (difference.x * difference.x + difference.y * difference.y) * inverse;
            precise float w = information / (information + HALF_WEIGHT_INFORMATION) / (penalty * penalty);
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
            HasModel = 0;
        }
        GroupMemoryBarrierWithGroupSync();
    }
    uint model = of_two(AtModel, direction);
    if (thread < N)
    {
        Work.Store(model + 4 + 4 * thread, HasModel != 0 ? asuint(Parameters[thread]) : 0);
    }
    if (thread == 0)
    {
        Work.Store(model, HasModel);
    }
}
