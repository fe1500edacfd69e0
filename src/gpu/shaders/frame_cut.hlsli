// Reduced pictures of the two anchors for cut detection, the previous one first.

#include "constants.hlsli"

uint luma_at(uint anchor, uint2 at)
{
    return Small.Load(AtLumas + 4 * (anchor * Reduced.x * Reduced.y + at.y * Reduced.x + at.x));
}

int detail_at(uint anchor, uint2 at)
{
    return int(Small.Load(AtDetails + 4 * (anchor * Reduced.x * Reduced.y + at.y * Reduced.x + at.x)));
}

uint2 tiny_size()
{
    return (Reduced + CUT_TINY_FACTOR - 1) / CUT_TINY_FACTOR;
}

// Largest shift of the tiny pictures.
uint2 shift_reach()
{
    return tiny_size() / uint2(2, 4);
}
