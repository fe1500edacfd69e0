// Clears splat keys and coverage, and the results of the frame; in run 0 also those of the pair.

#include "frame.hlsli"

[numthreads(1024, 1, 1)]
void main(uint at : SV_DispatchThreadID)
{
    uint2 pixels = TILE * Tiles + 2;
    if (at < pixels.x * pixels.y)
    {
        Scratch.Store2(8 * at, EMPTY);
    }
    if (at < Tiles.x * Tiles.y)
    {
        // Minimum and maximum motion, motion sums, area; smallest depth key and tag, largest depth key, whether keys of single pixels reach
        // the tile.
        uint coverage = AtCoverage + 40 * at;
        Small.Store4(coverage, uint4(0xffffffff, 0xffffffff, 0, 0));
        Small.Store4(coverage + 16, uint4(0, 0, 0, 0xffffffff));
        Small.Store2(coverage + 32, uint2(0, 0));
    }
    if (Run != 0)
    {
        if (at == 0 && InheritedTag == HOLE)
        {
            // UNCOVERED, HAS_HIDDEN and HAS_EMPTY_SQUARE.
            Small.Store3(UNCOVERED, uint3(0, 0, 0));
        }
        return;
    }
    if (at < 128)
    {
        Small.Store(4 * at, at == TOP / 4 ? Size.y : at == LEFT / 4 ? Size.x : at == IS_CUT / 4 ? IsCutStated : 0);
    }
}
