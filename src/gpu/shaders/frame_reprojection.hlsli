// What the previous anchor alone shows, where its depth is known.

bool has_past()
{
    return PastTile != 0 && Small.Load(HAS_BACK) != 0;
}

// How near what the previous anchor shows at a pixel is; what is farthest, and what is no depth, is not near at all.
float near_in_past(int2 at)
{
    float depth = PastDepth.Load(int3(uint2(at) / PastTile, 0));
    return depth > 0 && depth < 1 ? 1 - depth : 0;
}

// What a pixel of the previous anchor claims if it is at rest; EMPTY for what is farthest.
uint2 claim_of_past(int2 at)
{
    float near = near_in_past(at);
    if (near <= 0)
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
        float4 row = asfloat(Small.Load4(BACK + 16 * i));
        precise float sum = (row.x * uv.x + row.y * uv.y) + (row.z + row.w * near);
        to[i] = sum;
    }
    if (!(to.z > 0.25))
    {
        return EMPTY;
    }
    precise float2 xy = to.xy / to.z * width + middle;
    float2 limit = float2(min(64 * int2(Size), LONGEST));
    precise float2 v = floor(min(max(64 * (float2(at) - xy), -limit), limit) + 0.5);
    return key_of(rank_of_nearness(near / to.z), ORPHAN, int2(v));
}

// Whether a claim from the previous anchor cannot be: the current one shows it, or what is behind it.
bool past_is_contradicted(int2 at, uint2 claim)
{
    int2 there;
    if (!nearest(64 * at - vector_of(claim), there))
    {
        return false;
    }
    uint2 shown = own_of_field(there);
    return alike(shown, claim) || is_nearer(claim, shown);
}

// What claims a pixel of the previous anchor that nothing in the current one does: what is at rest there, if that can be, or
// what was found beside it.
uint2 past_or(int2 at, uint2 found)
{
    uint2 claim = claim_of_past(at);
    if (is_empty(claim) || past_is_contradicted(at, claim))
    {
        return found;
    }
    float near = near_in_past(at);
    bool is_carried = !is_empty(found) && !alike(found, claim) && abs(nearness_of(found) - near) <= near / 32;
    return is_carried ? found : claim;
}

// Whether something stands in front of what claims a pixel of the previous anchor, of which the current one knows nothing.
bool is_covered_in_past(int2 at, uint2 key, int2 of_key)
{
    precise float other = 1.125 * nearness_of(key) / (1 + change_of(key, of_key));
    if (near_in_past(at) <= other)
    {
        return false;
    }
    uint2 claim = claim_of_past(at);
    return !is_empty(claim) && !past_is_contradicted(at, claim);
}
