// Interpolates half way between two frames, as far as the double needs it: a blend of both along the motion, in linear light.

#include "curves.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Size;         // size of the frames
    uint2 RenderSize;   // size of depth
    uint2 MotionSize;
    float2 Scale;       // from motion to render pixels
    int4 Part;          // left, top, right, bottom of the generated part; the rest is copied
    float2 Jitter;      // camera jitter contained in motion, in render pixels
    float2 Luminance;   // nits
    uint Transfer;      // 0: sRGB, 1: PQ, 2: scRGB
    uint Flags;
    uint Loops;         // number of repetitions
};

static const uint RESET = 1, HUDLESS = 2, DISTORTED = 4, INVERTED = 8, THROUGH = 16, BLACK = 32, WRONG_SIGN = 64,
    UPSIDE_DOWN = 128, FARTHEST = 256, WRONG_JITTER = 512;

Texture2D<float4> Shown : register(t0);
Texture2D<float4> Hudless : register(t1);
Texture2D<float4> Before : register(t2);
Texture2D<float2> Motion : register(t3);
Texture2D<float> Depth : register(t4);
Texture2D<float2> Distortion : register(t5);
RWTexture2D<float4> Output : register(u0);

float3 nits(float3 c)
{
    float3 light;
    if (Transfer == 1)
    {
        light = 10000 * of_pq(c);
    }
    else if (Transfer == 2)
    {
        light = c * 80;
    }
    else
    {
        return of_srgb(c);
    }
    return clamp(light, Luminance.x, Luminance.y);
}

float3 encoded(float3 light)
{
    if (Transfer == 1)
    {
        return to_pq(max(light, 0) / 10000);
    }
    if (Transfer == 2)
    {
        return light / 80;
    }
    return to_srgb(light);
}

float3 world(int2 at)
{
    return (Flags & HUDLESS) != 0 ? Hudless.Load(int3(at, 0)).rgb : Shown.Load(int3(at, 0)).rgb;
}

// Blend of this frame and the previous one in linear light, each at its own position, bilinear.
float3 light(float2 now, float2 then)
{
    float3 sum = 0;
    // One loop: on a software device, unrolled code takes long to compile.
    [loop]
    for (uint i = 0; i < 8; i++)
    {
        float2 at = clamp(i < 4 ? now : then, float2(Part.xy), float2(Part.zw) - 1);
        int2 low = int2(floor(at));
        int2 high = min(low + 1, Part.zw - 1);
        float2 t = at - low;
        int2 place = int2((i & 1) != 0 ? high.x : low.x, (i & 2) != 0 ? high.y : low.y);
        float weight = ((i & 1) != 0 ? t.x : 1 - t.x) * ((i & 2) != 0 ? t.y : 1 - t.y);
        sum += weight * nits(i < 4 ? world(place) : Before.Load(int3(place, 0)).rgb);
    }
    return sum;
}

// Whether a depth is in front of another.
bool is_nearer(float a, float b)
{
    bool is_inverted = ((Flags & INVERTED) != 0) != ((Flags & FARTHEST) != 0);
    return is_inverted ? a > b : a < b;
}

// Motion from this frame to the previous one in pixels, and depth, of the nearest neighbour. As AMD's provider 3.1.5 does, depth and motion cover
// the generated part (`ffx_frameinterpolation_game_motion_vector_field.h` of its published source).
float3 motion_of(int2 at)
{
    float2 part = float2(Part.zw - Part.xy);
    float2 inside = clamp(float2(at - Part.xy) + 0.5, float2(0.5, 0.5), part - 0.5);
    int2 centre = int2(inside * float2(RenderSize) / part);
    int2 nearest = centre;
    float depth = Depth.Load(int3(centre, 0));
    [loop]
    for (uint i = 0; i < 9; i++)
    {
        int2 place = clamp(centre + int2(uint2(i % 3, i / 3)) - 1, int2(0, 0), int2(RenderSize) - 1);
        float d = Depth.Load(int3(place, 0));
        if (is_nearer(d, depth))
        {
            depth = d;
            nearest = place;
        }
    }
    int2 place = int2((float2(nearest) + 0.5) * float2(MotionSize) / float2(RenderSize));
    float2 v = Motion.Load(int3(place, 0)) * Scale - ((Flags & WRONG_JITTER) != 0 ? -Jitter : Jitter);
    float2 covered = all(MotionSize == Size) ? float2(Size) : float2(RenderSize);
    v = v * part / covered;
    return float3((Flags & WRONG_SIGN) != 0 ? -v.x : v.x, (Flags & (WRONG_SIGN | UPSIDE_DOWN)) != 0 ? -v.y : v.y, depth);
}

// Motion and depth of the nearest surface that crosses a pixel half way: a neighbour's motion is followed to its position in this frame,
// and counts if the motion there is the same.
float2 motion(int2 at)
{
    float3 best = motion_of(at);
    bool is_found = false;
    int reach = max(4, int(Size.x / 80));
    [loop]
    for (uint i = 0; i < 9; i++)
    {
        int2 around = clamp(at + (int2(uint2(i % 3, i / 3)) - 1) * reach, int2(0, 0), int2(Size) - 1);
        float3 tried = motion_of(around);
        int2 now = int2(round(float2(at) - 0.5 * tried.xy));
        float3 there = motion_of(clamp(now, int2(0, 0), int2(Size) - 1));
        if (all(abs(there.xy - tried.xy) < 0.5) && (!is_found || is_nearer(there.z, best.z)))
        {
            best = there;
            is_found = true;
        }
    }
    return best.xy;
}

[numthreads(8, 8, 1)]
void main(uint3 id : SV_DispatchThreadID)
{
    int2 at = int2(id.xy);
    if (any(id.xy >= Size))
    {
        return;
    }
    float3 shown = Shown.Load(int3(at, 0)).rgb;
    float3 made = shown;
    bool inside = all(at >= Part.xy) && all(at < Part.zw);
    if ((Flags & BLACK) != 0)
    {
        made = 0;
    }
    else if (inside && (Flags & (RESET | THROUGH)) == 0)
    {
        [loop]
        for (uint i = 0; i <= Loops; i++)
        {
            float2 half_way = motion(at) * 0.5;
            float2 from = float2(at);
            if ((Flags & DISTORTED) != 0)
            {
                from += Distortion.Load(int3(at, 0)) * float2(Size);
            }
            made = encoded(light(from - half_way, from + half_way) / 2);
        }
        // The interface is where the frame differs from the one without it.
        if ((Flags & HUDLESS) != 0 && any(abs(shown - world(at)) > 0.1))
        {
            made = shown;
        }
    }
    // As AMD's provider 3.1.5 does, which writes red into alpha.
    Output[id.xy] = float4(made, made.r);
}
