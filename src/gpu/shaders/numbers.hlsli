// Numbers in buffers, and what lies between them.

// Number `index` of a buffer of halves or of floats.
float number(ByteAddressBuffer from, uint index, bool halves)
{
    if (halves)
    {
        uint pair = from.Load((index >> 1) * 4);
        return f16tof32((index & 1) != 0 ? pair >> 16 : pair & 0xffff);
    }
    return asfloat(from.Load(index * 4));
}

// Whether it is neither infinite nor NaN; looked up in the bits, which no compiler reasons away.
bool finite(float x)
{
    return (asuint(x) & 0x7f800000) != 0x7f800000;
}

// The two cells of place `i` of `to` on `from` cells, half-pixel centres and edges repeated, and the weight of the second. In
// whole numbers, so that it is exact: the place is (2 i + 1) from / (2 to) - 1/2.
void cells_of(uint i, uint from, uint to, out uint low, out uint high, out float t)
{
    int place = int((2 * i + 1) * from) - int(to);
    bool outside = place < 0;
    uint rest = outside ? uint(place + int(2 * to)) : uint(place);
    uint cell = rest / (2 * to);
    low = outside ? 0 : min(cell, from - 1);
    high = outside ? 0 : min(cell + 1, from - 1);
    t = float(rest - cell * 2 * to) / float(2 * to);
}

// Mixes top left, top right, bottom left, bottom right; `t` from the first to the second across and down.
float mixed(float4 corners, float2 t)
{
    precise float above = corners.x + (corners.y - corners.x) * t.x;
    precise float below = corners.z + (corners.w - corners.z) * t.x;
    precise float value = above + (below - above) * t.y;
    return value;
}
