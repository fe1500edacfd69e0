// What leaves the picture in front of all else: looks along the rows and columns of the previous anchor from both their ends.
// A thread to an end.

#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_reprojection.hlsli"
#include "frame_border.hlsli"

static const int GAP = 6;
static const int TELLING = 3;
static const float ALIKE = 16;
static const uint FARTHEST = 8;
static const uint NEARER = 2048;

[numthreads(64, 1, 1)]
void main(uint thread : SV_DispatchThreadID)
{
    if (is_cut() || has_past() || thread >= 2 * (Size.x + Size.y))
    {
        return;
    }
    uint entry = thread >> 1;
    uint axis = entry < Size.y ? 0 : 1;
    bool is_far = (thread & 1) != 0;
    int side = int(axis == 0 ? Size.x : Size.y);
    int length = 0;
    int signs = 0;
    int gap = 0;
    float last = 0;
    uint2 behind = EMPTY;
    int most = min(int(uint(side) / FARTHEST), LONGEST >> 6);
    for (int step = 0; step < most; step++)
    {
        int2 at = place_of(axis == 0 ? entry : entry - Size.y, axis, is_far, step);
        uint2 owner = Places.Load2(8 * pixel(at));
        float4 shown = stored(PREVIOUS, at);
        if (is_empty(owner))
        {
            float luma = luma_of(shown);
            if (length == step && step > 0 && abs(luma - last) <= ALIKE)
            {
                length = step + 1;
                last = luma;
            }
            continue;
        }
        int2 v = vector_of(owner);
        int along = axis == 0 ? v.x : v.y;
        if ((is_far ? -along : along) < -32)
        {
            break;
        }
        if (is_foreign(shown, 64 * at - v))
        {
            length = step + 1;
            gap = 0;
            last = luma_of(shown);
            behind = owner;
            signs++;
        }
        else
        {
            gap++;
            if (gap > GAP)
            {
                break;
            }
        }
    }
    if (signs * TELLING < length || length == 0)
    {
        length = 0;
    }
    uint rank = rank_of(behind);
    uint2 claim = key_of(rank - min(rank, NEARER), ORPHAN, vector_of(behind));
    Small.Store3(AtRuns + 16 * thread, uint3(length, claim));
}
