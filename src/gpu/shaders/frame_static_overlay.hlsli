// Telling what lies over the picture and stands still: a HUD, a watermark.

static const float STILL = 4;
static const float BETTER = 2;
static const float MARGIN_OF_NOISE = 2;
static const float CONTRAST = 12;

// Of the squares of 2 x 2 pixels that hold the middle of 3 x 3 the one with the least mean; a square that reaches over an edge is
// left out where there is another.
float least_square(float apart[9], int2 at)
{
    int2 size = int2(Size);
    bool2 is_first = at == 0 && size > 1;
    bool2 is_last = at == size - 1 && size > 1;
    float least = asfloat(0x7f800000);
    [loop]
    for (uint corner = 0; corner < 4; corner++)
    {
        bool is_right = (corner & 1) != 0;
        bool is_low = corner >= 2;
        uint first = (is_low ? 3 : 0) + (is_right ? 1 : 0);
        precise float square = ((apart[first] + apart[first + 1]) + apart[first + 3]) + apart[first + 4];
        bool is_off = (is_right ? is_last.x : is_first.x) || (is_low ? is_last.y : is_first.y);
        least = is_off ? least : min(least, square);
    }
    return least / 4;
}

// Whether a pixel of an anchor stands still and does not come from where `v` leads to in the other.
bool is_over(uint here, int2 at, int2 v)
{
    uint there = here == PREVIOUS ? CURRENT : PREVIOUS;
    bool is_found = false;
    [branch]
    if (any(v != 0) && abs(luma_of(stored(here, at)) - luma_of(stored(there, at))) <= 4 * STILL)
    {
        float patch[9];
        float apart[9];
        [loop]
        for (uint n = 0; n < 9; n++)
        {
            int2 place = at + int2(n % 3, n / 3) - 1;
            patch[n] = luma_of(stored(here, place));
            apart[n] = abs(luma_of(stored(there, place)) - patch[n]);
        }
        float still = least_square(apart, at);
        int2 from = 64 * at + v;
        bool is_there = all(from >= 0) && all(from <= 64 * (int2(Size) - 1));
        float sum = 0;
        float light = 0;
        [loop]
        for (uint a = 0; a < 9; a++)
        {
            precise float next_sum = sum + apart[a];
            precise float next_light = light + patch[a];
            sum = next_sum;
            light = next_light;
        }
        if (is_there)
        {
            // Read bilinearly, the row above mixed across before.
            int2 first = (from >> 6) - 1;
            float2 t = float2(from & 63) / 64;
            float3 above = 0;
            [loop]
            for (int row = 0; row < 4; row++)
            {
                float4 lumas = 0;
                [loop]
                for (int column = 0; column < 4; column++)
                {
                    lumas = float4(lumas.yzw, luma_of(stored(there, first + int2(column, row))));
                }
                precise float3 across = lumas.xyz + (lumas.yzw - lumas.xyz) * t.x;
                precise float3 between = above + (across - above) * t.y;
                if (row > 0)
                {
                    apart[3 * row - 3] = abs(between.x - patch[3 * row - 3]);
                    apart[3 * row - 2] = abs(between.y - patch[3 * row - 2]);
                    apart[3 * row - 1] = abs(between.z - patch[3 * row - 1]);
                }
                above = across;
            }
            is_found = still <= STILL && (still + MARGIN_OF_NOISE) * BETTER <= least_square(apart, at);
        }
        else
        {
            float mean = light / 9;
            float contrast = 0;
            [loop]
            for (uint b = 0; b < 9; b++)
            {
                precise float next = contrast + abs(patch[b] - mean);
                contrast = next;
            }
            is_found = still <= STILL && sum / 9 <= STILL && contrast / 9 >= CONTRAST;
        }
    }
    return is_found;
}
