// Reading of numbers from buffers, and bilinear interpolation.

// Element `index` of a buffer of half floats or of floats.
float load_number(ByteAddressBuffer from, uint index, bool halves)
{
    if (halves)
    {
        uint pair = from.Load((index >> 1) * 4);
        return f16tof32((index & 1) != 0 ? pair >> 16 : pair & 0xffff);
    }
    return asfloat(from.Load(index * 4));
}

// Whether a value is neither infinite nor NaN. Tests the bits, which no compiler optimises away.
bool is_finite(float x)
{
    return (asuint(x) & 0x7f800000) != 0x7f800000;
}

// For element `i` of `to` elements interpolated from `from` cells, with cell centres at half pixels and the borders repeated: the two
// cells, and the weight of the second. The position (2 i + 1) from / (2 to) - 1/2 is computed in integers and so exact.
void bilinear_cells(uint i, uint from, uint to, out uint low, out uint high, out float t)
{
    int position = int((2 * i + 1) * from) - int(to);
    bool outside = position < 0;
    uint rest = outside ? uint(position + int(2 * to)) : uint(position);
    uint cell = rest / (2 * to);
    low = outside ? 0 : min(cell, from - 1);
    high = outside ? 0 : min(cell + 1, from - 1);
    t = float(rest - cell * 2 * to) / float(2 * to);
}

// Bilinear interpolation of the corners top left, top right, bottom left, bottom right.
float bilinear(float4 corners, float2 t)
{
    precise float above = corners.x + (corners.y - corners.x) * t.x;
    precise float below = corners.z + (corners.w - corners.z) * t.x;
    precise float value = above + (below - above) * t.y;
    return value;
}
