// Light, and the numbers that are shown for it: the curve of sRGB (IEC 61966-2-1), which goes on above 1 and is mirrored below 0, as
// scRGB has it (IEC 61966-2-2). What is no number is 0; the infinite is the largest half.

float bounded(float v)
{
    uint bits = asuint(v) & 0x7fffffff;
    return bits > 0x7f800000 ? 0 : min(max(v, -65504), 65504);
}

float shown_for(float light)
{
    float v = bounded(light);
    float a = abs(v);
    float shown = a <= 0.0031308 ? 12.92 * a : 1.055 * pow(max(a, 0.001), 1 / 2.4) - 0.055;
    return v < 0 ? -shown : shown;
}

float light_of(float shown)
{
    float v = bounded(shown);
    float a = abs(v);
    float light = a <= 0.04045 ? a / 12.92 : pow(max(a + 0.055, 0.05) / 1.055, 2.4);
    return v < 0 ? -light : light;
}

// Colours, whose opacity is no light.
float4 shown_for4(float4 light)
{
    return float4(shown_for(light.x), shown_for(light.y), shown_for(light.z), light.w);
}

float4 light_of4(float4 shown)
{
    return float4(light_of(shown.x), light_of(shown.y), light_of(shown.z), shown.w);
}
