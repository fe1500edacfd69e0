// Halves rounded the same way on every device.

// The nearest half, of two the even one.
uint half_of(float v)
{
    uint sign = asuint(v) >> 16 & 0x8000;
    uint bits = asuint(v) & 0x7fffffff;
    if (bits >= 0x47800000)
    {
        return sign | (bits > 0x7f800000 ? 0x7e00 : 0x7c00);
    }
    precise float small = asfloat(bits) + 0.5;
    return sign | (bits < 0x38800000 ? asuint(small) - 0x3f000000 : bits + 0xfff + (bits >> 13 & 1) - 0x38000000 >> 13);
}

// The nearest numbers of R11G11B10_FLOAT: the exponent of a half and the first bits of its mantissa, without a sign. Negative numbers and
// NaN are 0, and what is larger is 64512, which all three can hold.
uint small_floats_of(float3 v)
{
    float3 shown = float3(v.x > 0 ? min(v.x, 64512) : 0, v.y > 0 ? min(v.y, 64512) : 0, v.z > 0 ? min(v.z, 64512) : 0);
    uint3 h = uint3(half_of(shown.x), half_of(shown.y), half_of(shown.z));
    return (h.x + 8) >> 4 | (h.y + 8) >> 4 << 11 | (h.z + 16) >> 5 << 22;
}
