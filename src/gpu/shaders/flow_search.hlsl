// Patch search: the best of several starts, then inverse compositional descent from it. Eight threads per patch, one column each; all
// groups run the same number of iterations, as barriers need all threads.

#include "constants.hlsli"
#include "flow.hlsli"

static const uint PATCHES = 8;
static const uint STARTS = 7;
static const uint STARTS_AGAIN = 6;
static const float NO_RESIDUAL = 1000000;

groupshared float2 Starts[PATCHES][PATCH_SIDE];
groupshared float4 Columns[2][PATCHES * PATCH_SIDE];

// Sum over a patch of its threads' columns, as a tree. Two calls with one `turn` need another call between them.
float4 summed(uint turn, uint thread, float4 of_column)
{
    Columns[turn][thread] = of_column;
    GroupMemoryBarrierWithGroupSync();
    uint first = thread & ~7u;
    precise float4 even = (Columns[turn][first] + Columns[turn][first + 4]) + (Columns[turn][first + 2] + Columns[turn][first + 6]);
    precise float4 odd = (Columns[turn][first + 1] + Columns[turn][first + 5]) + (Columns[turn][first + 3] + Columns[turn][first + 7]);
    precise float4 sum = even + odd;
    return sum;
}

// How many of eight consecutive pixels starting at `a` and at `b` are both inside `len`.
float overlap_of(int a, int b, int len)
{
    int low = max(max(-a, -b), 0);
    int high = min(min(len - a, len - b), int(PATCH_SIDE));
    return float(max(high - low, 0));
}

float2 smooth_at(uint direction, int2 cell)
{
    return motion_at(of_two(AtFlow, direction), uint(cell.y) * Cells.x + uint(cell.x));
}

bool is_cell(int2 cell)
{
    return all(cell >= 0) && all(cell < int2(Cells));
}

float2 middle_of(uint2 cell)
{
    precise float2 middle = (float2(cell) + 0.5) * float(Stride);
    return middle;
}

// Start number `which` of a repeated search: the smoothed motion, the global motion, and the neighbours' motion, extrapolated.
float2 refined_start(uint direction, uint2 at, uint which)
{
    int2 cell = int2(at);
    float2 start = smooth_at(direction, cell);
    if (which == 1)
    {
        float2 global;
        bool has_match = global_motion_at(of_two(AtModel, direction), Cells * Stride, 1, middle_of(at), global);
        start = has_match ? global : start;
    }
    else if (which > 1)
    {
        int2 step = which == 2 ? int2(-1, 0) : which == 3 ? int2(1, 0) : which == 4 ? int2(0, -1) : int2(0, 1);
        if (is_cell(cell + step))
        {
            start = smooth_at(direction, cell + step);
            if (is_cell(cell + 2 * step))
            {
                precise float2 slope = start - smooth_at(direction, cell + 2 * step);
                precise float2 on = start + slope;
                start = max(abs(slope.x), abs(slope.y)) < GRID_MAX_EXTRAPOLATED_STEP ? on : start;
            }
        }
    }
    return start;
}

float2 coarse_at(uint direction, int2 cell)
{
    uint2 position = uint2(clamp(cell, 0, int2(CoarseCells) - 1));
    return 2 * motion_at(of_two(AtCoarseFlow, direction), position.y * CoarseCells.x + position.x);
}

// Start number `which` of a first search: the coarser level's motion, the global motion, motion of adjacent cells, zero.
float2 first_start(uint direction, uint2 cell, uint which)
{
    float2 start = 0;
    if (CoarseCells.x == 0)
    {
        return start;
    }
    if (which == 1)
    {
        float2 global;
        bool has_match = global_motion_at(of_two(AtModel, direction), CoarseCells * CoarseStride, 2, middle_of(cell), global);
        start = has_match ? global : start;
    }
    else if (Stride == 2 * CoarseStride)
    {
        int2 step = which == 2 ? int2(-1, 0) : which == 3 ? int2(1, 0) : which == 4 ? int2(0, -1) : which == 5 ? int2(0, 1) : 0;
        if (which < 6)
        {
            start = coarse_at(direction, int2(cell) + step);
        }
    }
    else if (which < 5)
    {
        int2 own = int2(cell / 2);
        int2 other = own + ((cell & 1) == 0 ? -1 : 1);
        start = coarse_at(direction, int2(which == 2 || which == 4 ? other.x : own.x, which == 3 || which == 4 ? other.y : own.y));
    }
    return start;
}

