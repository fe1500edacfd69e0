// Tiny pictures, in which the global motion is searched, if a cut is suspected. A thread per pixel.

#include "frame.hlsli"
#include "frame_cut.hlsli"

[numthreads(8, 8, 1)]
void main(uint3 thread : SV_DispatchThreadID)
{
    uint2 size = tiny_size();
    if (any(thread.xy >= size) || Small.Load(IS_CUT_SUSPECTED) == 0)
    {
        return;
    }
    uint2 first = CUT_TINY_FACTOR * thread.xy;
    uint2 end = min(first + CUT_TINY_FACTOR, Reduced);
    uint sum = 0;
    [loop]
    for (uint y = first.y; y < end.y; y++)
    {
        [loop]
        for (uint x = first.x; x < end.x; x++)
        {
            sum += luma_at(thread.z, uint2(x, y));
        }
    }
    uint count = (end.x - first.x) * (end.y - first.y);
    Small.Store(AtTiny + 4 * (thread.z * size.x * size.y + thread.y * size.x + thread.x), (sum + count / 2) / count);
}
