// Colours of the anchors: levels of 1/255 as whole numbers, or floats as they are; of light, what is shown for it.

#include "halves.hlsli"
#include "light.hlsli"

// Weights of six pixels for positions of 0, 1, 2 and so on in 1/64 px after the third of them: the windowed sinc of Lanczos with
// three lobes.
static const int SINC[384] =
{
    0, 0, 128, 0, 0, 0, 0, -2, 128, 2, 0, 0, 1, -3, 128, 3, -1, 0, 1, -5, 128, 5, -1, 0, 2, -6, 127, 7, -2, 0, 2, -7,
    126, 9, -2, 0, 2, -8, 126, 11, -3, 0, 3, -10, 125, 13, -3, 0, 3, -11, 125, 15, -4, 0, 3, -12, 124, 18, -5, 0, 3,
    -13, 123, 20, -5, 0, 3, -14, 122, 22, -6, 1, 3, -15, 120, 25, -6, 1, 3, -15, 119, 27, -7, 1, 4, -16, 117, 30, -8,
    1, 4, -17, 116, 32, -8, 1, 4, -17, 114, 35, -9, 1, 4, -18, 113, 37, -9, 1, 4, -18, 111, 40, -10, 1, 4, -18, 109,
    43, -11, 1, 4, -18, 107, 45, -11, 1, 4, -19, 105, 48, -12, 2, 4, -19, 103, 51, -13, 2, 4, -19, 101, 53, -13, 2, 4,
    -19, 98, 56, -13, 2, 4, -19, 96, 59, -14, 2, 4, -19, 94, 62, -15, 2, 4, -19, 91, 65, -15, 2, 4, -19, 89, 67, -16,
    3, 3, -18, 86, 70, -16, 3, 3, -18, 84, 73, -17, 3, 3, -18, 81, 76, -17, 3, 3, -17, 78, 78, -17, 3, 3, -17, 76, 81,
    -18, 3, 3, -17, 73, 84, -18, 3, 3, -16, 70, 86, -18, 3, 3, -16, 67, 89, -19, 4, 2, -15, 65, 91, -19, 4, 2, -15,
    62, 94, -19, 4, 2, -14, 59, 96, -19, 4, 2, -13, 56, 98, -19, 4, 2, -13, 53, 101, -19, 4, 2, -13, 51, 103, -19, 4,
    2, -12, 48, 105, -19, 4, 1, -11, 45, 107, -18, 4, 1, -11, 43, 109, -18, 4, 1, -10, 40, 111, -18, 4, 1, -9, 37,
    113, -18, 4, 1, -9, 35, 114, -17, 4, 1, -8, 32, 116, -17, 4, 1, -8, 30, 117, -16, 4, 1, -7, 27, 119, -15, 3, 1,
    -6, 25, 120, -15, 3, 1, -6, 22, 122, -14, 3, 0, -5, 20, 123, -13, 3, 0, -5, 18, 124, -12, 3, 0, -4, 15, 125, -11,
    3, 0, -3, 13, 125, -10, 3, 0, -3, 11, 126, -8, 2, 0, -2, 9, 126, -7, 2, 0, -2, 7, 127, -6, 2, 0, -1, 5, 128, -5,
    1, 0, -1, 3, 128, -3, 1, 0, 0, 2, 128, -2, 0
};

static const uint PREVIOUS = 0;
static const uint CURRENT = 1;

// A pixel of one of the anchors as it is held, light as it is shown; the edge pixels go on beyond the edges.
float4 stored(uint anchor, int2 at)
{
    int3 place = int3(clamp(at, 0, int2(Size) - 1), 0);
    float4 v;
    [branch]
    if (anchor == PREVIOUS)
    {
        v = Previous.Load(place);
    }
    else
    {
        v = Current.Load(place);
    }
    [branch]
    if (IsLight != 0)
    {
        v = shown_for4(v);
    }
    precise float4 level = floor(v * 255 + 0.5);
    return IsFloat != 0 ? v : level;
}

// What is no number as 0, the infinite as the largest half.
float4 finite4(float4 v)
{
    return float4(bounded(v.x), bounded(v.y), bounded(v.z), bounded(v.w));
}

// In levels of 1/255 of full scale.
float4 in_levels(float4 held)
{
    precise float4 wide = finite4(held) * 255;
    return IsFloat != 0 ? wide : held;
}

// In whole levels from 0 to 255.
uint4 whole_levels(float4 held)
{
    precise float4 wide = min(max(finite4(held), 0), 1) * 255 + 0.5;
    return IsFloat != 0 ? uint4(wide) : uint4(held);
}

float luma_of(float4 held)
{
    float4 v = in_levels(held);
    precise float luma = (0.299 * v.x + 0.587 * v.y) + 0.114 * v.z;
    return luma;
}

uint whole_luma(float4 held)
{
    uint4 v = whole_levels(held);
    return (77 * v.x + 150 * v.y + 29 * v.z) >> 8;
}

float4 halved(float4 v)
{
    return f16tof32(uint4(half_of(v.x), half_of(v.y), half_of(v.z), half_of(v.w)));
}

