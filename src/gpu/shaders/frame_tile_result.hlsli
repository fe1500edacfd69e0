// What a group of 8 x 8 threads finds out about the colours of its tile: which of its pixels nothing shows, and the sum of the
// others' colours with their number.

groupshared float4 Colours[64];
groupshared uint Hidden[2];
groupshared uint Known;
groupshared uint Loose;

void note_tile(uint2 tile, uint index, bool is_on, bool is_hidden, float4 levels, bool is_loose)
{
    if (index == 0)
    {
        Hidden[0] = 0;
        Hidden[1] = 0;
        Known = 0;
        Loose = 0;
    }
    Colours[index] = is_on && !is_hidden ? levels : 0;
    GroupMemoryBarrierWithGroupSync();
    if (is_on && is_hidden)
    {
        InterlockedOr(Hidden[index >> 5], 1u << (index & 31));
    }
    if (is_on && !is_hidden)
    {
        InterlockedAdd(Known, 1);
    }
    if (is_loose)
    {
        InterlockedAdd(Loose, 1);
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
        Small.Store4(AtKnown + 20 * number, asuint(sum));
        Small.Store(AtKnown + 20 * number + 16, asuint(float(Known)));
        if ((Hidden[0] | Hidden[1]) != 0)
        {
            Small.InterlockedOr(IS_HIDDEN, 1);
        }
        if (Loose != 0)
        {
            Small.InterlockedAdd(UNCOVERED, Loose);
        }
    }
}
