// Edges between surfaces that nothing but pictures tells apart: where the claims of a tile move apart, and where nothing visible in
// the current anchor landed, a pixel takes a share of those beside it in its tile.

// In 1/64 px.
static const int TORN = 192;
// Of 128.
static const int SHARE = 10;

groupshared float4 Sharp[64];
groupshared uint Unseen[2];
groupshared int Least[2];
groupshared int Largest[2];

// The colour that lies beside that of a thread, where that is in the tile and shown; else the thread's own.
float4 beside(uint index, bool is_inside, uint other)
{
    uint taken = is_inside ? other : index;
    taken = (Unseen[taken >> 5] >> (taken & 31) & 1) != 0 ? index : taken;
    return Sharp[taken];
}

// The softened colour of each of the 64 threads of a tile, which all call this. Only a rough tile that is whole is soft.
float4 softened(uint index, uint2 key, bool is_rough, bool is_hidden, bool stands_still, float4 colour)
{
    if (index < 2)
    {
        Unseen[index] = 0;
        Least[index] = int(0x7fffffff);
        Largest[index] = int(0x80000000);
    }
    Sharp[index] = colour;
    GroupMemoryBarrierWithGroupSync();
    uint mark = mark_of(key);
    int2 v = vector_of(key);
    InterlockedOr(Unseen[index >> 5], (is_hidden ? 1u : 0u) << (index & 31));
    InterlockedMin(Least[0], v.x);
    InterlockedMin(Least[1], v.y);
    InterlockedMax(Largest[0], v.x);
    InterlockedMax(Largest[1], v.y);
    GroupMemoryBarrierWithGroupSync();
    bool is_torn = Largest[0] - Least[0] > TORN || Largest[1] - Least[1] > TORN;
    bool is_soft = is_rough && (is_torn || mark == ORPHAN || mark == HOLE) && !is_hidden && !stands_still;
    float4 left = beside(index, (index & 7) > 0, index - 1);
    float4 right = beside(index, (index & 7) < 7, index + 1);
    float4 above = beside(index, index >= 8, index - 8);
    float4 below = beside(index, index < 56, index + 8);
    float4 soft = colour;
    [branch]
    if (IsFloat == 0)
    {
        int4 sum = int4(left) + int4(right) + int4(above) + int4(below);
        soft = float4((int4(colour) * (128 - 4 * SHARE) + sum * SHARE + 64) >> 7);
    }
    else
    {
        float4 own = finite4(colour);
        precise float4 apart = (((finite4(left) - own) + (finite4(right) - own)) + (finite4(above) - own)) + (finite4(below) - own);
        precise float4 moves = apart * (SHARE / 128.0);
        precise float4 moved = own + moves;
        soft = halved(moved);
    }
    return is_soft ? soft : colour;
}
