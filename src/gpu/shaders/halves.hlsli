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
