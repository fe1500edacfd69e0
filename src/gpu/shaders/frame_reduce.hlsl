// Reduced luma pictures of both anchors: means of squares of pixels, from some of their rows. A thread per pixel.

#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_cut.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 thread : SV_DispatchThreadID)
{
    if (any(thread.xy >= Reduced))
    {
        return;
    }
    uint2 first = Factor * thread.xy;
    uint2 end = min(first + Factor, Size);
    uint4 sum = 0;
    uint count = 0;
    uint step = (Factor + 1) / 2;
    [loop]
    for (uint y = first.y; y < end.y; y += step)
    {
        [loop]
        for (uint x = first.x; x < end.x; x++)
        {
            sum += whole_levels(load_pixel(thread.z, int2(x, y)));
            count++;
        }
    }
    uint luma = 77 * sum.x + 150 * sum.y + 29 * sum.z;
    precise float mean = float(luma) / float(256 * count) + 0.5;
    Small.Store(AtLumas + 4 * (thread.z * Reduced.x * Reduced.y + thread.y * Reduced.x + thread.x), min(uint(mean), 255));
}
