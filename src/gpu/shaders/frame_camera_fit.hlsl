// Estimates the camera's motion from motion and depth of the current anchor, without static pixels: a least-squares fit of eleven
// parameters to a few hundred samples; if less than nine tenths are inliers, of the inliers of the best RANSAC trial. Values that need more
// than a float are double floats. One group.

#include "constants.hlsli"
#include "frame.hlsli"
#include "double_float.hlsli"

static const uint SAMPLES = CAMERA_FIT_SAMPLE_GRID.x * CAMERA_FIT_SAMPLE_GRID.y;
// Entries of the normal equations: the lower triangle of the matrix, then the right-hand side.
static const uint TRIANGLE = 66;
static const uint ENTRIES = 77;

// Per sample: position in both anchors as double floats (x, then y), and inverse depth. Lengths are in picture widths from the centre.
groupshared float4 CurrentPosition[SAMPLES];
groupshared float4 PreviousPosition[SAMPLES];
groupshared float2 InverseDepth[SAMPLES];
groupshared uint IsValid[SAMPLES];
groupshared uint IsInlier[SAMPLES];
// Normal equations of the fit and of each trial; the right-hand side becomes the solution.
groupshared float2 Entries[CAMERA_FIT_RANSAC_TRIALS + 1][ENTRIES];
groupshared uint Inliers[CAMERA_FIT_RANSAC_TRIALS + 1];
groupshared uint Count;
groupshared uint IsFound;
groupshared uint Nearest;
groupshared uint Farthest;
groupshared uint2 ChangeRange;

// Coefficient of parameter `k` in the equation of one component.
float2 coefficient(uint sample, uint component, uint k)
{
    float4 at = CurrentPosition[sample];
    float2 previous = component == 0 ? PreviousPosition[sample].xy : PreviousPosition[sample].zw;
    uint of = k < 8 ? k - 4 * component : k - 8;
    float2 plain = of == 0 ? at.xy : of == 1 ? at.zw : k < 8 && of == 2 ? float2(1, 0) : InverseDepth[sample];
    float2 scaled = -multiplied(previous, plain);
    return k < 8 ? plain : scaled;
}

float2 right_hand_side(uint sample, uint component)
{
    return component == 0 ? added(PreviousPosition[sample].xy, -CurrentPosition[sample].xy)
                          : added(PreviousPosition[sample].zw, -CurrentPosition[sample].zw);
}

// Row and column of an entry of the triangle.
uint2 entry_of(uint entry)
{
    uint row = 0;
    [unroll]
    for (uint next = 1; next < CAMERA_FIT_PARAMETERS; next++)
    {
        row += entry >= next * (next + 1) / 2 ? 1 : 0;
    }
    return uint2(row, entry - row * (row + 1) / 2);
}

// Whether parameter `k` occurs in the equation of a component.
bool has_coefficient(uint component, uint k)
{
    return k >= 8 || k / 4 == component;
}

// Contribution of a sample to an entry.
float2 product_of(uint sample, uint number, uint2 entry)
{
    float2 sum = 0;
    [loop]
    for (uint component = 0; component < 2; component++)
    {
        bool is_right = number >= TRIANGLE;
        uint row = is_right ? number - TRIANGLE : entry.x;
        if (has_coefficient(component, row) && (is_right || has_coefficient(component, entry.y)))
        {
            float2 a = coefficient(sample, component, row);
            float2 b = is_right ? right_hand_side(sample, component) : coefficient(sample, component, entry.y);
            sum = added(sum, multiplied(a, b));
        }
    }
    return sum;
}

float parameter(uint solver, uint k)
{
    return Entries[solver][TRIANGLE + k].x;
}

float2 exact_parameter(uint k)
{
    return Entries[0][TRIANGLE + k];
}

// `w0 / w1 - 1` of a sample.
float change(uint sample, uint solver)
{
    return parameter(solver, 8) * CurrentPosition[sample].x + parameter(solver, 9) * CurrentPosition[sample].z
        + parameter(solver, 10) * InverseDepth[sample].x;
}

