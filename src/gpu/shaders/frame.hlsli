// Bindings of the shaders of a generated frame, splat keys, and warps. They compute the same as the CPU generator, whose modules document the
// purpose of each step, under the same names and with the same bits except for divisions and roots.

#include "constants.hlsli"

cbuffer Constants : register(b0)
{
    uint2 Size;             // width and height of the pictures, in pixels
    uint2 Tiles;            // columns and rows of tiles of 8x8 pixels
    uint2 Reduced;          // size of the reduced pictures for cut detection, in pixels
    uint Factor;            // reduction factor of these
    uint IsPair;            // 1: two anchors; 0: one, which is extrapolated
    uint2 GuidanceTiles;    // tile sizes of motion and depth, in pixels
    uint PreviousDepthTile; // tile size of the previous anchor's depth, in pixels; 0: no such depth
    uint IsFloat;           // 1: anchors are floats; 0: bytes
    uint IsLinear;          // 1: anchors are linear
    uint WritesLinear;      // 1: the target is linear
    uint IsCutStated;       // 1: the caller states a cut between the anchors
    uint HasHud;            // 1: there is an overlay mask
    int Phase;              // of the frame, in 1/4096 of the interval from the previous to the current anchor
    int SplatPhase;         // phase to which keys are splatted
    uint SplatsInherited;   // 1: keys with inherited motion are splatted as well
    uint InheritedTag;      // tag of keys with inherited motion
    uint Run;               // number of the run of a shader that runs several times, from 0
    uint TargetFormat;      // 0 RGBA bytes, 1 BGRA bytes, 2 RGB10A2, 3 half floats, 4 R11G11B10_FLOAT
    uint Pitch;             // bytes per row of the finished picture
    uint NearerIsCurrent;   // 1: the current anchor is the nearer one in time
    uint CutShowsCurrent;   // 1: the current anchor is shown across a cut
    uint IsOpticalFlow;     // 1: motion is optical flow, and depth is constant
    uint FindsOverlays;     // 1: static overlays are found in the pictures
    // Byte offsets into `Small`.
    uint AtGuidanceTiles;   // tiles of the guidance: key, kind, number of holes
    uint AtFieldTiles;      // tiles of the current anchor's keys
    uint AtPreviousTiles;   // tiles of the previous anchor's keys
    uint AtSplatTiles;      // tiles of the splat destination
    uint AtCoverage;        // coverage of each destination tile during splatting
    uint AtLevels;          // pyramid of the farthest keys
    uint AtHidden;          // pixels that neither anchor shows, 64 bits per tile
    uint AtColourSums;      // sums of the colours of each tile
    uint AtTileColours;     // colours of tiles with which hidden pixels are filled
    uint AtLumas;           // reduced pictures
    uint AtDetails;         // reduced pictures without the local mean
    uint AtBlocks;          // results of cut detection per block
    uint AtTiny;            // tiny pictures
    uint AtShifts;          // correlation of the tiny pictures per shift
};

Texture2D<float4> Previous : register(t0);
Texture2D<float4> Current : register(t1);
Texture2D<float2> Motion : register(t2);
Texture2D<float> Depth : register(t3);
Texture2D<float> PreviousDepth : register(t4);
Texture2D<float> Hud : register(t5);

RWByteAddressBuffer Small : register(u0);
// Keys during splatting: one per pixel of the tiles, with a border of one pixel.
RWByteAddressBuffer Scratch : register(u1);
// Keys of the current anchor's pixels.
RWByteAddressBuffer FieldKeys : register(u2);
// Keys of the previous anchor's pixels.
RWByteAddressBuffer PreviousKeys : register(u3);
// Keys of the splat destination: the previous anchor, or the frame between the anchors.
RWByteAddressBuffer SplatKeys : register(u4);
RWByteAddressBuffer Picture : register(u5);

// Results of one word, as byte offsets into `Small`.
static const uint IS_CUT = 0;
static const uint HAS_DEPTH = 4;
static const uint TOP = 8;
static const uint BOTTOM = 12;
static const uint LEFT = 16;
static const uint RIGHT = 20;
static const uint UNCOVERED = 24;
static const uint HAS_HIDDEN = 28;
static const uint HAS_EMPTY_SQUARE = 32;
static const uint DEPTH_CHANGE = 40;   // factor of the inverse depth, slopes along x and y, origin, minimum, maximum
static const uint HAS_REPROJECTION = 64;
static const uint REPROJECTION = 68;          // 3x4 matrix
static const uint UNEXPLAINED = 116;
static const uint IS_CUT_SUSPECTED = 120;   // whether a cut is suspected
static const uint GLOBAL_SHIFT = 124;        // global motion, in reduced pixels
static const uint HISTOGRAM_DISTANCE = 132;

static const uint UNIFORM = 0;
static const uint MIXED = 1;

// A splat key of two words, compared as one number with `x` the more significant; the smallest is kept. From the top: depth key (16 bits),
// tag (8), x and y of the motion vector in 1/64 px with an offset of 2^19 (20 each).
static const uint2 EMPTY = uint2(0xffffffff, 0xffffffff);

bool is_empty(uint2 key)
{
    return key.x == 0xffffffff;
}

uint2 pack(uint depth_key, uint tag, int2 v)
{
    uint2 c = uint2(v + (1 << 19)) & 0xfffff;
    return uint2(depth_key << 16 | tag << 8 | c.x >> 12, c.x << 20 | c.y);
}

