// Searches a block of the current anchor in the previous one: at the same position and along its motion vector, with a window around both;
// in run 1, if it was not found, along the global motion. A group per block.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_cut.hlsli"

static const uint WINDOW = (2 * CUT_SEARCH + 1) * (2 * CUT_SEARCH + 1);
static const uint NOT_FOUND = 2;
static const uint FOUND = 1;

groupshared int Here[256];
groupshared uint IsFound;

// Standard deviations of the block and of the previous anchor at a position, and their correlation.
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
            int here = Here[CUT_BLOCK * y + x];
            int there = detail_at(0, uint2(at) + uint2(x, y));
            sum_here += here;
            sum_there += there;
            squares_here += uint(here * here);
            squares_there += uint(there * there);
            products += here * there;
        }
    }
    // Sums of at most 256 products of 9-bit integers fit 32 bits, except for the sign of the covariance.
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
    uint2 corner = CUT_BLOCK * group.xy;
    uint2 side = min(uint2(CUT_BLOCK, CUT_BLOCK), Reduced - corner);
    uint address = AtBlocks + 4 * (group.y * ((Reduced.x + CUT_BLOCK - 1) / CUT_BLOCK) + group.x);
    bool is_searched = IsCutStated == 0;
    if (is_searched && Run != 0)
    {
        is_searched = Small.Load(IS_CUT_SUSPECTED) != 0 && Small.Load(address) == NOT_FOUND;
    }
    if (thread == 0)
    {
        IsFound = 0;
    }
    for (uint i = thread; i < CUT_BLOCK * CUT_BLOCK; i += 64)
    {
        uint2 at = uint2(i % CUT_BLOCK, i / CUT_BLOCK);
        int here = 0;
        if (all(at < side))
        {
            here = detail_at(1, corner + at);
        }
        Here[i] = here;
    }
    GroupMemoryBarrierWithGroupSync();
    int2 centre = 0;
    if (Run != 0)
    {
        centre = int2(Small.Load2(GLOBAL_SHIFT));
    }
    else
    {
        uint2 middle = min((corner + CUT_BLOCK / 2) * Factor, Size - 1);
        float2 v = Motion.Load(int3(middle / GuidanceTiles.x, 0));
        if (all((asuint(v) & 0x7f800000) != 0x7f800000))
        {
            centre = int2(rounded(v.x / float(Factor)), rounded(v.y / float(Factor)));
        }
    }
    if (is_searched)
    {
        [loop]
        for (uint candidate = thread; candidate < (Run != 0 ? WINDOW : 2 * WINDOW); candidate += 64)
        {
            int2 shift = candidate < WINDOW ? centre : int2(0, 0);
            uint step = candidate % WINDOW;
            int2 at = int2(corner) + shift + int2(step % 7, step / 7) - CUT_SEARCH;
            if (all(at >= 0) && all(at + int2(side) <= int2(Reduced)) && compare(side, at).z >= CUT_MIN_CORRELATION)
            {
                InterlockedOr(IsFound, 1);
            }
        }
    }
    GroupMemoryBarrierWithGroupSync();
    if (is_searched && thread == 0)
    {
        float2 deviations = compare(side, int2(corner)).xy;
        bool has_detail = max(deviations.x, deviations.y) >= CUT_MIN_DETAIL;
        Small.Store(address, has_detail ? (IsFound != 0 ? FOUND : NOT_FOUND) : 0);
    }
}
