// Fits the global motion: that of a plane before a moving camera, by iteratively reweighted least squares over the grid. A group per
// direction. The order of operations is the CPU's.

#include "constants.hlsli"
#include "flow.hlsli"

static const uint ROUNDS = 5;

groupshared float Sums[MODEL_SUMS][MODEL_PARTS];
groupshared float Totals[MODEL_SUMS];
groupshared float Parameters[MODEL_N];
groupshared uint HasModel;

// Index of the sum at each entry of the system's upper triangle, row by row; 21 is zero.
static const uint ENTRIES[MODEL_N * MODEL_N] =
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
    precise float rows[MODEL_N * MODEL_N];
    precise float right[MODEL_N];
    precise float trace = 0;
    [unroll]
    for (uint row = 0; row < MODEL_N; row++)
    {
        [unroll]
        for (uint column = row; column < MODEL_N; column++)
        {
            uint sum = ENTRIES[row * MODEL_N + column];
            rows[row * MODEL_N + column] = sum < MODEL_SUMS ? Totals[min(sum, MODEL_SUMS - 1)] : 0;
        }
        right[row] = Totals[13 + row];
        trace += rows[row * MODEL_N + row];
    }
    precise float ridge = MODEL_RIDGE / MODEL_N * trace;
    bool is_solved = true;
    [unroll]
    for (uint i = 0; i < MODEL_N; i++)
    {
        precise float pivot = rows[i * MODEL_N + i] + ridge;
        rows[i * MODEL_N + i] = pivot;
        // False for NaN as well.
        is_solved = is_solved && pivot > 0;
        [unroll]
        for (uint j = i + 1; j < MODEL_N; j++)
        {
            precise float factor = rows[i * MODEL_N + j] / pivot;
            [unroll]
            for (uint k = j; k < MODEL_N; k++)
            {
                rows[j * MODEL_N + k] -= factor * rows[i * MODEL_N + k];
            }
            right[j] -= factor * right[i];
        }
    }
    [unroll]
    for (uint b = 0; b < MODEL_N; b++)
    {
        uint last = MODEL_N - 1 - b;
        [unroll]
        for (uint k = last + 1; k < MODEL_N; k++)
        {
            right[last] -= rows[last * MODEL_N + k] * right[k];
        }
        right[last] /= rows[last * MODEL_N + last];
        Parameters[last] = right[last];
        is_solved = is_solved && is_finite(right[last]);
    }
    return is_solved;
}

[numthreads(MODEL_PARTS, 1, 1)]
void main(uint3 group : SV_GroupID, uint thread : SV_GroupIndex)
{
    uint direction = Direction + group.z;
    uint2 samples = (Cells + Step - 1) / Step;
    uint2 size = Cells * Stride;
    precise float unit = 2 / float(max(size.x, size.y));
    if (thread < MODEL_N)
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
        precise float sums[MODEL_SUMS];
        {
            [unroll]
            for (uint s = 0; s < MODEL_SUMS; s++)
            {
                sums[s] = 0;
            }
        }
        [loop]
        for (uint sample = thread; sample < samples.x * samples.y; sample += MODEL_PARTS)
        {
            uint2 cell = Step * uint2(sample % samples.x, sample / samples.x);
            uint number = cell.y * Cells.x + cell.x;
            uint position = of_two(AtFound, direction) + 32 * number;
            float residual = asfloat(Work.Load(position + 12));
            float3 hessian = asfloat(Work.Load3(position + 16));
            float2 v = motion_at(of_two(AtFlow, direction), number);
            precise float information = (hessian.x + hessian.z) / (residual + GRID_NOISE);
            precise float2 p = ((float2(cell) + 0.5) * float(Stride) - 0.5 * float2(size)) * unit;
            precise float perspective = Parameters[6] * p.x + Parameters[7] * p.y;
            precise float2 plane =
                float2(Parameters[0] + Parameters[1] * p.x + Parameters[2] * p.y, Parameters[3] + Parameters[4] * p.x + Parameters[5] * p.y);
            precise float2 of_model = plane + perspective * p;
            precise float2 difference = v - of_model;
            precise float penalty = 1 + (difference.x * difference.x + difference.y * difference.y) * inverse;
            precise float w = information / (information + GRID_HALF_WEIGHT_INFORMATION) / (penalty * penalty);
            float x = p.x;
            float y = p.y;
            precise float xx = x * x;
            precise float xy = x * y;
            precise float yy = y * y;
            precise float terms[MODEL_SUMS] =
            {
                1, x, y, xx, xy, yy, x * xx, x * xy, x * yy, y * yy, xx * (xx + yy), xy * (xx + yy), yy * (xx + yy),
                v.x, x * v.x, y * v.x, v.y, x * v.y, y * v.y, xx * v.x + xy * v.y, xy * v.x + yy * v.y
            };
            [unroll]
            for (uint t = 0; t < MODEL_SUMS; t++)
            {
                sums[t] += w * terms[t];
            }
        }
        [unroll]
        for (uint o = 0; o < MODEL_SUMS; o++)
        {
            Sums[o][thread] = sums[o];
        }
        GroupMemoryBarrierWithGroupSync();
        if (thread < MODEL_SUMS)
        {
            precise float total = 0;
            [loop]
            for (uint other = 0; other < MODEL_PARTS; other++)
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
    if (thread < MODEL_N)
    {
        Work.Store(model + 4 + 4 * thread, HasModel != 0 ? asuint(Parameters[thread]) : 0);
    }
    if (thread == 0)
    {
        Work.Store(model, HasModel);
    }
}