// Squared distance between a sample's previous position and the one that the parameters predict.
float error_of(uint sample, uint solver)
{
    float2 at = CurrentPosition[sample].xz;
    float2 previous = PreviousPosition[sample].xz;
    float inverse_depth = InverseDepth[sample].x;
    float by = change(sample, solver);
    float2 moved = float2(parameter(solver, 0), parameter(solver, 4)) * at.x + float2(parameter(solver, 1), parameter(solver, 5)) * at.y
        + float2(parameter(solver, 2), parameter(solver, 6)) + float2(parameter(solver, 3), parameter(solver, 7)) * inverse_depth;
    float2 shift = float2(right_hand_side(sample, 0).x, right_hand_side(sample, 1).x);
    float2 difference = (moved - shift - previous * by) / (1 + by);
    return dot(difference, difference);
}

[numthreads(256, 1, 1)]
void main(uint thread : SV_GroupIndex)
{
    uint i;
    if (thread == 0)
    {
        Count = 0;
        Nearest = 0;
        Farthest = asuint(1.0);
        IsFound = 0;
        ChangeRange = 0;
    }
    GroupMemoryBarrierWithGroupSync();

    // Samples, compacted in their order.
    bool is_valid = false;
    float2 motion = 0;
    float depth = 0;
    uint2 pixel_at = 0;
    if (thread < SAMPLES)
    {
        pixel_at = (2 * uint2(thread % CAMERA_FIT_SAMPLE_GRID.x, thread / CAMERA_FIT_SAMPLE_GRID.x) + 1) * Size / (2 * CAMERA_FIT_SAMPLE_GRID);
        motion = Motion.Load(int3(pixel_at / GuidanceTiles.x, 0));
        depth = Depth.Load(int3(pixel_at / GuidanceTiles.y, 0));
        is_valid = all((asuint(motion) & 0x7f800000) != 0x7f800000) && depth >= 0 && depth <= 1;
        is_valid = is_valid && !is_in_static_mask(int2(pixel_at));
        is_valid = is_valid && all(Size >= CAMERA_FIT_SAMPLE_GRID) && !is_cut();
        IsValid[thread] = is_valid ? 1 : 0;
    }
    GroupMemoryBarrierWithGroupSync();
    if (is_valid)
    {
        uint slot = 0;
        [loop]
        for (i = 0; i < thread; i++)
        {
            slot += IsValid[i];
        }
        float2 width = float2(float(Size.x), 0);
        float2 center = float2(pixel_at / GuidanceTiles.x * GuidanceTiles.x) + float(GuidanceTiles.x - 1) / 2;
        center -= float2(Size - 1) / 2;
        float2 x = float2(center.x, 0);
        float2 y = float2(center.y, 0);
        CurrentPosition[slot] = float4(divided(x, width), divided(y, width));
        PreviousPosition[slot] = float4(divided(two_sum(center.x, motion.x), width), divided(two_sum(center.y, motion.y), width));
        float inverse_depth = 1 - depth;
        InverseDepth[slot] = float2(inverse_depth, 0);
        IsInlier[slot] = 1;
        InterlockedMax(Nearest, asuint(inverse_depth));
        InterlockedMin(Farthest, asuint(inverse_depth));
        InterlockedAdd(Count, 1);
    }
    GroupMemoryBarrierWithGroupSync();
    uint samples = Count;
    float2 nearest_depth = float2(asfloat(Nearest), 0);
    // Without depth, forward motion cannot be told from a zoom.
    precise float three_quarters = 0.75 * nearest_depth.x;
    bool has_depth = asfloat(Farthest) < three_quarters;
    if (thread < samples)
    {
        float2 scaled = 0;
        if (has_depth)
        {
            scaled = divided(InverseDepth[thread], nearest_depth);
        }
        InverseDepth[thread] = scaled;
    }
    GroupMemoryBarrierWithGroupSync();
    float within = CAMERA_FIT_INLIER_DISTANCE / float(Size.x);
    float bound = within * within;
    uint2 entry = entry_of(min(thread, TRIANGLE - 1));

    // Always 0, but unknown to the compiler, which would otherwise unroll these loops.
    uint none = IsPair >> 1;
    uint stages = 3 - none;
    uint parameters = CAMERA_FIT_PARAMETERS - none;

    // The first stage fits all samples and all trials; two more refit the inliers.
    [loop]
    for (uint stage = none; stage < stages; stage++)
    {
        if (thread < ENTRIES)
        {
            float2 sum = 0;
            [loop]
            for (i = 0; i < samples; i++)
            {
                if (IsInlier[i] != 0)
                {
                    sum = added(sum, product_of(i, thread, entry));
                }
            }
            Entries[0][thread] = sum;
        }
        GroupMemoryBarrierWithGroupSync();
        uint solvers = stage == 0 ? CAMERA_FIT_RANSAC_TRIALS + 1 : 1;
        if (thread < solvers && samples > 0)
        {
            [loop]
            for (i = 0; i < ENTRIES && thread > 0; i++)
            {
                uint2 row_column = entry_of(min(i, TRIANGLE - 1));
                float2 sum = 0;
                [loop]
                for (uint from = 0; from < CAMERA_FIT_TRIAL_SAMPLES; from++)
                {
                    sum = added(sum, product_of(CAMERA_FIT_RANDOM[CAMERA_FIT_TRIAL_SAMPLES * (thread - 1) + from] % samples, i, row_column));
                }
                Entries[thread][i] = sum;
            }
            // Cholesky decomposition.
            [loop]
            for (uint row = none; row < parameters; row++)
            {
                uint of_row = row * (row + 1) / 2;
                // Tikhonov regularisation: keeps parameters near zero that the samples do not determine.
                Entries[thread][of_row + row] = added(Entries[thread][of_row + row], float2(9.99999997e-7, 2.5248e-14));
                [loop]
                for (uint column = none; column <= row; column++)
                {
                    uint of_column = column * (column + 1) / 2;
                    float2 sum = Entries[thread][of_row + column];
                    [loop]
                    for (uint k = 0; k < column; k++)
                    {
                        sum = added(sum, -multiplied(Entries[thread][of_row + k], Entries[thread][of_column + k]));
                    }
                    bool is_last = column == row;
                    float2 result = is_last ? root(sum) : divided(sum, Entries[thread][of_column + column]);
                    Entries[thread][of_row + column] = result;
                }
                float2 right = Entries[thread][TRIANGLE + row];
                [loop]
                for (uint k = 0; k < row; k++)
                {
                    right = added(right, -multiplied(Entries[thread][of_row + k], Entries[thread][TRIANGLE + k]));
                }
                Entries[thread][TRIANGLE + row] = divided(right, Entries[thread][of_row + row]);
            }
            bool is_solved = true;
            [loop]
            for (uint up = none; up < parameters; up++)
            {
                uint of = CAMERA_FIT_PARAMETERS - 1 - up;
                float2 right = Entries[thread][TRIANGLE + of];
                [loop]
                for (uint k = of + 1; k < parameters; k++)
                {
                    right = added(right, -multiplied(Entries[thread][k * (k + 1) / 2 + of], Entries[thread][TRIANGLE + k]));
                }
                float2 result = divided(right, Entries[thread][of * (of + 1) / 2 + of]);
                Entries[thread][TRIANGLE + of] = result;
                is_solved = is_solved && (asuint(result.x) & 0x7f800000) != 0x7f800000;
            }
            uint inliers = 0;
            [loop]
            for (i = 0; i < samples; i++)
            {
                inliers += error_of(i, thread) <= bound ? 1 : 0;
            }
            // The number of inliers plus one; 0 for no solution.
            Inliers[thread] = is_solved ? inliers + 1 : 0;
        }
        GroupMemoryBarrierWithGroupSync();
        if (thread == 0)
        {
            uint best = 0;
            uint max_inliers = Inliers[0];
            bool has_failed = samples * 2 < SAMPLES || max_inliers == 0 || stage > 0 && IsFound == 0;
            [loop]
            for (uint trial = 1; trial < solvers && 10 * (max_inliers - 1) < 9 * samples; trial++)
            {
                if (Inliers[trial] > max_inliers)
                {
                    best = trial;
                    max_inliers = Inliers[trial];
                }
            }
            [loop]
            for (i = 0; i < CAMERA_FIT_PARAMETERS; i++)
            {
                Entries[0][TRIANGLE + i] = Entries[best][TRIANGLE + i];
            }
            IsFound = has_failed || stage == 2 && 2 * (max_inliers - 1) < samples ? 0 : 1;
        }
        GroupMemoryBarrierWithGroupSync();
        if (thread < samples)
        {
            bool is_inlier = error_of(thread, 0) <= bound;
            IsInlier[thread] = is_inlier ? 1 : 0;
            if (stage == 2 && is_inlier)
            {
                // The bits of floats of one sign are ordered like their values.
                float by = change(thread, 0);
                if (by < 0)
                {
                    InterlockedMax(ChangeRange.x, asuint(-by));
                }
                else
                {
                    InterlockedMax(ChangeRange.y, asuint(by));
                }
            }
        }
        GroupMemoryBarrierWithGroupSync();
    }
    if (thread != 0 || IsFound == 0)
    {
        return;
    }
    float2 width = float2(float(Size.x), 0);
    float2 middle = float2(Size - 1) / 2;
    float2 across = divided(exact_parameter(8), width);
    float2 down = divided(exact_parameter(9), width);
    float2 corner = added(-multiplied(across, float2(middle.x, 0)), -multiplied(down, float2(middle.y, 0)));
    float2 per_inverse_depth = 0;
    if (has_depth)
    {
        per_inverse_depth = divided(exact_parameter(10), nearest_depth);
    }
    float min_change = min(max(-1.25 * asfloat(ChangeRange.x) - 0.02, -0.5), 0.9);
    float max_change = min(max(1.25 * asfloat(ChangeRange.y) + 0.02, -0.5), 0.9);
    Small.Store4(DEPTH_CHANGE, asuint(float4(per_inverse_depth.x, across.x, down.x, corner.x)));
    Small.Store2(DEPTH_CHANGE + 16, asuint(float2(min_change, max_change)));
    if (!has_depth)
    {
        return;
    }
    // Projection from the previous anchor to the current one: the inverse of the 3x3 part, and the column of the inverse depth.
    float2 one = float2(1, 0);
    float2 a[9] = { added(exact_parameter(0), one), exact_parameter(1), exact_parameter(2), exact_parameter(4), added(exact_parameter(5), one),
        exact_parameter(6), exact_parameter(8), exact_parameter(9), one };
    float2 minors[9];
    [loop]
    for (uint m = 0; m < 9; m++)
    {
        uint2 r = uint2((m / 3 + 1) % 3, (m / 3 + 2) % 3);
        uint2 c = uint2((m % 3 + 1) % 3, (m % 3 + 2) % 3);
        float2 first = multiplied(a[3 * r.x + c.x], a[3 * r.y + c.y]);
        minors[m] = added(first, -multiplied(a[3 * r.x + c.y], a[3 * r.y + c.x]));
    }
    float2 determinant = added(added(multiplied(a[0], minors[0]), multiplied(a[1], minors[1])), multiplied(a[2], minors[2]));
    bool is_finite = true;
    [loop]
    for (uint r = 0; r < 3; r++)
    {
        float4 row = 0;
        float2 per_inverse_depth_row = 0;
        [unroll]
        for (uint c = 0; c < 3; c++)
        {
            float2 inverse = divided(minors[3 * c + r], determinant);
            float2 counts = c == 0 ? exact_parameter(3) : c == 1 ? exact_parameter(7) : exact_parameter(10);
            per_inverse_depth_row = added(per_inverse_depth_row, -multiplied(inverse, divided(counts, nearest_depth)));
            row[c] = inverse.x;
        }
        row.w = per_inverse_depth_row.x;
        is_finite = is_finite && all((asuint(row) & 0x7f800000) != 0x7f800000);
        Small.Store4(REPROJECTION + 16 * r, asuint(row));
    }
    Small.Store(HAS_REPROJECTION, is_finite ? 1 : 0);
}
