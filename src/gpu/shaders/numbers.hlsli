// Numbers in buffers.

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

// Mixes top left, top right, bottom left, bottom right; `t` from the first to the second across and down.
float mixed(float4 corners, float2 t)
{
    precise float above = corners.x + (corners.y - corners.x) * t.x;
    precise float below = corners.z + (corners.w - corners.z) * t.x;
    precise float value = above + (below - above) * t.y;
    return value;
}
