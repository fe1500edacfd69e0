// Joins the runs of adjacent lines into objects; an object moves by its longest run. The thread of an object's first line processes all its
// lines.

#include "frame.hlsli"
#include "frame_reprojection.hlsli"
#include "frame_border.hlsli"

static const uint MIN_LENGTH = 3;
static const int MAX_LINE_GAP = 8;

[numthreads(64, 1, 1)]
void main(uint thread : SV_DispatchThreadID)
{
    if (is_cut() || has_reprojection() || thread >= 2 * (Size.x + Size.y))
    {
        return;
    }
    uint number = thread >> 1;
    uint axis = number < Size.y ? 0 : 1;
    bool is_far = (thread & 1) != 0;
    int first = int(axis == 0 ? number : number - Size.y);
    int lines = int(axis == 0 ? Size.y : Size.x);
    uint from = 16 * (axis == 0 ? 0 : 2 * Size.y) + 16 * (thread & 1);
    if (Small.Load(AtBorderRuns + from + 32 * first) == 0)
    {
        return;
    }
    for (int before = max(first - MAX_LINE_GAP, 0); before < first; before++)
    {
        if (Small.Load(AtBorderRuns + from + 32 * before) != 0)
        {
            return;
        }
    }
    uint longest = 0;
    int end = first + 1;
    int entry = first;
    while (entry < lines && entry - end < MAX_LINE_GAP)
    {
        uint length = Small.Load(AtBorderRuns + from + 32 * entry);
        longest = max(longest, length);
        end = length != 0 ? entry + 1 : end;
        entry++;
    }
    if (longest < MIN_LENGTH)
    {
        return;
    }
    // Optical flow includes the anti-aliased edge, whose colours are mixed with the background's.
    int over = 64 * int(longest + IsOpticalFlow);
    uint3 known = Small.Load3(AtBorderRuns + from + 32 * first);
    int after = first;
    uint3 next = known;
    for (entry = first; entry < end; entry++)
    {
        if (entry > after)
        {
            // The next line with a run; lines without outliers get the shorter of the runs beside them.
            known = next;
            after = entry;
            next = Small.Load3(AtBorderRuns + from + 32 * after);
            while (next.x == 0)
            {
                after++;
                next = Small.Load3(AtBorderRuns + from + 32 * after);
            }
        }
        uint3 between = known;
        if (next.x <= known.x)
        {
            between = next;
        }
        uint3 run = entry == after ? next : between;
        int2 v = vector_of(run.yz);
        int along = axis == 0 ? v.x : v.y;
        along = is_far ? min(along, -over) : max(along, over);
        v = axis == 0 ? int2(along, v.y) : int2(v.x, along);
        Small.Store3(AtJoined + from + 32 * entry, uint3(run.x, pack(depth_key_of(run.yz), PREVIOUS_ONLY, v)));
    }
}
