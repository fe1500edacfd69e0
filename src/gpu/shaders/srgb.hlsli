// The sRGB transfer function (IEC 61966-2-1), extended above 1 and mirrored below 0 as in scRGB (IEC 61966-2-2). NaN becomes 0, infinity
// the largest half float.

float bounded(float v)
{
    uint bits = asuint(v) & 0x7fffffff;
    return bits > 0x7f800000 ? 0 : min(max(v, -65504), 65504);
}

float srgb_from_linear(float linear_value)
{
    float v = bounded(linear_value);
    float a = abs(v);
    float encoded = a <= 0.0031308 ? 12.92 * a : 1.055 * pow(max(a, 0.001), 1 / 2.4) - 0.055;
    return v < 0 ? -encoded : encoded;
}

float linear_from_srgb(float encoded)
{
    float v = bounded(encoded);
    float a = abs(v);
    float linear_value = a <= 0.04045 ? a / 12.92 : pow(max(a + 0.055, 0.05) / 1.055, 2.4);
    return v < 0 ? -linear_value : linear_value;
}

// Alpha is not encoded.
float4 srgb_from_linear4(float4 linear_value)
{
    return float4(srgb_from_linear(linear_value.x), srgb_from_linear(linear_value.y), srgb_from_linear(linear_value.z), linear_value.w);
}

float4 linear_from_srgb4(float4 encoded)
{
    return float4(linear_from_srgb(encoded.x), linear_from_srgb(encoded.y), linear_from_srgb(encoded.z), encoded.w);
}
