// Results of a tile, from its 8x8 threads: bits of hidden pixels, and sum and number of the other pixels' colours.

groupshared float4 Colours[64];
groupshared uint Hidden[2];
groupshared uint VisibleCount;
groupshared uint UncoveredCount;

void store_tile_result(uint2 tile, uint index, bool is_inside, bool is_hidden, float4 levels, bool is_uncovered)
{
    if (index == 0)
    {
        Hidden[0] = 0;
        Hidden[1] = 0;
        VisibleCount = 0;
        UncoveredCount = 0;
    }
    Colours[index] = is_inside && !is_hidden ? levels : 0;
    GroupMemoryBarrierWithGroupSync();
    if (is_inside && is_hidden)
    {
        InterlockedOr(Hidden[index >> 5], 1u << (index & 31));
    }
    if (is_inside && !is_hidden)
    {
        InterlockedAdd(VisibleCount, 1);
    }
    if (is_uncovered)
    {
        InterlockedAdd(UncoveredCount, 1);
    }
    GroupMemoryBarrierWithGroupSync();
    if (index == 0)
    {
        float4 sum = 0;
        [loop]
        for (uint i = 0; i < 64; i++)
        {
            precise float4 next = sum + Colours[i];
            sum = next;
        }
        uint number = tile.y * Tiles.x + tile.x;
        Small.Store2(AtHidden + 8 * number, uint2(Hidden[0], Hidden[1]));
        Small.Store4(AtColourSums + 20 * number, asuint(sum));
        Small.Store(AtColourSums + 20 * number + 16, asuint(float(VisibleCount)));
        if ((Hidden[0] | Hidden[1]) != 0)
        {
            Small.InterlockedOr(HAS_HIDDEN, 1u);
        }
        if (UncoveredCount != 0)
        {
            Small.InterlockedAdd(UNCOVERED, UncoveredCount);
        }
    }
}
