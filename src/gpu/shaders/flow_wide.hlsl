// Exhaustive search for patches with a poor match: all whole-pixel motions around it. One that matches clearly better than the others, in
// both directions, is used. A group per patch; each thread compares the whole patch at some of the motions.

#include "constants.hlsli"
#include "flow.hlsli"

static const uint THREADS = 64;
static const int SIDE = PATCH_SIDE;
static const int DIAMETER = 2 * WIDE_RADIUS + 1;
static const uint MOTIONS = DIAMETER * DIAMETER;
static const int REGION = SIDE + 2 * WIDE_RADIUS;
// Residual of motions that lead outside the picture: more than any other.
static const float NONE = 3.0e38;

groupshared float Own[SIDE * SIDE];
groupshared float Region[REGION * REGION];
groupshared float Residuals[MOTIONS];
groupshared float MinResidual[THREADS];
groupshared uint MinIndex[THREADS];

struct Best
{
    int2 motion;
    float residual;
    float brightening;
    float second_residual; // smallest residual of motions more than a pixel away
};

bool is_patch_inside(int2 at)
{
    return all(at >= 0) && all(at + SIDE <= int2(Level));
}

// Sum of a patch's columns, as a tree.
float tree_sum(float columns[8])
{
    precise float even = (columns[0] + columns[4]) + (columns[2] + columns[6]);
    precise float odd = (columns[1] + columns[5]) + (columns[3] + columns[7]);
    precise float sum = even + odd;
    return sum;
}

// Variance of the differences between the patch and the one at (column, row) of the region; also their mean.
float residual_at(int column, int row, out float mean)
{
    float sums[8];
    float squares[8];
    [unroll]
    for (int x = 0; x < SIDE; x++)
    {
        sums[x] = 0;
        squares[x] = 0;
    }
    [loop]
    for (int y = 0; y < SIDE; y++)
    {
        [unroll]
        for (int i = 0; i < SIDE; i++)
        {
            precise float difference = Region[(row + y) * REGION + column + i] - Own[y * SIDE + i];
            precise float sum = sums[i] + difference;
            precise float square = squares[i] + difference * difference;
            sums[i] = sum;
            squares[i] = square;
        }
    }
    precise float middle = tree_sum(sums) * (1 / PATCH_AREA);
    precise float variance = tree_sum(squares) * (1 / PATCH_AREA) - middle * middle;
    mean = middle;
    return max(variance, 0);
}

// The best motion of the patch at `origin` within WIDE_RADIUS of `start`. All threads of a group must call it; all get the result.
Best best_near(uint thread, bool is_wanted, uint from, uint to, int2 origin, int2 start)
{
    int2 corner = origin + start - WIDE_RADIUS;
    GroupMemoryBarrierWithGroupSync();
    [branch]
    if (is_wanted)
    {
        Own[thread] = luma_at(from, origin + int2(thread & 7, thread >> 3));
        [loop]
        for (uint k = thread; k < uint(REGION * REGION); k += THREADS)
        {
            Region[k] = luma_at(to, corner + int2(k % uint(REGION), k / uint(REGION)));
        }
    }
    GroupMemoryBarrierWithGroupSync();
    float min_residual = NONE;
    uint at = 0;
    [branch]
    if (is_wanted)
    {
        [loop]
        for (uint k = thread; k < MOTIONS; k += THREADS)
        {
            int2 offset = int2(k % uint(DIAMETER), k / uint(DIAMETER));
            float residual = NONE;
            [branch]
            if (is_patch_inside(corner + offset))
            {
                float mean;
                residual = residual_at(offset.x, offset.y, mean);
            }
            Residuals[k] = residual;
            bool is_less = residual < min_residual;
            min_residual = is_less ? residual : min_residual;
            at = is_less ? k : at;
        }
    }
    MinResidual[thread] = min_residual;
    MinIndex[thread] = at;
    GroupMemoryBarrierWithGroupSync();
    // For equal residuals the first in row order wins, as on the CPU.
    [loop]
    for (uint other = 0; other < THREADS; other++)
    {
        bool is_before = MinResidual[other] < min_residual || MinResidual[other] == min_residual && MinIndex[other] < at;
        min_residual = is_before ? MinResidual[other] : min_residual;
        at = is_before ? MinIndex[other] : at;
    }
    int2 position = int2(at % uint(DIAMETER), at / uint(DIAMETER));
    float second_residual = NONE;
    [branch]
    if (is_wanted)
    {
        [loop]
        for (uint k = thread; k < MOTIONS; k += THREADS)
        {
            int2 distance = abs(int2(k % uint(DIAMETER), k / uint(DIAMETER)) - position);
            second_residual = max(distance.x, distance.y) > 1 ? min(second_residual, Residuals[k]) : second_residual;
        }
    }
    GroupMemoryBarrierWithGroupSync();
    MinResidual[thread] = second_residual;
    GroupMemoryBarrierWithGroupSync();
    [loop]
    for (uint another = 0; another < THREADS; another++)
    {
        second_residual = min(second_residual, MinResidual[another]);
    }
    Best best;
    best.motion = start - WIDE_RADIUS + position;
    best.residual = min_residual;
    best.second_residual = second_residual;
    best.brightening = 0;
    [branch]
    if (is_wanted && min_residual < NONE)
    {
        residual_at(position.x, position.y, best.brightening);
    }
    return best;
}

[numthreads(THREADS, 1, 1)]
void main(uint3 group : SV_GroupID, uint thread : SV_GroupIndex)
{
    uint direction = Direction + group.z;
    uint from = of_two(AtLuma, start_of(direction));
    uint to = of_two(AtLuma, 1 - start_of(direction));
    int2 origin = int2(group.xy * Stride) - int((uint(SIDE) - Stride) / 2);
    uint position = of_two(AtFound, direction) + 32 * (group.y * Cells.x + group.x);
    float4 found = asfloat(Work.Load4(position));
    int2 start = int2(floor(min(max(found.xy + 0.5, -WIDE_FAR), WIDE_FAR)));
    bool is_wanted = found.w > WIDE_POOR && is_patch_inside(origin);
    Best best = best_near(thread, is_wanted, from, to, origin, start);
    precise float least_of_found = WIDE_MAX_RATIO * found.w;
    precise float least_of_second = WIDE_MAX_RATIO_TO_SECOND * best.second_residual;
    bool is_better = is_wanted && best.residual < min(least_of_found, least_of_second);
    Best back = best_near(thread, is_better, to, from, is_better ? origin + best.motion : 0, is_better ? -best.motion : 0);
    int2 return_error = abs(best.motion + back.motion);
    if (is_better && max(return_error.x, return_error.y) <= WIDE_MAX_RETURN_ERROR && thread == 0)
    {
        Work.Store4(position, asuint(float4(float2(best.motion), best.brightening, best.residual)));
    }
}
