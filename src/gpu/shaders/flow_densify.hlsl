// Dense motion from patches: bilinear where motion is continuous; elsewhere the motion of the window that matches best in the 5 x 5 pixels
// around each pixel. A group per block of 8 x 8 pixels.

#include "constants.hlsli"
#include "flow.hlsli"

// Pixels that are compared around each.
static const float WINDOW = (2 * DENSE_RADIUS + 1) * (2 * DENSE_RADIUS + 1);

groupshared float2 Flow[16];
groupshared float Brightening[16];
groupshared uint HasDiscontinuity;
groupshared uint Candidates[DENSE_MAX_CANDIDATES];
groupshared uint Count;
groupshared float Differences[2][DENSE_BLOCK_WITH_MARGIN * DENSE_BLOCK_WITH_MARGIN];

float2 smooth_at(uint direction, int2 cell)
{
    uint2 position = uint2(clamp(cell, 0, int2(Cells) - 1));
    return motion_at(of_two(AtFlow, direction), position.y * Cells.x + position.x);
}

// Whether motion is discontinuous at a cell between two opposite neighbours.
bool is_discontinuous(float2 own, float2 one, float2 other)
{
    precise float2 deviation = abs(0.5 * (one + other) - own);
    return any(deviation > GRID_DISCONTINUITY * float(Stride));
}

// The two cells between which pixel `x` of eight is interpolated.
void taps_of(uint x, out uint closer, out uint farther, out float weight)
{
    uint cell = x / Stride;
    float within = float(x - cell * Stride) + 0.5 - 0.5 * float(Stride);
    closer = 1 + cell;
    farther = within < 0 ? cell : 2 + cell;
    weight = abs(within) / float(Stride);
}

