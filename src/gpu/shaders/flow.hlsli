// What the shaders of motion from two pictures share: what is bound, and where it lies. The extractor of the processor says what
// all of it is for; names are the same, and so is the order of every sum.

#include "srgb.hlsli"
#include "convert.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Size;         // pixels of the anchors
    uint2 Level;        // pixels of the level that is worked at
    uint2 FinerLevel;   // of that which it is halved from
    uint2 CheckedLevel; // of that on which the way back is known
    uint2 Cells;        // patches across and down
    uint2 CoarseCells;  // of the next coarser level; 0: there is none
    uint2 DepthSize;    // texels of the depth
    // Where things lie in `Work`, in bytes; those of two are of the previous and the current anchor, or of the two directions.
    uint2 AtLuma;       // luma of the level
    uint2 AtFinerLuma;  // of the finer level
    uint2 AtFound;      // what the search found: eight words to a patch
    uint2 AtFlow;       // its motion after smoothing
    uint2 AtSource;     // what a pass of the smoothing starts from, where that is not what was found
    uint2 AtTarget;     // where it leaves its motion
    uint2 AtCoarseFlow; // motion of the coarser level
    uint2 AtModel;      // the motion of the whole picture: whether it is known, and eight numbers
    uint2 AtDense;      // motion of pixels: back on the finest level, forth on that which is checked
    uint AtTrusted;     // of each pixel of the finest level whether it is matched, and later whether it is trusted
    uint Stride;        // pixels from one patch to the next
    uint CoarseStride;  // on the coarser level
    uint Direction;     // the first of those that groups work at, 0 being back
    uint Halvings;      // from the anchors to the level
    uint CheckedHalvings; // from there to that on which the way back is known
    uint IsHalved;      // 1: the level is made of the anchors halved
    uint IsAgain;       // 1: the search is one anew
    uint IsSource;      // 1: a pass of the smoothing goes on with one before
    uint Rounds;        // of this pass
    uint Halo;          // cells around those of a group that it works at for its own sake
    uint Step;          // cells from one sample to the next
    uint IsFloat;       // 1: pixels are floats; 0: bytes
    uint IsLight;       // 1: what is read is light
};

Texture2D<float4> Previous : register(t0);
Texture2D<float4> Current : register(t1);

RWByteAddressBuffer Work : register(u0);
RWTexture2D<float2> Motion : register(u1);
RWTexture2D<float> Depth : register(u2);

static const uint BACK = 0;
static const uint OF_PREVIOUS = 0;
static const uint OF_CURRENT = 1;
// Motion beyond this leads out of every picture.
static const float FAR = 1048576;

uint of_two(uint2 pair, uint which)
{
    return which == 0 ? pair.x : pair.y;
}

// Which picture a direction starts from; the other is where it leads to.
uint start_of(uint direction)
{
    return direction == BACK ? OF_CURRENT : OF_PREVIOUS;
}

// Luma of the level in the picture that lies from `luma` on, the edge repeated outside.
float luma_at(uint luma, int2 at)
{
    uint2 place = uint2(clamp(at, 0, int2(Level) - 1));
    return asfloat(Work.Load(luma + 4 * (place.y * Level.x + place.x)));
}

bool is_in_level(int2 at)
{
    return all(at >= 0) && all(at < int2(Level));
}

// A colour of an anchor in code values.
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
    if (IsLight != 0)
    {
        v = srgb_from_linear4(v);
    }
    precise float3 level = floor(v.xyz * 255 + 0.5);
    // What is no number is 0.
    precise float3 wide = min(max(v.xyz, 0), 1) * 255;
    return IsFloat != 0 ? wide : level;
}

float2 motion_at(uint motions, uint index)
{
    return asfloat(Work.Load2(motions + 8 * index));
}

// Whether two motions differ by less than so much along either axis.
bool near(float2 a, float2 b, float most)
{
    float2 apart = abs(a - b);
    return max(apart.x, apart.y) < most;
}

// Between two values, a part of the way on. Differences, so that equal ones stay equal to the last bit.
float between(float a, float b, float part)
{
    precise float value = a + (b - a) * part;
    return value;
}

// The motion of the whole picture at a place, if one is known: that of a grid of `size` pixels, `scale` times as large.
bool whole_at(uint model, uint2 size, float scale, float2 place, out float2 motion)
{
    uint4 first = Work.Load4(model);
    uint4 more = Work.Load4(model + 16);
    float last = asfloat(Work.Load(model + 32));
    precise float unit = 2 / float(max(size.x, size.y)) / scale;
    precise float2 p = (place - scale * 0.5 * float2(size)) * unit;
    precise float bend = asfloat(more.w) * p.x + last * p.y;
    precise float u = (asfloat(first.y) + asfloat(first.z) * p.x + asfloat(first.w) * p.y) + bend * p.x;
    precise float v = (asfloat(more.x) + asfloat(more.y) * p.x + asfloat(more.z) * p.y) + bend * p.y;
    motion = scale * float2(u, v);
    return first.x != 0;
}
