// Colours of a frame between the anchors: the sample nearer in time where they agree, the visible one where one anchor is occluded,
// otherwise a blend. A group per tile.

#include "constants.hlsli"
#include "frame.hlsli"
#include "frame_colour.hlsli"
#include "frame_static_overlay.hlsli"
#include "frame_tile_result.hlsli"
#include "frame_edge_antialiasing.hlsli"

groupshared uint IsPartlyHidden;

uint2 frame_key(int2 at)
{
    return SplatKeys.Load2(8 * pixel_index(at));
}

uint2 previous_key(int2 at)
{
    return PreviousKeys.Load2(8 * pixel_index(at));
}

bool moves_otherwise(uint2 key, int2 v)
{
    return any(abs(vector_of(key) - v) > RENDER_DISTINCT_MOTION);
}

// Whether a position lies in a uniform tile with motion similar to `key`.
bool is_in_uniform(uint layer, int2 position, uint2 key)
{
    int2 at;
    if (!nearest_pixel(position, at))
    {
        return false;
    }
    uint4 key_there = tile_at(layer, uint2(at) / TILE);
    return key_there.z == UNIFORM && (similar_motion(key_there.xy, key) || same_slope(key_there.xy, key));
}

// Samples both anchors, each at its own position.
void sample_both(int2 previous_position, int2 current_position, out float4 of_previous, out float4 of_current)
{
    of_previous = 0;
    of_current = 0;
    [loop]
    for (uint anchor = PREVIOUS; anchor <= CURRENT; anchor++)
    {
        float4 found = sampled(anchor, anchor == PREVIOUS ? previous_position : current_position);
        of_previous = anchor == PREVIOUS ? found : of_previous;
        of_current = found;
    }
}

