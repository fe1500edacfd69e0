// Looks for a block of the current anchor in the previous one: where it stands and where its vector points, each with a search
// around; in the second turn, if it was not found, where the whole has gone. A group to a block.

#include "frame.hlsli"
#include "frame_cut.hlsli"

static const int SEARCH = 3;
static const uint SQUARE = 49;
static const float CORRELATION = 0.7;
static const float EVIDENT = 1.5;
static const uint LOST = 2;
static const uint FOUND = 1;

groupshared int Here[256];
groupshared uint IsFound;

// Standard deviations of the block and of the previous anchor at a place, and how well they correlate.
float3 compare(uint2 side, int2 at)
{
    int n = int(side.x * side.y);
    int sum_here = 0;
    int sum_there = 0;
    uint squares_here = 0;
    uint squares_there = 0;
    int products = 0;
    [loop]
    for (uint y = 0; y < side.y; y++)
    {
        [loop]
        for (uint x = 0; x < side.x; x++)
        {
            int here = Here[BLOCK * y + x];
            int there = detail_at(0, uint2(at) + uint2(x, y));
            sum_here += here;
            sum_there += there;
            squares_here += uint(here * here);
            squares_there += uint(there * there);
            products += here * there;
        }
    }
    // Of at most 256 numbers of nine bits and a sign, all of this fits 32 bits, but for the sign of the last.
    float variance_here = float(uint(n) * squares_here - uint(sum_here * sum_here));
    float variance_there = float(uint(n) * squares_there - uint(sum_there * sum_there));
    uint covariance = uint(n * products - sum_here * sum_there);
    float about = float(n) * float(products) - float(sum_here) * float(sum_there);
    float exact = abs(about) < 1073741824.0 ? float(int(covariance)) : about > 0 ? float(covariance) : -float(0 - covariance);
    float2 deviations = float2(sqrt(variance_here), sqrt(variance_there)) / float(n);
    float correlation = exact / float(n * n) / (deviations.x * deviations.y);
    return float3(deviations, all(deviations > 0) ? correlation : 0);
}

int rounded(float v)
{
    return v < 0 ? -int(floor(0.5 - v)) : int(floor(v + 0.5));
}

[numthreads(64, 1, 1)]
void main(uint3 group : SV_GroupID, uint thread : SV_GroupIndex)
{
    uint2 corner = BLOCK * group.xy;
    uint2 side = min(uint2(BLOCK, BLOCK), Reduced - corner);
    uint place = AtBlocks + 4 * (group.y * ((Reduced.x + BLOCK - 1) / BLOCK) + group.x);
    bool is_live = IsStated == 0;
    if (is_live && Turn != 0)
    {
        is_live = Small.Load(IS_DOUBTED) != 0 && Small.Load(place) == LOST;
    }
    if (thread == 0)
    {
        IsFound = 0;
    }
    for (uint i = thread; i < BLOCK * BLOCK; i += 64)
    {
        uint2 at = uint2(i % BLOCK, i / BLOCK);
        int here = 0;
        if (all(at < side))
        {
            here = detail_at(1, corner + at);
        }
        Here[i] = here;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 whole = 0;
    if (Turn != 0)
    {
        whole = int2(Small.Load2(SHIFT));
    }
    else
    {
        uint2 middle = min((corner + BLOCK / 2) * Factor, Size - 1);
        float2 v = Motion.Load(int3(middle / GuidanceTiles.x, 0));
        if (all((asuint(v) & 0x7f800000) != 0x7f800000))
        {
            whole = int2(rounded(v.x / float(Factor)), rounded(v.y / float(Factor)));
        }
    }
    if (is_live)
    {
        [loop]
        for (uint candidate = thread; candidate < (Turn != 0 ? SQUARE : 2 * SQUARE); candidate += 64)
        {
            int2 shift = candidate < SQUARE ? whole : int2(0, 0);
            uint step = candidate % SQUARE;
            int2 at = int2(corner) + shift + int2(step % 7, step / 7) - SEARCH;
            if (all(at >= 0) && all(at + int2(side) <= int2(Reduced)) && compare(side, at).z >= CORRELATION)
            {
                InterlockedOr(IsFound, 1);
            }
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (is_live && thread == 0)
    {
        float2 deviations = compare(side, int2(corner)).xy;
        bool is_evident = max(deviations.x, deviations.y) >= EVIDENT;
        Small.Store(place, is_evident ? (IsFound != 0 ? FOUND : LOST) : 0);
    }
}
