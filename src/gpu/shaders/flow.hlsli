// Bindings and shared functions of the optical flow shaders (`picture_flow`). The CPU extractor documents the purpose of each step; names
// are the same, and so is the order of every sum.

#include "constants.hlsli"
#include "srgb.hlsli"
#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Size;             // size of the anchors, in pixels
    uint2 Level;            // size of the current pyramid level
    uint2 FinerLevel;       // size of the level from which it is halved
    uint2 CheckedLevel;     // size of the level with the reverse flow
    uint2 Cells;            // columns and rows of patches
    uint2 CoarseCells;      // the same on the coarser level; 0: there is none
    uint2 DepthSize;        // size of the depth texture
    // Byte offsets into `Work`; pairs are for the previous and the current anchor, or for the two directions.
    uint2 AtLuma;           // luma of the level
    uint2 AtFinerLuma;      // luma of the finer level
    uint2 AtFound;          // search results: eight words per patch
    uint2 AtFlow;           // smoothed motion of the patches
    uint2 AtSource;         // input of a smoothing pass, unless that is the search result
    uint2 AtTarget;         // output of a smoothing pass
    uint2 AtCoarseFlow;     // motion on the coarser level
    uint2 AtModel;          // global motion: whether it is known, and eight parameters
    uint2 AtDense;          // motion per pixel: reverse on the finest level, forward on the checked one
    uint AtTrusted;         // per pixel of the finest level: whether it matches, later whether it is trusted
    uint Stride;            // pixels from one patch to the next
    uint CoarseStride;      // the same on the coarser level
    uint Direction;         // first direction of the groups; 0 is current to previous
    uint Halvings;          // halvings from the anchors to the level
    uint CheckedHalvings;   // halvings from there to the checked level
    uint IsHalved;          // 1: the level is half the anchors
    uint IsAgain;           // 1: a repeated search
    uint IsSource;          // 1: the smoothing pass continues a previous one
    uint Rounds;            // iterations of the pass
    uint Halo;              // cells around a group's own that it computes as well
    uint Step;              // cells from one sample to the next
    uint IsFloat;           // 1: pixels are floats; 0: bytes
    uint IsLinear;          // 1: anchors are linear
};

Texture2D<float4> Previous : register(t0);
Texture2D<float4> Current : register(t1);

RWByteAddressBuffer Work : register(u0);
RWTexture2D<float2> Motion : register(u1);
RWTexture2D<float> Depth : register(u2);

static const uint BACK = 0;
static const uint OF_PREVIOUS = 0;
static const uint OF_CURRENT = 1;

uint of_two(uint2 pair, uint which)
{
    return which == 0 ? pair.x : pair.y;
}

// The picture in which a direction starts; the other is where its motion leads.
uint start_of(uint direction)
{
    return direction == BACK ? OF_CURRENT : OF_PREVIOUS;
}

// Luma of the current level, clamped to the border, of the picture at offset `luma`.
float luma_at(uint luma, int2 at)
{
    uint2 position = uint2(clamp(at, 0, int2(Level) - 1));
    return asfloat(Work.Load(luma + 4 * (position.y * Level.x + position.x)));
}

bool is_in_level(int2 at)
{
    return all(at >= 0) && all(at < int2(Level));
}

// A pixel of an anchor in code values.
float3 colour_of(uint picture, uint2 at)
{
    float4 v;
    [branch]
    if (picture == OF_PREVIOUS)
    {
        v = Previous.Load(int3(at, 0));
    }
    else
    {
        v = Current.Load(int3(at, 0));
    }
    [branch]
    if (IsLinear != 0)
    {
        v = srgb_from_linear4(v);
    }
    precise float3 level = floor(v.xyz * 255 + 0.5);
    // max turns NaN into 0.
    precise float3 wide = min(max(v.xyz, 0), 1) * 255;
    return IsFloat != 0 ? wide : level;
}

float2 motion_at(uint motions, uint index)
{
    return asfloat(Work.Load2(motions + 8 * index));
}

// Whether two motions differ by less than `limit` in each component.
bool is_near(float2 a, float2 b, float limit)
{
    float2 difference = abs(a - b);
    return max(difference.x, difference.y) < limit;
}

// Linear interpolation, exact if both values are equal.
float lerp_exact(float a, float b, float t)
{
    precise float value = a + (b - a) * t;
    return value;
}

// Global motion at a position, for a grid of `size` pixels scaled by `scale`; returns whether it is known.
bool global_motion_at(uint model, uint2 size, float scale, float2 position, out float2 motion)
{
    uint4 first = Work.Load4(model);
    uint4 more = Work.Load4(model + 16);
    float last = asfloat(Work.Load(model + 32));
    precise float unit = 2 / float(max(size.x, size.y)) / scale;
    precise float2 p = (position - scale * 0.5 * float2(size)) * unit;
    precise float bend = asfloat(more.w) * p.x + last * p.y;
    precise float u = (asfloat(first.y) + asfloat(first.z) * p.x + asfloat(first.w) * p.y) + bend * p.x;
    precise float v = (asfloat(more.x) + asfloat(more.y) * p.x + asfloat(more.z) * p.y) + bend * p.y;
    motion = scale * float2(u, v);
    return first.x != 0;
}
