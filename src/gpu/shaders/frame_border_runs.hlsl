// Detects foreground that leaves the picture: scans the rows and columns of the previous anchor from both ends. A thread per end.

#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_reprojection.hlsli"
#include "frame_border.hlsli"

static const int MAX_GAP = 6;
static const int PIXELS_PER_OUTLIER = 3;
static const float SIMILAR_LUMA = 16;
static const uint LENGTH_DIVISOR = 8;
static const uint DEPTH_KEY_STEP = 2048;

[numthreads(64, 1, 1)]
void main(uint thread : SV_DispatchThreadID)
{
    if (is_cut() || has_reprojection() || thread >= 2 * (Size.x + Size.y))
    {
        return;
    }
    uint entry = thread >> 1;
    uint axis = entry < Size.y ? 0 : 1;
    bool is_far = (thread & 1) != 0;
    int side = int(axis == 0 ? Size.x : Size.y);
    int length = 0;
    int outliers = 0;
    int gap = 0;
    float last = 0;
    uint2 background = EMPTY;
    int limit = min(int(uint(side) / LENGTH_DIVISOR), MAX_COMPONENT >> 6);
    for (int step = 0; step < limit; step++)
    {
        int2 at = pixel_of_run(axis == 0 ? entry : entry - Size.y, axis, is_far, step);
        uint2 own = SplatKeys.Load2(8 * pixel_index(at));
        float4 colour = load_pixel(PREVIOUS, at);
        if (is_empty(own))
        {
            float luma = luma_of(colour);
            if (length == step && step > 0 && abs(luma - last) <= SIMILAR_LUMA)
            {
                length = step + 1;
                last = luma;
            }
            continue;
        }
        int2 v = vector_of(own);
        int along = axis == 0 ? v.x : v.y;
        if ((is_far ? -along : along) < -32)
        {
            break;
        }
        if (is_colour_outlier(colour, 64 * at - v))
        {
            length = step + 1;
            gap = 0;
            last = luma_of(colour);
            background = own;
            outliers++;
        }
        else
        {
            gap++;
            if (gap > MAX_GAP)
            {
                break;
            }
        }
    }
    if (outliers * PIXELS_PER_OUTLIER < length || length == 0)
    {
        length = 0;
    }
    uint depth_key = depth_key_of(background);
    uint2 key = pack(depth_key - min(depth_key, DEPTH_KEY_STEP), PREVIOUS_ONLY, vector_of(background));
    Small.Store3(AtBorderRuns + 16 * thread, uint3(length, key));
}
