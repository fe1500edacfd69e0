// Colours of the anchors: integer levels of 1/255 for byte formats, otherwise floats, sRGB-encoded if the anchors are linear.

#include "constants.hlsli"
#include "half_float.hlsli"
#include "srgb.hlsli"

static const uint PREVIOUS = 0;
static const uint CURRENT = 1;

// A pixel of an anchor, sRGB-encoded, clamped to the border.
float4 load_pixel(uint anchor, int2 at)
{
    int3 location = int3(clamp(at, 0, int2(Size) - 1), 0);
    float4 v;
    [branch]
    if (anchor == PREVIOUS)
    {
        v = Previous.Load(location);
    }
    else
    {
        v = Current.Load(location);
    }
    [branch]
    if (IsLinear != 0)
    {
        v = srgb_from_linear4(v);
    }
    precise float4 level = floor(v * 255 + 0.5);
    return IsFloat != 0 ? v : level;
}

// NaN becomes 0, infinity the largest half float.
float4 finite4(float4 v)
{
    return float4(bounded(v.x), bounded(v.y), bounded(v.z), bounded(v.w));
}

// In levels of 1/255 of full scale.
float4 in_levels(float4 raw)
{
    precise float4 wide = finite4(raw) * 255;
    return IsFloat != 0 ? wide : raw;
}

// In integer levels from 0 to 255.
uint4 whole_levels(float4 raw)
{
    precise float4 wide = min(max(finite4(raw), 0), 1) * 255 + 0.5;
    return IsFloat != 0 ? uint4(wide) : uint4(raw);
}

float luma_of(float4 raw)
{
    float4 v = in_levels(raw);
    precise float luma = (0.299 * v.x + 0.587 * v.y) + 0.114 * v.z;
    return luma;
}

uint whole_luma(float4 raw)
{
    uint4 v = whole_levels(raw);
    return (77 * v.x + 150 * v.y + 29 * v.z) >> 8;
}

float4 rounded_to_half(float4 v)
{
    return f16tof32(uint4(half_from_float(v.x), half_from_float(v.y), half_from_float(v.z), half_from_float(v.w)));
}

// Weighted sum of the 6 x 6 pixels from `first`, for a position `phase` / 64 after the third of them.
float4 lanczos_sample(uint anchor, int2 first, uint2 phase)
{
    float4 result = 0;
    [branch]
    if (IsFloat == 0)
    {
        int4 sum = 0;
        [loop]
        for (int j = 0; j < 6; j++)
        {
            int4 row = 0;
            [unroll]
            for (int i = 0; i < 6; i++)
            {
                row += int4(load_pixel(anchor, first + int2(i, j))) * LANCZOS_SINC[6 * phase.x + i];
            }
            sum += row * LANCZOS_SINC[6 * phase.y + j];
        }
        result = float4(clamp((sum + (1 << 13)) >> 14, 0, 255));
    }
    else
    {
        float4 total = 0;
        float4 min_value = asfloat(0x7f800000);
        float4 max_value = asfloat(0xff800000);
        [loop]
        for (int c = 0; c < 6; c++)
        {
            float4 column = 0;
            float4 low = asfloat(0x7f800000);
            float4 high = asfloat(0xff800000);
            [unroll]
            for (int r = 0; r < 6; r++)
            {
                float4 v = finite4(load_pixel(anchor, first + int2(c, r)));
                precise float4 weighted = v * (LANCZOS_SINC[6 * phase.y + r] / 128.0);
                precise float4 added = column + weighted;
                column = r == 0 ? weighted : added;
                low = r > 0 && r < 5 ? min(low, v) : low;
                high = r > 0 && r < 5 ? max(high, v) : high;
            }
            precise float4 weighted_column = column * (LANCZOS_SINC[6 * phase.x + c] / 128.0);
            precise float4 added_column = total + weighted_column;
            total = c == 0 ? weighted_column : added_column;
            min_value = c > 0 && c < 5 ? min(min_value, low) : min_value;
            max_value = c > 0 && c < 5 ? max(max_value, high) : max_value;
        }
        result = rounded_to_half(min(max(total, min_value), max_value) + 0);
    }
    return result;
}

// Sample at a position in 1/64 px.
float4 sampled(uint anchor, int2 position)
{
    int2 first = (position >> 6) - 2;
    uint2 phase = uint2(position & 63);
    float4 result = 0;
    [branch]
    if (all(phase == 0))
    {
        result = load_pixel(anchor, first + 2);
        result = IsFloat != 0 ? finite4(result) + 0 : result;
    }
    else
    {
        result = lanczos_sample(anchor, first, phase);
    }
    return result;
}

// Whether any channel differs by more than `levels`.
bool differ(float4 before, float4 after, float levels)
{
    if (IsFloat == 0)
    {
        return any(abs(after - before) > levels);
    }
    float4 a = finite4(before);
    float4 b = finite4(after);
    precise float4 difference = abs(b - a) * 255;
    precise float4 allowed = levels * (max(abs(a), abs(b)) + 0.25);
    return any(difference > allowed);
}

// Merges two samples: the one nearer in time if they are equal, otherwise a blend.
float4 merged(float4 before, float4 after)
{
    if (!differ(before, after, RENDER_MAX_EQUAL_DIFFERENCE))
    {
        return NearerIsCurrent != 0 ? after : before;
    }
    int share = clamp((Phase + 16) >> 5, 1, 127);
    if (IsFloat == 0)
    {
        return float4((int4(before) * (128 - share) + int4(after) * share + 64) >> 7);
    }
    float4 a = finite4(before);
    precise float4 mixed = a + (finite4(after) - a) * (share / 128.0);
    return rounded_to_half(mixed);
}

// Difference between two colours: the largest of any channel, in levels.
float colour_difference(float4 a, float4 b)
{
    float4 d = abs(in_levels(a) - in_levels(b));
    return max(max(d.x, d.y), d.z);
}

// Stores a pixel of the frame in the target format.
void store_pixel(int2 at, float4 raw)
{
    uint address = uint(at.y) * Pitch;
    if (TargetFormat >= 3)
    {
        float4 v = IsFloat != 0 ? raw : raw / 255;
        [branch]
        if (WritesLinear != 0)
        {
            v = linear_from_srgb4(v);
        }
        [branch]
        if (TargetFormat == 4)
        {
            Picture.Store(address + 4 * at.x, r11g11b10_from_float(v.xyz));
            return;
        }
        uint4 h = uint4(half_from_float(v.x), half_from_float(v.y), half_from_float(v.z), half_from_float(v.w));
        Picture.Store2(address + 8 * at.x, uint2(h.x | h.y << 16, h.z | h.w << 16));
        return;
    }
    float4 clamped = IsFloat != 0 ? min(max(finite4(raw), 0), 1) : raw / 255;
    uint4 levels = uint4(floor(clamped * (TargetFormat == 2 ? float4(1023, 1023, 1023, 3) : float4(255, 255, 255, 255)) + 0.5));
    uint first = TargetFormat == 1 ? levels.z : levels.x;
    uint third = TargetFormat == 1 ? levels.x : levels.z;
    uint bits = TargetFormat == 2 ? first | levels.y << 10 | third << 20 | levels.w << 30
                             : first | levels.y << 8 | third << 16 | levels.w << 24;
    Picture.Store(address + 4 * at.x, bits);
}
