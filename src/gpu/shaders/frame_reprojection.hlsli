// Reprojection of the previous anchor's depth, for pixels that are visible in the previous anchor only.

bool has_reprojection()
{
    return PreviousDepthTile != 0 && Small.Load(HAS_REPROJECTION) != 0;
}

// Inverse depth of a pixel of the previous anchor; 0 for the far plane and for invalid depths.
float previous_inverse_depth(int2 at)
{
    float depth = PreviousDepth.Load(int3(uint2(at) / PreviousDepthTile, 0));
    return depth > 0 && depth < 1 ? 1 - depth : 0;
}

// Key of a static pixel of the previous anchor; EMPTY if it cannot be reprojected.
uint2 reprojected_key(int2 at)
{
    float inverse_depth = previous_inverse_depth(at);
    if (inverse_depth <= 0)
    {
        return EMPTY;
    }
    float2 middle = float2(Size - 1) / 2;
    float width = float(Size.x);
    float2 uv = (float2(at) - middle) / width;
    float3 to;
    [unroll]
    for (uint i = 0; i < 3; i++)
    {
        float4 row = asfloat(Small.Load4(REPROJECTION + 16 * i));
        precise float sum = (row.x * uv.x + row.y * uv.y) + (row.z + row.w * inverse_depth);
        to[i] = sum;
    }
    if (!(to.z > 0.25))
    {
        return EMPTY;
    }
    precise float2 xy = to.xy / to.z * width + middle;
    float2 limit = float2(min(64 * int2(Size), MAX_COMPONENT));
    precise float2 v = floor(min(max(64 * (float2(at) - xy), -limit), limit) + 0.5);
    return pack(depth_key_from(inverse_depth / to.z), PREVIOUS_ONLY, int2(v));
}

// Whether the current anchor contradicts a reprojected key: it shows the key's surface, or one behind it.
bool is_contradicted_reprojection(int2 at, uint2 key)
{
    int2 there;
    if (!nearest_pixel(64 * at - vector_of(key), there))
    {
        return false;
    }
    uint2 key_there = field_key(there);
    return similar_motion(key_there, key) || is_in_front(key, key_there);
}

// Key of a pixel of the previous anchor that no pixel of the current one covers: the reprojected key if it is not contradicted, else the
// candidate. A candidate at the same depth that moves differently wins.
uint2 reprojected_or(int2 at, uint2 candidate)
{
    uint2 key = reprojected_key(at);
    if (is_empty(key) || is_contradicted_reprojection(at, key))
    {
        return candidate;
    }
    float inverse_depth = previous_inverse_depth(at);
    bool moves_with_candidate = !is_empty(candidate) && !similar_motion(candidate, key)
        && abs(key_inverse_depth(candidate) - inverse_depth) <= REPROJECTION_SAME_DEPTH * inverse_depth;
    return moves_with_candidate ? candidate : key;
}

// Whether a surface that is invisible in the current anchor occludes a pixel of the previous one.
bool is_occluded_in_previous(int2 at, uint2 key, int2 key_position)
{
    precise float threshold = REPROJECTION_OCCLUDER_RATIO * key_inverse_depth(key) / (1 + depth_change_of(key, key_position));
    if (previous_inverse_depth(at) <= threshold)
    {
        return false;
    }
    uint2 occluder = reprojected_key(at);
    return !is_empty(occluder) && !is_contradicted_reprojection(at, occluder);
}