[numthreads(8, 8, 1)]
void main(uint3 group : SV_GroupID, uint3 thread : SV_DispatchThreadID, uint index : SV_GroupIndex)
{
    int2 at = int2(thread.xy);
    bool is_inside = is_in_picture(at);
    bool is_generated = is_inside && !is_cut();
    if (index == 0)
    {
        IsPartlyHidden = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    uint4 tile = tile_at(AtSplatTiles, group.xy);
    // A complete uniform tile moves like its centre.
    bool is_whole = tile.z == UNIFORM && all(extent(group.xy) == uint2(TILE, TILE));
    uint2 key = EMPTY;
    if (is_generated)
    {
        key = frame_key(at);
    }
    int2 v = vector_of(key);
    int phase_of_tile = 0;
    if (is_generated && is_whole)
    {
        phase_of_tile = phase_of(Phase, tile.xy, TILE * int2(group.xy) + TILE / 2);
        int2 position = 64 * at + scaled(v, phase_of_tile);
        if (!(is_in_uniform(AtPreviousTiles, position, tile.xy) && is_in_uniform(AtFieldTiles, position - v, tile.xy)))
        {
            InterlockedOr(IsPartlyHidden, 1);
        }
    }
    GroupMemoryBarrierWithGroupSync();
    bool is_visible_tile = is_whole && IsPartlyHidden == 0;
    bool is_hidden = false;
    bool is_uncovered = false;
    bool is_static_pixel = false;
    float4 colour = 0;
    [branch]
    if (is_generated)
    {
        // Positions in the two anchors.
        int phase = is_whole ? phase_of_tile : phase_of(Phase, key, at);
        int2 previous_position = 64 * at + scaled(v, phase);
        int2 current_position = previous_position - v;
        float4 of_previous, of_current;
        sample_both(previous_position, current_position, of_previous, of_current);
        colour = merged(of_previous, of_current);
        int2 from, to;
        bool has_from = nearest_pixel(previous_position, from);
        bool has_to = nearest_pixel(current_position, to);
        uint tag = tag_of(key);
        is_uncovered = tag == HOLE || tag == PREVIOUS_ONLY;
        bool is_doubtful = differ(of_previous, of_current, IsOpticalFlow != 0 ? RENDER_DOUBT_THRESHOLD_OF_FLOW : RENDER_DOUBT_THRESHOLD)
            || is_uncovered || !has_from || !has_to;
        bool is_decided = !is_doubtful && (is_visible_tile || !differ(of_previous, of_current, RENDER_STRICT_DOUBT_THRESHOLD));
        [branch]
        if (!is_decided && !is_visible_tile)
        {
            // Beside foreground, a pixel belongs to that if the anchors then agree better. Without depth, any different motion may be
            // foreground.
            uint2 foreground = EMPTY;
            [loop]
            for (int y = max(at.y - 1, 0); y <= min(at.y + 1, int(Size.y) - 1); y++)
            {
                [loop]
                for (int x = max(at.x - 1, 0); x <= min(at.x + 1, int(Size.x) - 1); x++)
                {
                    uint2 neighbour = frame_key(int2(x, y));
                    bool can_show = IsOpticalFlow == 0 || moves_otherwise(neighbour, v);
                    foreground = can_show ? nearer_of(foreground, neighbour) : foreground;
                }
            }
            int2 foreground_vector = vector_of(foreground);
            int2 foreground_previous = 64 * at + scaled(foreground_vector, phase_of(Phase, foreground, at));
            int2 foreground_current = foreground_previous - foreground_vector;
            int2 unused;
            [branch]
            if ((IsOpticalFlow != 0 ? !is_empty(foreground) : is_in_front(foreground, key)) && moves_otherwise(foreground, v)
                && nearest_pixel(foreground_previous, unused) && nearest_pixel(foreground_current, unused))
            {
                float4 a, b;
                sample_both(foreground_previous, foreground_current, a, b);
                bool is_visible = false;
                if (has_from && has_to)
                {
                    is_visible = similar_motion(previous_key(from), key) && similar_motion(field_key(to), key);
                }
                float own_difference = is_visible ? colour_difference(of_previous, of_current)
                    : IsOpticalFlow != 0 ? RENDER_OCCLUDED_DIFFERENCE_OF_FLOW : RENDER_OCCLUDED_DIFFERENCE;
                float foreground_difference = colour_difference(a, b);
                if (foreground_difference <= RENDER_EDGE_TOLERANCE && foreground_difference < own_difference)
                {
                    colour = merged(a, b);
                    is_decided = true;
                }
            }
        }
        [branch]
        if (!is_decided)
        {
            bool in_previous = false;
            if (has_from)
            {
                uint2 key_there = previous_key(from);
                in_previous = tag == PREVIOUS_ONLY || similar_motion(key_there, key)
                    || tag_of(key_there) == PREVIOUS_ONLY && !is_in_front(key_there, key);
            }
            bool in_current = false;
            if (has_to)
            {
                uint2 key_there = field_key(to);
                in_current = similar_motion(key_there, key) || tag != PREVIOUS_ONLY && tag != HOLE && is_in_front(key, key_there);
            }
            bool is_static = false;
            [branch]
            if (is_doubtful && FindsOverlays != 0 && (in_previous == in_current || !has_from || !has_to))
            {
                // Overlay tests: the pixel itself, then its positions in the previous and in the current anchor.
                [loop]
                for (uint test = 0; test < 3 && !is_static; test++)
                {
                    bool is_tested = test == 0 || (test == 1 ? in_previous : in_current);
                    int2 pixel = test == 0 ? at : test == 1 ? from : to;
                    bool has_overlay = false;
                    [branch]
                    if (is_tested)
                    {
                        has_overlay = is_overlay(test == 1 ? PREVIOUS : CURRENT, pixel, test == 1 ? -v : v);
                    }
                    is_static = test == 0 && has_overlay;
                    in_previous = in_previous && !(test == 1 && has_overlay);
                    in_current = in_current && !(test == 2 && has_overlay);
                }
            }
            if (is_static)
            {
                is_static_pixel = true;
                colour = merged(load_pixel(PREVIOUS, at), load_pixel(CURRENT, at));
            }
            else if (in_previous != in_current)
            {
                colour = in_previous ? of_previous : of_current;
            }
            else if (!in_previous)
            {
                is_hidden = true;
            }
        }
    }
    else if (is_inside)
    {
        // Across a cut, the nearer anchor.
        colour = load_pixel(CutShowsCurrent != 0 ? CURRENT : PREVIOUS, at);
    }
    if (IsOpticalFlow != 0)
    {
        bool is_mixed = is_generated && tile.z != UNIFORM && all(extent(group.xy) == uint2(TILE, TILE));
        colour = antialiased(index, key, is_mixed, is_hidden, is_static_pixel, colour);
    }
    if (is_inside && !is_hidden)
    {
        store_pixel(at, colour);
    }
    store_tile_result(group.xy, index, is_inside, is_hidden, in_levels(colour), is_uncovered);
}
