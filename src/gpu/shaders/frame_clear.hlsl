// Makes ready what claims land on, and with that of a frame what it finds out; in the first pass of a pair also what that finds out.

#include "frame.hlsli"

[numthreads(1024, 1, 1)]
void main(uint at : SV_DispatchThreadID)
{
    uint2 places = TILE * Tiles + 2;
    if (at < places.x * places.y)
    {
        Scratch.Store2(8 * at, EMPTY);
    }
    if (at < Tiles.x * Tiles.y)
    {
        // The least and the largest vector, sums, area; the nearest rank and mark, the farthest rank, whether pixels of their
        // own are there.
        uint cover = AtCovers + 40 * at;
        Small.Store4(cover, uint4(0x7fffffff, 0x7fffffff, 0x80000000, 0x80000000));
        Small.Store4(cover + 16, uint4(0, 0, 0, 0xffffffff));
        Small.Store2(cover + 32, uint2(0, 0));
    }
    if (Turn != 0)
    {
        if (at == 0 && Mark == HOLE)
        {
            // Uncovered, hidden, blank: nothing so far.
            Small.Store3(UNCOVERED, uint3(0, 0, 0));
        }
        return;
    }
    if (at < 2 * (Size.x + Size.y))
    {
        Small.Store(AtJoined + 16 * at, 0);
    }
    if (at < 128)
    {
        Small.Store(4 * at, at == TOP / 4 ? Size.y : at == LEFT / 4 ? Size.x : at == IS_CUT / 4 ? IsStated : 0);
    }
}
