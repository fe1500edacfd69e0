// Conversion to half floats with the same rounding on every device.

// The nearest half float; ties to even.
uint half_from_float(float v)
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

// The nearest R11G11B10_FLOAT: exponent and leading mantissa bits of a half float, without a sign. Negative values and NaN become 0; values
// above 64512, which all three channels can hold, are clamped to it.
uint r11g11b10_from_float(float3 v)
{
    float3 clamped = float3(v.x > 0 ? min(v.x, 64512) : 0, v.y > 0 ? min(v.y, 64512) : 0, v.z > 0 ? min(v.z, 64512) : 0);
    uint3 h = uint3(half_from_float(clamped.x), half_from_float(clamped.y), half_from_float(clamped.z));
    return (h.x + 8) >> 4 | (h.y + 8) >> 4 << 11 | (h.z + 16) >> 5 << 22;
}