// The weighted mean of the 6 x 6 pixels from `first` on, for a position `phase` / 64 after the third of them.
float4 filtered(uint anchor, int2 first, uint2 phase)
{
    float4 found = 0;
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
                row += int4(stored(anchor, first + int2(i, j))) * SINC[6 * phase.x + i];
            }
            sum += row * SINC[6 * phase.y + j];
        }
        found = float4(clamp((sum + (1 << 13)) >> 14, 0, 255));
    }
    else
    {
        float4 total = 0;
        float4 least = asfloat(0x7f800000);
        float4 largest = asfloat(0xff800000);
        [loop]
        for (int c = 0; c < 6; c++)
        {
            float4 column = 0;
            float4 low = asfloat(0x7f800000);
            float4 high = asfloat(0xff800000);
            [unroll]
            for (int r = 0; r < 6; r++)
            {
                float4 v = finite4(stored(anchor, first + int2(c, r)));
                precise float4 weighted = v * (SINC[6 * phase.y + r] / 128.0);
                precise float4 added = column + weighted;
                column = r == 0 ? weighted : added;
                low = r > 0 && r < 5 ? min(low, v) : low;
                high = r > 0 && r < 5 ? max(high, v) : high;
            }
            precise float4 weighted_column = column * (SINC[6 * phase.x + c] / 128.0);
            precise float4 added_column = total + weighted_column;
            total = c == 0 ? weighted_column : added_column;
            least = c > 0 && c < 5 ? min(least, low) : least;
            largest = c > 0 && c < 5 ? max(largest, high) : largest;
        }
        found = halved(min(max(total, least), largest) + 0);
    }
    return found;
}

// A colour at a position in 1/64 px.
float4 sampled(uint anchor, int2 spot)
{
    int2 first = (spot >> 6) - 2;
    uint2 phase = uint2(spot & 63);
    float4 found = 0;
    [branch]
    if (all(phase == 0))
    {
        found = stored(anchor, first + 2);
        found = IsFloat != 0 ? finite4(found) + 0 : found;
    }
    else
    {
        found = filtered(anchor, first, phase);
    }
    return found;
}

static const float AGREE = 1;
static const float CAREFUL = 24;
// The same where motion was found in the pictures themselves: it seldom is that of what lies behind an overlay.
static const float CAREFUL_IF_FOUND = 64;
static const float STRICT = 4;

// Whether some channel differs by more than so many levels.
bool differ(float4 before, float4 after, float levels)
{
    if (IsFloat == 0)
    {
        return any(abs(after - before) > levels);
    }
    float4 a = finite4(before);
    float4 b = finite4(after);
    precise float4 apart = abs(b - a) * 255;
    precise float4 allowed = levels * (max(abs(a), abs(b)) + 0.25);
    return any(apart > allowed);
}

// One colour of two: that nearer in time where they agree, else a mixture.
float4 merged(float4 before, float4 after)
{
    if (!differ(before, after, AGREE))
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
    return halved(mixed);
}

// How far two colours are apart: the levels of the channel that differs most.
float apart_by(float4 a, float4 b)
{
    float4 d = abs(in_levels(a) - in_levels(b));
    return max(max(d.x, d.y), d.z);
}

// Whether a colour is none of those around a position in the current anchor.
bool is_foreign(float4 colour, int2 spot)
{
    int2 at;
    if (!nearest(spot, at))
    {
        return false;
    }
    float margin = asfloat(Small.Load(MARGIN));
    float4 levels = in_levels(colour);
    if (all(abs(levels - in_levels(stored(CURRENT, at))) <= margin))
    {
        return false;
    }
    float4 low = asfloat(0x7f800000);
    float4 high = asfloat(0xff800000);
    [loop]
    for (int v = max(at.y - 2, 0); v <= min(at.y + 2, int(Size.y) - 1); v++)
    {
        [loop]
        for (int u = max(at.x - 2, 0); u <= min(at.x + 2, int(Size.x) - 1); u++)
        {
            float4 there = in_levels(stored(CURRENT, int2(u, v)));
            low = min(low, there);
            high = max(high, there);
        }
    }
    return any(levels < low - margin) || any(levels > high + margin);
}

// Writes a colour of the frame.
void show(int2 at, float4 held)
{
    uint place = uint(at.y) * Pitch;
    if (Written >= 3)
    {
        float4 v = IsFloat != 0 ? held : held / 255;
        [branch]
        if (WritesLight != 0)
        {
            v = light_of4(v);
        }
        [branch]
        if (Written == 4)
        {
            Picture.Store(place + 4 * at.x, small_floats_of(v.xyz));
            return;
        }
        uint4 h = uint4(half_of(v.x), half_of(v.y), half_of(v.z), half_of(v.w));
        Picture.Store2(place + 8 * at.x, uint2(h.x | h.y << 16, h.z | h.w << 16));
        return;
    }
    float4 part = IsFloat != 0 ? min(max(finite4(held), 0), 1) : held / 255;
    uint4 levels = uint4(floor(part * (Written == 2 ? float4(1023, 1023, 1023, 3) : float4(255, 255, 255, 255)) + 0.5));
    uint first = Written == 1 ? levels.z : levels.x;
    uint third = Written == 1 ? levels.x : levels.z;
    uint bits = Written == 2 ? first | levels.y << 10 | third << 20 | levels.w << 30
                             : first | levels.y << 8 | third << 16 | levels.w << 24;
    Picture.Store(place + 4 * at.x, bits);
}
