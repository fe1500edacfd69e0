// Motion and depth of the frame half way between two, from those of the later one: a place of it is where a pixel of the later frame
// is that has gone half of its way. Of the pixels whose way leads there the nearest counts; where none does, the pixel that lies
// there itself.

cbuffer Constants : register(b0)
{
    uint2 Size;        // of depth and motion, width and height
    float2 Scale;      // from motion to pixels of that size
    uint IsInverted;   // the nearest is the largest depth
};

Texture2D<float2> Motion : register(t0);
Texture2D<float> Depth : register(t1);
RWTexture2D<float2> HalfwayMotion : register(u0);
RWTexture2D<float> HalfwayDepth : register(u1);

int2 inside(float2 at)
{
    return int2(clamp(round(at), 0, float2(Size) - 1));
}

[numthreads(8, 8, 1)]
void main(uint3 id : SV_DispatchThreadID)
{
    if (any(id.xy >= Size))
    {
        return;
    }
    int2 found = int2(id.xy);
    float depth = Depth.Load(int3(found, 0));
    bool is_led_to = false;
    // What moves past is tried from the motion of pixels around, near and far, as the one that lies there may be of what stands behind.
    [loop]
    for (uint i = 0; i < 45; i++)
    {
        int2 start = inside(float2(id.xy) + float(2u << (i / 9)) * (float2(i % 3, i / 3 % 3) - 1));
        float2 at = float2(id.xy);
        float2 v = Motion.Load(int3(start, 0)) * Scale;
        [loop]
        for (uint step = 0; step < 3; step++)
        {
            at = float2(id.xy) - v / 2;
            v = Motion.Load(int3(inside(at), 0)) * Scale;
        }
        float2 away = abs(at + v / 2 - float2(id.xy));
        int2 place = inside(at);
        float d = Depth.Load(int3(place, 0));
        bool is_nearer = IsInverted != 0 ? d > depth : d < depth;
        if (all(away <= 1) && (!is_led_to || is_nearer))
        {
            is_led_to = true;
            depth = d;
            found = place;
        }
    }
    HalfwayMotion[id.xy] = Motion.Load(int3(found, 0));
    HalfwayDepth[id.xy] = depth;
}
