// Pyramid of the farthest keys of the tiles. One group computes all levels.

#include "frame.hlsli"

static const uint THREADS = 1024;

uint2 farthest_at(uint level, uint2 size, uint2 at, uint stride)
{
    if (any(at >= size))
    {
        return EMPTY;
    }
    return Small.Load2(level + stride * (at.y * size.x + at.x));
}

// The farther of two keys, ignoring EMPTY.
uint2 farther_key(uint2 a, uint2 b)
{
    return is_empty(a) ? b : is_empty(b) ? a : farther_of(a, b);
}

[numthreads(1024, 1, 1)]
void main(uint thread : SV_GroupIndex)
{
    uint2 below = Tiles;
    uint from = AtSplatTiles;
    uint stride = 16;
    uint level = AtLevels;
    [loop]
    for (uint side = 1; side < max(Tiles.x, Tiles.y); side *= 2)
    {
        uint2 size = (below + 1) / 2;
        [loop]
        for (uint i = thread; i < size.x * size.y; i += THREADS)
        {
            uint2 at = 2 * uint2(i % size.x, i / size.x);
            uint2 found = EMPTY;
            [unroll]
            for (uint child = 0; child < 4; child++)
            {
                found = farther_key(found, farthest_at(from, below, at + uint2(child & 1, child >> 1), stride));
            }
            Small.Store2(level + 8 * i, found);
        }
        AllMemoryBarrierWithGroupSync();
        from = level;
        stride = 8;
        below = size;
        level += 8 * size.x * size.y;
    }
}
