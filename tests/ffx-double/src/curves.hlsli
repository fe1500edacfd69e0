// Transfer functions of frames.

float3 of_srgb(float3 c)
{
    return c <= 0.04045 ? c / 12.92 : pow((max(c, 0.04045) + 0.055) / 1.055, 2.4);
}

float3 to_srgb(float3 light)
{
    return light <= 0.0031308 ? light * 12.92 : 1.055 * pow(max(light, 0.0031308), 1 / 2.4) - 0.055;
}

// Relative to 10,000 nits.
float3 of_pq(float3 c)
{
    float3 p = pow(max(c, 0), 1 / 78.84375);
    return pow(abs(max(p - 0.8359375, 0) / (18.8515625 - 18.6875 * p)), 1 / 0.1593017578125);
}

float3 to_pq(float3 light)
{
    float3 y = pow(light, 0.1593017578125);
    return pow((0.8359375 + 18.8515625 * y) / (1 + 18.6875 * y), 78.84375);
}
