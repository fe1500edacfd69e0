// From patches to pixels: bilinear between them where they lie on one smooth sheet; elsewhere of the motions around that which
// explains best the 5 x 5 pixels around each. A group to a block of 8 x 8 pixels.

#include "flow.hlsli"

static const int BLOCK = 8;
static const int REACH = 2;
static const uint WIDE = 12;
static const uint MOST = 8;
static const float SAME = 0.25;
static const float SURFACE = 1;
static const float MOST_UNLIKE = 20;
static const float OUTSIDE = 8;
static const float MISMATCH = 400;
static const float ROUGH = 0.5;
// Cells of a window, those nearest to its middle first.
static const uint ORDER_OF_9[9] = { 4, 3, 5, 1, 7, 0, 2, 6, 8 };
static const uint ORDER_OF_16[16] = { 5, 6, 9, 10, 1, 2, 4, 7, 8, 11, 13, 14, 0, 3, 12, 15 };

groupshared float2 Flow[16];
groupshared float Brightening[16];
groupshared uint IsRough;
groupshared uint Picked[MOST];
groupshared uint Count;
groupshared float Unlike[2][WIDE * WIDE];

float2 smooth_at(uint direction, int2 cell)
{
    uint2 place = uint2(clamp(cell, 0, int2(Cells) - 1));
    return motion_at(of_two(AtFlow, direction), place.y * Cells.x + place.x);
}

// Whether the motion of a cell is other than that between two others.
bool is_off(float2 own, float2 one, float2 other)
{
    precise float2 off = abs(0.5 * (one + other) - own);
    return any(off > ROUGH * float(Stride));
}

// What number `x` of eight pixels is bilinear between.
void taps_of(uint x, out uint closer, out uint farther, out float weight)
{
    uint cell = x / Stride;
    float within = float(x - cell * Stride) + 0.5 - 0.5 * float(Stride);
    closer = 1 + cell;
    farther = within < 0 ? cell : 2 + cell;
    weight = abs(within) / float(Stride);
}

// How much cell number `cell` along a side counts for a pixel: a tent over two cells each way.
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
    if (index < MOST)
    {
        Picked[index] = 0;
    }
    if (index == 0)
    {
        IsRough = 0;
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
        bool is_across = is_off(own, smooth_at(direction, cell - int2(1, 0)), smooth_at(direction, cell + int2(1, 0)));
        if (is_across || is_off(own, smooth_at(direction, cell - int2(0, 1)), smooth_at(direction, cell + int2(0, 1))))
        {
            InterlockedOr(IsRough, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0 && IsRough != 0)
    {
        // The distinct motions of the window.
        uint count = 0;
        [loop]
        for (uint k = 0; k < side * side && count < MOST; k++)
        {
            uint cell = side == 3 ? ORDER_OF_9[min(k, 8)] : ORDER_OF_16[k];
            bool is_new = true;
            [unroll]
            for (uint other = 0; other + 1 < MOST; other++)
            {
                is_new = is_new && (other >= count || !near(Flow[Picked[other]], Flow[cell], SAME));
            }
            if (is_new)
            {
                Picked[count] = cell;
                count++;
            }
        }
        Count = count;
    }
    GroupMemoryBarrierWithGroupSync();

    // How well each of them explains the surroundings of this pixel.
    int2 corner = int2(group.xy) * BLOCK - REACH;
    uint chosen = 0;
    float least = asfloat(0x7f7fffff);
    [loop]
    for (uint number = 0; number < MOST; number++)
    {
        bool is_tried = number < Count;
        [branch]
        if (is_tried)
        {
            uint cell = Picked[number];
            float2 flow = Flow[cell];
            int2 whole = int2(floor(min(max(flow, -FAR), FAR)));
            precise float2 part = flow - float2(whole);
            [loop]
            for (uint k = index; k < WIDE * WIDE; k += 64)
            {
                int2 place = corner + int2(uint2(k % WIDE, k / WIDE));
                int2 there = place + whole;
                float above = between(luma_at(to, there), luma_at(to, there + int2(1, 0)), part.x);
                float below = between(luma_at(to, there + int2(0, 1)), luma_at(to, there + int2(1, 1)), part.x);
                precise float apart = abs(above + (below - above) * part.y - luma_at(from, place) - Brightening[cell]);
                Unlike[number & 1][k] = is_in_level(there) ? min(apart, MOST_UNLIKE) : OUTSIDE;
            }
        }
        GroupMemoryBarrierWithGroupSync();
        if (is_tried)
        {
            uint first = of_group.y * WIDE + of_group.x;
            precise float sum = 0;
            for (uint x = 0; x < 5; x++)
            {
                precise float of_column = 0;
                for (uint y = 0; y < 5; y++)
                {
                    of_column += Unlike[number & 1][first + y * WIDE + x];
                }
                sum += of_column;
            }
            chosen = sum < least ? Picked[number] : chosen;
            least = min(sum, least);
        }
    }

    uint2 closer, farther;
    float2 weight;
    taps_of(of_group.x, closer.x, farther.x, weight.x);
    taps_of(of_group.y, closer.y, farther.y, weight.y);
    float2 motion;
    [branch]
    if (IsRough != 0)
    {
        // The surface that the chosen cell is of.
        float2 own = Flow[chosen];
        precise float weights = 1e-6;
        precise float2 sums = 0;
        [loop]
        for (uint cell = 0; cell < side * side; cell++)
        {
            precise float2 apart = Flow[cell] - own;
            if (max(abs(apart.x), abs(apart.y)) < SURFACE)
            {
                precise float counts =
                    tent(closer.x, farther.x, weight.x, cell % side) * tent(closer.y, farther.y, weight.y, cell / side);
                weights += counts;
                sums += counts * apart;
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
            above[axis] = between(Flow[closer.y * side + closer.x][axis], Flow[closer.y * side + farther.x][axis], weight.x);
            below[axis] = between(Flow[farther.y * side + closer.x][axis], Flow[farther.y * side + farther.x][axis], weight.x);
        }
        motion = float2(between(above.x, below.x, weight.y), between(above.y, below.y, weight.y));
    }
    uint2 at = group.xy * 8 + of_group.xy;
    if (all(at < Level))
    {
        uint pixel = at.y * Level.x + at.x;
        Work.Store2(of_two(AtDense, direction) + 8 * pixel, asuint(motion));
        if (direction == BACK)
        {
            Work.Store(AtTrusted + 4 * pixel, IsRough == 0 || least <= MISMATCH ? 1 : 0);
        }
    }
}
