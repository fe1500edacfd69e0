// Upsamples the paper's guidance from the latent grid to render size: bilinear, half-pixel centres, clamped to the border.

#include "constants.hlsli"
#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Grid;      // width, height
    uint2 Render;    // width, height
};

// Cells as paper_grid.hlsl writes them.
ByteAddressBuffer Cells : register(t0);
RWTexture2D<float2> Motion : register(u0);
RWTexture2D<float> Depth : register(u1);

static const uint WORDS = 5;

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    if (any(at.xy >= Render))
    {
        return;
    }
    uint2 low, high;
    float2 t;
    bilinear_cells(at.x, Grid.x, Render.x, low.x, high.x, t.x);
    bilinear_cells(at.y, Grid.y, Render.y, low.y, high.y, t.y);
    float3 a = asfloat(Cells.Load3(((low.y * Grid.x + low.x) * WORDS + 2) * 4));
    float3 b = asfloat(Cells.Load3(((low.y * Grid.x + high.x) * WORDS + 2) * 4));
    float3 c = asfloat(Cells.Load3(((high.y * Grid.x + low.x) * WORDS + 2) * 4));
    float3 d = asfloat(Cells.Load3(((high.y * Grid.x + high.x) * WORDS + 2) * 4));
    float2 motion = 0;
    [unroll]
    for (uint axis = 0; axis < 2; axis++)
    {
        // Subtracted from 0 instead of negated, so that no motion is -0.
        precise float m = 0 - PAPER_COMPRESSION * bilinear(float4(a[axis], b[axis], c[axis], d[axis]), t);
        float limit = float(Render[axis]);
        motion[axis] = is_finite(m) ? min(max(m, -limit), limit) : 0;
    }
    Motion[at.xy] = motion;
    Depth[at.xy] = min(max(bilinear(float4(a.z, b.z, c.z, d.z), t), 0), 1);
}