int2 vector_of(uint2 key)
{
    return int2((key.x & 0xff) << 12 | key.y >> 20, key.y & 0xfffff) - (1 << 19);
}

uint depth_key_of(uint2 key)
{
    return key.x >> 16;
}

uint tag_of(uint2 key)
{
    return key.x >> 8 & 0xff;
}

uint2 with_tag(uint2 key, uint tag)
{
    return uint2((key.x & 0xffff00ff) | tag << 8, key.y);
}

bool is_less(uint2 a, uint2 b)
{
    return a.x < b.x || a.x == b.x && a.y < b.y;
}

uint2 nearer_of(uint2 a, uint2 b)
{
    return is_less(b, a) ? b : a;
}

uint2 farther_of(uint2 a, uint2 b)
{
    return is_less(a, b) ? b : a;
}

bool similar_motion(uint2 a, uint2 b)
{
    return all(abs(vector_of(a) - vector_of(b)) <= SIMILAR_MOTION);
}

bool is_in_front(uint2 a, uint2 b)
{
    return min(depth_key_of(a) + DEPTH_KEY_TOLERANCE, 0xffff) < depth_key_of(b);
}

bool same_slope(uint2 a, uint2 b)
{
    return all(abs(vector_of(a) - vector_of(b)) <= SLOPE_MOTION) && abs(int(depth_key_of(a)) - int(depth_key_of(b))) <= int(SLOPE_DEPTH_KEYS);
}

// A number of the same order without a sign, as atomics on memory need it in every shader language.
uint2 ordered_uint(int2 v)
{
    return asuint(v) ^ 0x80000000;
}

int4 from_ordered_uint(uint4 ordered)
{
    return asint(ordered ^ 0x80000000);
}

int2 scaled(int2 v, int fraction)
{
    return (v * fraction + PHASE_ONE / 2) >> 12;
}

int2 warped(int2 from, int2 v, int fraction)
{
    return (64 * from + scaled(v, fraction) + 32) >> 6;
}

// Inverse depth of a key: 1 at the near plane, 0 at the far one.
float key_inverse_depth(uint2 key)
{
    return asfloat(MIN_INVERSE_DEPTH_BITS + (0xffff - depth_key_of(key) << 12));
}

// Depth key of an inverse depth.
uint depth_key_from(float inverse_depth)
{
    uint bits = asuint(min(inverse_depth, 1.0));
    return 0xffff - (max(bits, MIN_INVERSE_DEPTH_BITS) - MIN_INVERSE_DEPTH_BITS >> 12);
}

// Relative change of a pixel's distance, `w0 / w1 - 1`.
float depth_change_of(uint2 key, int2 at)
{
    float4 a = asfloat(Small.Load4(DEPTH_CHANGE));
    float2 range = asfloat(Small.Load2(DEPTH_CHANGE + 16));
    precise float c = a.x * key_inverse_depth(key) + (a.y * float(at.x) + (a.z * float(at.y) + a.w));
    c = c < range.y ? c : range.y;
    return c > range.x ? c : range.x;
}

// Phase at which linear motion reaches a pixel's position at the picture's phase `phase`.
int phase_of(int phase, uint2 key, int2 at)
{
    float2 range = asfloat(Small.Load2(DEPTH_CHANGE + 16));
    if (phase == 0 || range.x >= range.y)
    {
        return phase;
    }
    float left = float(PHASE_ONE - phase) / PHASE_ONE;
    precise float found = float(phase) / (1.0 + left * depth_change_of(key, at));
    float latest = 3 * PHASE_ONE - 2;
    found = found < latest ? found : latest;
    return int(round(found));
}

bool is_in_picture(int2 at)
{
    return all(at >= 0) && all(at < int2(Size));
}

// The pixel nearest to a position in 1/64 px; returns whether that is inside the picture.
bool nearest_pixel(int2 position, out int2 at)
{
    at = (position + 32) >> 6;
    return is_in_picture(at);
}

uint pixel_index(int2 at)
{
    return uint(at.y) * Size.x + uint(at.x);
}

uint2 field_key(int2 at)
{
    return FieldKeys.Load2(8 * pixel_index(at));
}

// A tile of a key buffer: its key (x, y), kind and number of holes.
uint4 tile_at(uint layer, uint2 tile)
{
    return Small.Load4(layer + 16 * (tile.y * Tiles.x + tile.x));
}

// Width and height of a tile, in pixels.
uint2 extent(uint2 tile)
{
    return min(uint2(TILE, TILE), Size - TILE * tile);
}

bool is_in_active_area(int2 at)
{
    return at.y >= int(Small.Load(TOP)) && at.y < int(Small.Load(BOTTOM)) && at.x >= int(Small.Load(LEFT))
        && at.x < int(Small.Load(RIGHT));
}

// Whether a pixel of the current anchor is static foreground: a letterbox bar, or in the caller's overlay mask.
bool is_in_static_mask(int2 at)
{
    bool is_hud = false;
    if (HasHud != 0)
    {
        is_hud = Hud.Load(int3(at, 0)) > 0;
    }
    return is_hud || IsPair != 0 && !is_in_active_area(at);
}

bool is_cut()
{
    return Small.Load(IS_CUT) != 0;
}
