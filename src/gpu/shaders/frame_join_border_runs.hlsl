// What leaves over neighbouring lines is one thing, and moves as far as the line needs of which it covers most. The thread of the
// first of its lines goes along all of them.

#include "frame.hlsli"
#include "frame_reprojection.hlsli"
#include "frame_border.hlsli"

static const uint LEAST_WIDE = 3;
static const int APART = 8;

[numthreads(64, 1, 1)]
void main(uint thread : SV_DispatchThreadID)
{
    if (is_cut() || has_past() || thread >= 2 * (Size.x + Size.y))
    {
        return;
    }
    uint number = thread >> 1;
    uint axis = number < Size.y ? 0 : 1;
    bool is_far = (thread & 1) != 0;
    int first = int(axis == 0 ? number : number - Size.y);
    int lines = int(axis == 0 ? Size.y : Size.x);
    uint from = 16 * (axis == 0 ? 0 : 2 * Size.y) + 16 * (thread & 1);
    if (Small.Load(AtRuns + from + 32 * first) == 0)
    {
        return;
    }
    for (int before = max(first - APART, 0); before < first; before++)
    {
        if (Small.Load(AtRuns + from + 32 * before) != 0)
        {
            return;
        }
    }
    uint longest = 0;
    int end = first + 1;
    int entry = first;
    while (entry < lines && entry - end < APART)
    {
        uint length = Small.Load(AtRuns + from + 32 * entry);
        longest = max(longest, length);
        end = length != 0 ? entry + 1 : end;
        entry++;
    }
    if (longest < LEAST_WIDE)
    {
        return;
    }
    // Of motion that was found in pictures with its rim, which is mixed with what it covers.
    int over = 64 * int(longest + IsOpticalFlow);
    uint3 known = Small.Load3(AtRuns + from + 32 * first);
    int after = first;
    uint3 next = known;
    for (entry = first; entry < end; entry++)
    {
        if (entry > after)
        {
            // The next that is known: lines without a sign go with the shorter of the two beside them.
            known = next;
            after = entry;
            next = Small.Load3(AtRuns + from + 32 * after);
            while (next.x == 0)
            {
                after++;
                next = Small.Load3(AtRuns + from + 32 * after);
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
        Small.Store3(AtJoined + from + 32 * entry, uint3(run.x, key_of(rank_of(run.yz), ORPHAN, v)));
    }
}