// Weight of a cell for a pixel along one axis: a tent of two cells to each side.
float tent(uint closer, uint farther, float weight, uint cell)
{
    float at = float(closer) + (farther > closer ? weight : -weight);
    return max(2 - abs(at - float(cell)), 0);
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 of_group : SV_GroupThreadID, uint index : SV_GroupIndex)
{
    uint direction = Direction + group.z;
    uint from = of_two(AtLuma, start_of(direction));
    uint to = of_two(AtLuma, 1 - start_of(direction));
    uint side = Stride == 8 ? 3 : 4;
    if (index < DENSE_MAX_CANDIDATES)
    {
        Candidates[index] = 0;
    }
    if (index == 0)
    {
        HasDiscontinuity = 0;
        Count = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    if (index < side * side)
    {
        int2 cell = int2(group.xy * (8 / Stride) + uint2(index % side, index / side)) - 1;
        cell = clamp(cell, 0, int2(Cells) - 1);
        float2 own = smooth_at(direction, cell);
        Flow[index] = own;
        Brightening[index] = asfloat(Work.Load(of_two(AtFound, direction) + 32 * (uint(cell.y) * Cells.x + uint(cell.x)) + 8));
        bool is_across = is_discontinuous(own, smooth_at(direction, cell - int2(1, 0)), smooth_at(direction, cell + int2(1, 0)));
        if (is_across || is_discontinuous(own, smooth_at(direction, cell - int2(0, 1)), smooth_at(direction, cell + int2(0, 1))))
        {
            InterlockedOr(HasDiscontinuity, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0 && HasDiscontinuity != 0)
    {
        // Distinct motions of the window.
        uint count = 0;
        [loop]
        for (uint k = 0; k < side * side && count < DENSE_MAX_CANDIDATES; k++)
        {
            uint cell = side == 3 ? DENSE_ORDER_OF_9[min(k, 8)] : DENSE_ORDER_OF_16[k];
            bool is_new = true;
            [unroll]
            for (uint other = 0; other + 1 < DENSE_MAX_CANDIDATES; other++)
            {
                is_new = is_new && (other >= count || !is_near(Flow[Candidates[other]], Flow[cell], DENSE_MERGE_DISTANCE));
            }
            if (is_new)
            {
                Candidates[count] = cell;
                count++;
            }
        }
        Count = count;
    }
    GroupMemoryBarrierWithGroupSync();

    // Matching difference of each candidate around this pixel.
    int2 corner = int2(group.xy) * DENSE_BLOCK - DENSE_RADIUS;
    uint chosen = 0;
    float least = asfloat(0x7f7fffff);
    [loop]
    for (uint number = 0; number < DENSE_MAX_CANDIDATES; number++)
    {
        bool is_compared = number < Count;
        [branch]
        if (is_compared)
        {
            uint cell = Candidates[number];
            float2 flow = Flow[cell];
            int2 whole = int2(floor(min(max(flow, -WIDE_FAR), WIDE_FAR)));
            precise float2 fraction = flow - float2(whole);
            [loop]
            for (uint k = index; k < DENSE_BLOCK_WITH_MARGIN * DENSE_BLOCK_WITH_MARGIN; k += 64)
            {
                int2 position = corner + int2(uint2(k % DENSE_BLOCK_WITH_MARGIN, k / DENSE_BLOCK_WITH_MARGIN));
                int2 there = position + whole;
                float above = lerp_exact(luma_at(to, there), luma_at(to, there + int2(1, 0)), fraction.x);
                float below = lerp_exact(luma_at(to, there + int2(0, 1)), luma_at(to, there + int2(1, 1)), fraction.x);
                precise float difference = abs(above + (below - above) * fraction.y - luma_at(from, position) - Brightening[cell]);
                Differences[number & 1][k] = is_in_level(there) ? min(difference, DENSE_MAX_DIFFERENCE) : DENSE_OUTSIDE_DIFFERENCE;
            }
        }
        GroupMemoryBarrierWithGroupSync();
        if (is_compared)
        {
            uint first = of_group.y * DENSE_BLOCK_WITH_MARGIN + of_group.x;
            precise float sum = 0;
            for (uint x = 0; x < 5; x++)
            {
                precise float of_column = 0;
                for (uint y = 0; y < 5; y++)
                {
                    of_column += Differences[number & 1][first + y * DENSE_BLOCK_WITH_MARGIN + x];
                }
                sum += of_column;
            }
            chosen = sum < least ? Candidates[number] : chosen;
            least = min(sum, least);
        }
    }

    uint2 closer, farther;
    float2 weight;
    taps_of(of_group.x, closer.x, farther.x, weight.x);
    taps_of(of_group.y, closer.y, farther.y, weight.y);
    float2 motion;
    [branch]
    if (HasDiscontinuity != 0)
    {
        // Weighted mean over the cells of the chosen candidate's surface.
        float2 own = Flow[chosen];
        precise float weights = 1e-6;
        precise float2 sums = 0;
        [loop]
        for (uint cell = 0; cell < side * side; cell++)
        {
            precise float2 difference = Flow[cell] - own;
            if (max(abs(difference.x), abs(difference.y)) < DENSE_SAME_SURFACE)
            {
                precise float weight_of_cell =
                    tent(closer.x, farther.x, weight.x, cell % side) * tent(closer.y, farther.y, weight.y, cell / side);
                weights += weight_of_cell;
                sums += weight_of_cell * difference;
            }
        }
        precise float2 of_surface = sums / weights + own;
        motion = of_surface;
    }
    else
    {
        float2 above, below;
        [unroll]
        for (uint axis = 0; axis < 2; axis++)
        {
            above[axis] = lerp_exact(Flow[closer.y * side + closer.x][axis], Flow[closer.y * side + farther.x][axis], weight.x);
            below[axis] = lerp_exact(Flow[farther.y * side + closer.x][axis], Flow[farther.y * side + farther.x][axis], weight.x);
        }
        motion = float2(lerp_exact(above.x, below.x, weight.y), lerp_exact(above.y, below.y, weight.y));
    }
    uint2 at = group.xy * 8 + of_group.xy;
    if (all(at < Level))
    {
        uint pixel = at.y * Level.x + at.x;
        Work.Store2(of_two(AtDense, direction) + 8 * pixel, asuint(motion));
        if (direction == BACK)
        {
            Work.Store(AtTrusted + 4 * pixel, HasDiscontinuity == 0 || least <= DENSE_MISMATCH * WINDOW ? 1 : 0);
        }
    }
}
