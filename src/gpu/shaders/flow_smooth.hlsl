// Jacobi iterations of the smoothing: patches with much information keep their motion, others take their neighbours'. A thread per cell; a
// group also computes as many cells around its own as it runs iterations, unless it covers the whole grid.

#include "constants.hlsli"
#include "flow.hlsli"

static const int SIDE = 32;

groupshared float2 Flow[SIDE * SIDE];

[numthreads(SIDE, SIDE, 1)]
void main(uint3 group : SV_GroupID, uint3 of_group : SV_GroupThreadID, uint index : SV_GroupIndex)
{
    uint direction = Direction + group.z;
    int2 within = int2(of_group.xy);
    int2 cell = int2(group.xy) * (SIDE - 2 * int(Halo)) - int(Halo) + within;
    bool is_cell = all(cell >= 0) && all(cell < int2(Cells));
    uint number = is_cell ? uint(cell.y) * Cells.x + uint(cell.x) : 0;
    uint searched = of_two(AtFound, direction);
    float4 found = asfloat(Work.Load4(searched + 32 * number));
    float4 known = asfloat(Work.Load4(searched + 32 * number + 16));
    precise float confidence = 1 / (found.w + GRID_NOISE);
    precise float3 hessian = known.xyz * confidence;

    // 1 + squared luma difference of each neighbour; 0 if there is none.
    float4 similarity = 0;
    [unroll]
    for (int side = 0; side < 4; side++)
    {
        int2 step = side == 0 ? int2(-1, 0) : side == 1 ? int2(1, 0) : side == 2 ? int2(0, -1) : int2(0, 1);
        int2 there = cell + step;
        bool has_neighbour = is_cell && all(there >= 0) && all(there < int2(Cells)) && all(within + step >= 0) && all(within + step < SIDE);
        if (has_neighbour)
        {
            float other = asfloat(Work.Load(searched + 32 * (uint(there.y) * Cells.x + uint(there.x)) + 28));
            precise float luma_ratio = (other - known.w) * (1 / GRID_LUMA_SCALE);
            precise float one_more = 1 + luma_ratio * luma_ratio;
            similarity[side] = one_more;
        }
    }
    float2 here = IsSource != 0 ? motion_at(of_two(AtSource, direction), number) : found.xy;
    Flow[index] = here;
    GroupMemoryBarrierWithGroupSync();
    [loop]
    for (uint round = 0; round < Rounds; round++)
    {
        precise float weights = 1e-6;
        precise float2 pull = 0;
        [unroll]
        for (int other = 0; other < 4; other++)
        {
            int neighbour = int(index) + (other == 0 ? -1 : other == 1 ? 1 : other == 2 ? -SIDE : SIDE);
            float2 there = Flow[clamp(neighbour, 0, SIDE * SIDE - 1)];
            precise float2 difference = there - here;
            precise float change = difference.x * difference.x + difference.y * difference.y;
            precise float quotient = GRID_LAMBDA / (similarity[other] * (change + 1));
            float weight = similarity[other] > 0 ? quotient : 0;
            precise float more = weights + weight;
            precise float2 pulled = pull + weight * difference;
            weights = more;
            pull = similarity[other] > 0 ? pulled : pull;
        }
        precise float2 back = found.xy - here;
        precise float2 right = float2(
            hessian.x * back.x + hessian.y * back.y + pull.x, hessian.y * back.x + hessian.z * back.y + pull.y);
        precise float a = hessian.x + weights;
        precise float c = hessian.z + weights;
        precise float determinant = a * c - hessian.y * hessian.y;
        precise float2 step = float2(c * right.x - hessian.y * right.y, a * right.y - hessian.y * right.x) / determinant;
        precise float2 moved = here + step;
        here = moved;
        GroupMemoryBarrierWithGroupSync();
        Flow[index] = here;
        GroupMemoryBarrierWithGroupSync();
    }
    if (is_cell && all(within >= int(Halo)) && all(within < SIDE - int(Halo)))
    {
        Work.Store2(of_two(AtTarget, direction) + 8 * number, asuint(here));
    }
}