[numthreads(PATCHES * PATCH_SIDE, 1, 1)]
void main(uint3 group : SV_GroupID, uint thread : SV_GroupIndex)
{
    uint direction = Direction + group.z;
    uint from = of_two(AtLuma, start_of(direction));
    uint to = of_two(AtLuma, 1 - start_of(direction));
    uint patch = thread >> 3;
    int column = int(thread & 7);
    uint number = group.x * PATCHES + patch;
    bool is_cell_inside = number < Cells.x * Cells.y;
    number = is_cell_inside ? number : 0;
    uint2 cell = uint2(number % Cells.x, number / Cells.x);
    int2 origin = int2(cell * Stride) - int((PATCH_SIDE - Stride) / 2);
    int2 level = int2(Level);

    // Template: lumas and centred gradients, without pixels outside the picture.
    bool is_whole = all(origin >= 1) && all(origin + int(PATCH_SIDE) + 1 <= level);
    float own_count = overlap_of(origin.x, origin.x, level.x) * overlap_of(origin.y, origin.y, level.y);
    bool is_column = origin.x + column >= 0 && origin.x + column < level.x;
    float value[8];
    float across[8];
    float down[8];
    float4 sums = 0;
    float above = luma_at(from, origin + int2(column, -1));
    float own = luma_at(from, origin + int2(column, 0));
    [unroll]
    for (int j = 0; j < 8; j++)
    {
        float below = luma_at(from, origin + int2(column, j + 1));
        float left = luma_at(from, origin + int2(column - 1, j));
        float right = luma_at(from, origin + int2(column + 1, j));
        float counts = is_column && origin.y + j >= 0 && origin.y + j < level.y ? 1 : 0;
        value[j] = own;
        precise float gx = (right - left) * 0.5;
        precise float gy = (below - above) * 0.5;
        across[j] = gx;
        down[j] = gy;
        precise float4 added = sums + float4(own, gx, gy, 0) * counts;
        sums = added;
        above = own;
        own = below;
    }
    sums = summed(0, thread, sums);
    precise float4 quotients = sums / own_count;
    precise float4 parts = sums * (1 / PATCH_AREA);
    float4 means = is_whole ? parts : quotients;
    float4 squares = 0;
    [unroll]
    for (int k = 0; k < 8; k++)
    {
        float counts = is_column && origin.y + k >= 0 && origin.y + k < level.y ? 1 : 0;
        precise float gx = (across[k] - means.y) * counts;
        precise float gy = (down[k] - means.z) * counts;
        across[k] = gx;
        down[k] = gy;
        precise float4 added = squares + float4(gx * gx, gx * gy, gy * gy, 0);
        squares = added;
    }
    squares = summed(1, thread, squares);
    precise float4 divided = squares / own_count;
    precise float4 shared_out = squares * (1 / PATCH_AREA);
    float3 hessian = is_whole ? shared_out.xyz : divided.xyz;

    // Starts.
    uint count = IsAgain != 0 ? STARTS_AGAIN : CoarseCells.x == 0 ? 1 : STARTS;
    uint position = of_two(AtFound, direction) + 32 * number;
    float2 found = 0;
    [branch]
    if (IsAgain != 0)
    {
        found = asfloat(Work.Load2(position));
        Starts[patch][column] = refined_start(direction, cell, uint(column));
    }
    else
    {
        Starts[patch][column] = first_start(direction, cell, uint(column));
    }
    GroupMemoryBarrierWithGroupSync();
    bool is_kept = IsAgain != 0;
    for (uint s = 0; s < STARTS_AGAIN; s++)
    {
        is_kept = is_kept && is_near(Starts[patch][s], found, PATCH_SAME_START);
    }
    bool is_searched = is_cell_inside && !is_kept;

    precise float xx = hessian.x + PATCH_DAMPING;
    precise float yy = hessian.z + PATCH_DAMPING;
    precise float xy = hessian.y;
    precise float determinant = xx * yy - xy * xy;
    precise float reciprocal = 1 / determinant;
    float2 flow = Starts[patch][0];
    float2 descended_from = flow;
    float2 slope = 0;
    float residual = 0;
    float brightening = 0;
    bool has_match = false;
    bool is_done = false;
    [loop]
    for (uint turn = 0; turn < STARTS + PATCH_MAX_STEPS; turn++)
    {
        bool is_start = turn < STARTS;
        float2 next = Starts[patch][min(turn, PATCH_SIDE - 1)];
        bool is_tried = is_searched && turn < count;
        if (is_start)
        {
            [unroll]
            for (uint earlier = 0; earlier + 1 < STARTS; earlier++)
            {
                is_tried = is_tried && (earlier >= turn || !is_near(next, Starts[patch][earlier], PATCH_SAME_START));
            }
        }
        else
        {
            descended_from = turn == STARTS ? flow : descended_from;
            precise float2 step = float2((yy * slope.x - xy * slope.y) * reciprocal, (xx * slope.y - xy * slope.x) * reciprocal);
            precise float2 on = flow - step;
            next = on;
            bool continues = is_searched && has_match && !is_done;
            bool has_converged = max(abs(step.x), abs(step.y)) < PATCH_CONVERGED_STEP;
            float2 distance = abs(next - descended_from);
            bool is_too_far = max(distance.x, distance.y) > float(PATCH_SIDE);
            flow = continues && has_converged ? next : flow;
            is_tried = continues && !has_converged && !is_too_far;
            is_done = is_done || !is_tried;
        }

        // Compares the template with the other picture.
        int2 whole_pixels = int2(floor(min(max(next, -WIDE_FAR), WIDE_FAR)));
        precise float2 part = next - float2(whole_pixels);
        int2 there = origin + whole_pixels;
        bool is_inside = is_whole && all(there >= 0) && all(there + int(PATCH_SIDE) + 1 <= level);
        float overlap = overlap_of(origin.x, there.x, level.x) * overlap_of(origin.y, there.y, level.y);
        bool is_comparable = is_tried && overlap > 0 && overlap >= min(PATCH_MIN_OVERLAP, own_count);
        bool is_shared = is_column && there.x + column >= 0 && there.x + column < level.x;
        float difference[8];
        float counted[8];
        float4 of_column = 0;
        {
            [unroll]
            for (int c = 0; c < 8; c++)
            {
                difference[c] = 0;
                counted[c] = 0;
            }
        }
        [branch]
        if (is_comparable)
        {
            float upper = lerp_exact(luma_at(to, there + int2(column, 0)), luma_at(to, there + int2(column + 1, 0)), part.x);
            [unroll]
            for (int d = 0; d < 8; d++)
            {
                int2 below = there + int2(column, d + 1);
                float lower = lerp_exact(luma_at(to, below), luma_at(to, below + int2(1, 0)), part.x);
                precise float value_difference = upper + (lower - upper) * part.y - value[d];
                bool is_row = all(int2(origin.y, there.y) + d >= 0) && all(int2(origin.y, there.y) + d < level.y);
                difference[d] = value_difference;
                counted[d] = is_inside || is_shared && is_row ? 1 : 0;
                precise float counts = value_difference * counted[d];
                precise float4 added = of_column
                    + float4(counts, value_difference * value_difference, across[d] * value_difference, down[d] * value_difference);
                of_column = added;
                upper = lower;
            }
        }
        float4 all_of = summed(0, thread, of_column);
        precise float4 mean_of = all_of * (1 / PATCH_AREA);
        precise float at_edge = all_of.x / max(overlap, 1);
        float mean = is_inside ? mean_of.x : at_edge;
        of_column = 0;
        [unroll]
        for (int e = 0; e < 8; e++)
        {
            precise float centred = (difference[e] - mean) * counted[e];
            precise float4 added = of_column + float4(centred * centred, across[e] * centred, down[e] * centred, 0);
            of_column = added;
        }
        float4 edge_of = summed(1, thread, of_column);
        precise float4 edge_mean = edge_of / max(overlap, 1);
        precise float variance = mean_of.y - mean * mean;
        float next_residual = is_inside ? max(variance, 0) : edge_mean.x;

        // An earlier start wins unless a later one is clearly better; a descent step must not be worse.
        precise float compared = next_residual + (is_start ? PATCH_MIN_IMPROVEMENT : 0);
        bool is_number = next_residual < NO_RESIDUAL * NO_RESIDUAL;
        bool is_better = is_comparable && is_number && (!has_match || compared < residual);
        is_done = is_done || !is_start && !is_better;
        flow = is_better ? next : flow;
        slope = is_better ? (is_inside ? mean_of.zw : edge_mean.yz) : slope;
        residual = is_better ? next_residual : residual;
        brightening = is_better ? mean : brightening;
        has_match = has_match || is_better;
    }
    if (is_searched && column == 0)
    {
        Work.Store4(position, asuint(float4(flow, brightening, has_match ? residual : NO_RESIDUAL)));
        Work.Store4(position + 16, asuint(float4(hessian, means.x)));
    }
}
