// Pixels for a phase from the two anchors: where both agree the nearer in time, where one does not show the surface the other,
// where both do and differ a mixture. A group to a tile.

#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_static_overlay.hlsli"
#include "frame_tile_result.hlsli"
#include "frame_edge_antialiasing.hlsli"

static const float RIM = 45;
static const float UNSEEN = 30;
static const float UNSEEN_IF_FOUND = 40;
// In 1/64 px.
static const int DISTINCT = 8;

groupshared uint IsUnclear;

uint2 claim_at(int2 at)
{
    return Places.Load2(8 * pixel(at));
}

uint2 owner_at(int2 at)
{
    return Owners.Load2(8 * pixel(at));
}

bool moves_otherwise(uint2 key, int2 v)
{
    return any(abs(vector_of(key) - v) > DISTINCT);
}

// Whether what an anchor shows at a place lies in a smooth tile that moves as `key` does.
bool is_in(uint layer, int2 spot, uint2 key)
{
    int2 at;
    if (!nearest(spot, at))
    {
        return false;
    }
    uint4 shown = tile_at(layer, uint2(at) / TILE);
    return shown.z == SMOOTH && (alike(shown.xy, key) || slopes(shown.xy, key));
}

// What both anchors show, each at a position of its own.
void sample_both(int2 before, int2 after, out float4 of_previous, out float4 of_current)
{
    of_previous = 0;
    of_current = 0;
    [loop]
    for (uint anchor = PREVIOUS; anchor <= CURRENT; anchor++)
    {
        float4 found = sampled(anchor, anchor == PREVIOUS ? before : after);
        of_previous = anchor == PREVIOUS ? found : of_previous;
        of_current = found;
    }
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    int2 at = int2(thread.xy);
    bool is_here = is_on(at);
    bool is_live = is_here && !is_cut();
    if (index == 0)
    {
        IsUnclear = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    uint4 tile = tile_at(AtTiles, group.xy);
    // A smooth tile that is whole goes as its middle does.
    bool is_whole = tile.z == SMOOTH && all(extent(group.xy) == uint2(TILE, TILE));
    uint2 key = EMPTY;
    if (is_live)
    {
        key = claim_at(at);
    }
    int2 v = vector_of(key);
    int phase_of_tile = 0;
    if (is_live && is_whole)
    {
        phase_of_tile = phase_of(Phase, tile.xy, TILE * int2(group.xy) + TILE / 2);
        int2 spot = 64 * at + part(v, phase_of_tile);
        if (!(is_in(AtOwnerTiles, spot, tile.xy) && is_in(AtFieldTiles, spot - v, tile.xy)))
        {
            InterlockedOr(IsUnclear, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    bool is_clear = is_whole && IsUnclear == 0;
    bool is_hidden = false;
    bool is_loose = false;
    bool stands_still = false;
    float4 colour = 0;
    [branch]
    if (is_live)
    {
        // Where the two anchors show it.
        int phase = is_whole ? phase_of_tile : phase_of(Phase, key, at);
        int2 before = 64 * at + part(v, phase);
        int2 after = before - v;
        float4 of_previous, of_current;
        sample_both(before, after, of_previous, of_current);
        colour = merged(of_previous, of_current);
        int2 from, to;
        bool has_from = nearest(before, from);
        bool has_to = nearest(after, to);
        uint mark = mark_of(key);
        is_loose = mark == HOLE || mark == ORPHAN;
        bool is_doubtful = differ(of_previous, of_current, IsOpticalFlow != 0 ? CAREFUL_IF_FOUND : CAREFUL) || is_loose || !has_from || !has_to;
        bool is_settled = !is_doubtful && (is_clear || !differ(of_previous, of_current, STRICT));
        [branch]
        if (!is_settled && !is_clear)
        {
            // Beside something in front, it is that thing's if so the anchors agree better. Where depth says nothing, anything that
            // moves otherwise may be in front.
            uint2 front = EMPTY;
            [loop]
            for (int y = max(at.y - 1, 0); y <= min(at.y + 1, int(Size.y) - 1); y++)
            {
                [loop]
                for (int x = max(at.x - 1, 0); x <= min(at.x + 1, int(Size.x) - 1); x++)
                {
                    uint2 beside = claim_at(int2(x, y));
                    bool can_show = IsOpticalFlow == 0 || moves_otherwise(beside, v);
                    front = can_show ? nearer_of(front, beside) : front;
                }
            }
            int2 of_front = vector_of(front);
            int2 front_before = 64 * at + part(of_front, phase_of(Phase, front, at));
            int2 front_after = front_before - of_front;
            int2 unused;
            [branch]
            if ((IsOpticalFlow != 0 ? !is_empty(front) : is_nearer(front, key)) && moves_otherwise(front, v) && nearest(front_before, unused) && nearest(front_after, unused))
            {
                float4 a, b;
                sample_both(front_before, front_after, a, b);
                bool is_seen = false;
                if (has_from && has_to)
                {
                    is_seen = alike(owner_at(from), key) && alike(own_of_field(to), key);
                }
                float own = is_seen ? apart_by(of_previous, of_current) : IsOpticalFlow != 0 ? UNSEEN_IF_FOUND : UNSEEN;
                float apart = apart_by(a, b);
                if (apart <= RIM && apart < own)
                {
                    colour = merged(a, b);
                    is_settled = true;
                }
            }
        }
        [branch]
        if (!is_settled)
        {
            bool is_before = false;
            if (has_from)
            {
                uint2 owner = owner_at(from);
                is_before = mark == ORPHAN || alike(owner, key) || mark_of(owner) == ORPHAN && !is_nearer(owner, key);
            }
            bool is_after = false;
            if (has_to)
            {
                uint2 shown = own_of_field(to);
                is_after = alike(shown, key) || mark != ORPHAN && mark != HOLE && is_nearer(key, shown);
            }
            bool is_fixed = false;
            [branch]
            if (is_doubtful && (is_before == is_after || !has_from || !has_to))
            {
                // Where it stands, where the previous anchor shows it, and where the current one does.
                [loop]
                for (uint look = 0; look < 3 && !is_fixed; look++)
                {
                    bool is_asked = look == 0 || (look == 1 ? is_before : is_after);
                    int2 place = look == 0 ? at : look == 1 ? from : to;
                    bool is_overlay = false;
                    [branch]
                    if (is_asked)
                    {
                        is_overlay = is_over(look == 1 ? PREVIOUS : CURRENT, place, look == 1 ? -v : v);
                    }
                    is_fixed = look == 0 && is_overlay;
                    is_before = is_before && !(look == 1 && is_overlay);
                    is_after = is_after && !(look == 2 && is_overlay);
                }
            }
            if (is_fixed)
            {
                stands_still = true;
                colour = merged(stored(PREVIOUS, at), stored(CURRENT, at));
            }
            else if (is_before && is_after)
            {
                [branch]
                if (is_doubtful && is_foreign(of_previous, after))
                {
                    colour = of_current;
                }
            }
            else if (is_before || is_after)
            {
                colour = is_before ? of_previous : of_current;
            }
            else
            {
                is_hidden = true;
            }
        }
    }
    else if (is_here)
    {
        // Across a cut, the nearer anchor.
        colour = stored(CutShowsCurrent != 0 ? CURRENT : PREVIOUS, at);
    }
    if (IsOpticalFlow != 0)
    {
        bool is_rough = is_live && tile.z != SMOOTH && all(extent(group.xy) == uint2(TILE, TILE));
        colour = softened(index, key, is_rough, is_hidden, stands_still, colour);
    }
    if (is_here && !is_hidden)
    {
        show(at, colour);
    }
    note_tile(group.xy, index, is_here, is_hidden, in_levels(colour), is_loose);
}
