// Detection of static overlays such as HUDs and watermarks.

#include "constants.hlsli"

// The smallest mean of the four 2x2 squares that contain the centre of 3x3 values. A square that extends beyond the border is excluded if
// there is another.
float min_square_mean(float differences[9], int2 at)
{
    int2 size = int2(Size);
    bool2 is_first = at == 0 && size > 1;
    bool2 is_last = at == size - 1 && size > 1;
    float min_mean = asfloat(0x7f800000);
    [loop]
    for (uint corner = 0; corner < 4; corner++)
    {
        bool is_right = (corner & 1) != 0;
        bool is_low = corner >= 2;
        uint first = (is_low ? 3 : 0) + (is_right ? 1 : 0);
        precise float square = ((differences[first] + differences[first + 1]) + differences[first + 3]) + differences[first + 4];
        bool is_off = (is_right ? is_last.x : is_first.x) || (is_low ? is_last.y : is_first.y);
        min_mean = is_off ? min_mean : min(min_mean, square);
    }
    return min_mean / 4;
}

// Whether a pixel of an anchor is static and does not match the other anchor along `v`.
bool is_overlay(uint here, int2 at, int2 v)
{
    uint there = here == PREVIOUS ? CURRENT : PREVIOUS;
    bool result = false;
    [branch]
    if (any(v != 0) && abs(luma_of(load_pixel(here, at)) - luma_of(load_pixel(there, at))) <= 4 * STATIC_OVERLAY_MAX_STATIC_DIFFERENCE)
    {
        float patch[9];
        float differences[9];
        [loop]
        for (uint n = 0; n < 9; n++)
        {
            int2 pixel = at + int2(n % 3, n / 3) - 1;
            patch[n] = luma_of(load_pixel(here, pixel));
            differences[n] = abs(luma_of(load_pixel(there, pixel)) - patch[n]);
        }
        float static_difference = min_square_mean(differences, at);
        int2 from = 64 * at + v;
        bool leads_inside = all(from >= 0) && all(from <= 64 * (int2(Size) - 1));
        float difference_sum = 0;
        float luma_sum = 0;
        [loop]
        for (uint a = 0; a < 9; a++)
        {
            precise float next_difference_sum = difference_sum + differences[a];
            precise float next_luma_sum = luma_sum + patch[a];
            difference_sum = next_difference_sum;
            luma_sum = next_luma_sum;
        }
        if (leads_inside)
        {
            // Bilinear interpolation, row by row.
            int2 first = (from >> 6) - 1;
            float2 t = float2(from & 63) / 64;
            float3 above = 0;
            // The sum of the differences of the patch's static pixels, and their number.
            float mismatch = 0;
            float static_pixels = 0;
            [loop]
            for (int row = 0; row < 4; row++)
            {
                float4 lumas = 0;
                [loop]
                for (int column = 0; column < 4; column++)
                {
                    lumas = float4(lumas.yzw, luma_of(load_pixel(there, first + int2(column, row))));
                }
                precise float3 across = lumas.xyz + (lumas.yzw - lumas.xyz) * t.x;
                precise float3 between = above + (across - above) * t.y;
                if (row > 0)
                {
                    [loop]
                    for (int at_row = 0; at_row < 3; at_row++)
                    {
                        int index = 3 * row - 3 + at_row;
                        bool is_static = differences[index] <= STATIC_OVERLAY_MAX_STATIC_DIFFERENCE;
                        differences[index] = abs(between[at_row] - patch[index]);
                        precise float next_mismatch = mismatch + (is_static ? differences[index] : 0);
                        mismatch = next_mismatch;
                        static_pixels += is_static ? 1 : 0;
                    }
                }
                above = across;
            }
            result = static_difference <= STATIC_OVERLAY_MAX_STATIC_DIFFERENCE && mismatch >= STATIC_OVERLAY_MIN_MISMATCH * static_pixels
                && (static_difference + STATIC_OVERLAY_NOISE) * STATIC_OVERLAY_RATIO <= min_square_mean(differences, at);
        }
        else
        {
            float mean = luma_sum / 9;
            float contrast = 0;
            [loop]
            for (uint b = 0; b < 9; b++)
            {
                precise float next = contrast + abs(patch[b] - mean);
                contrast = next;
            }
            result = static_difference <= STATIC_OVERLAY_MAX_STATIC_DIFFERENCE && difference_sum / 9 <= STATIC_OVERLAY_MAX_STATIC_DIFFERENCE && contrast / 9 >= STATIC_OVERLAY_MIN_CONTRAST;
        }
    }
    return result;
}
