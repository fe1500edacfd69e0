// What the shaders of a generated frame share: what is bound, what claims a place, and where it goes. The generator of the
// processor says what all of it is for; names are the same, and so are numbers to the bit, but for divisions and roots.

cbuffer Constants : register(b0)
{
    uint2 Size;         // pixels across and down
    uint2 Tiles;        // tiles of 8 x 8 across and down
    uint2 Reduced;      // pixels of the small pictures in which cuts are looked for
    uint Factor;        // pixels of the picture to one of those, across and down
    uint IsPair;        // 1: two anchors; 0: one, which goes on
    uint2 GuidanceTiles;// pixels to a side for which motion has one vector, and depth one value
    uint PastTile;      // the same for the depth of the previous anchor; 0: that is not known
    uint IsFloat;       // 1: pixels are floats; 0: bytes
    uint IsLight;       // 1: what is read is light
    uint WritesLight;   // 1: what is written is light
    uint IsStated;      // 1: a cut lies between the anchors, as the caller states
    uint HasHud;        // 1: it is known what lies over the current anchor
    int Phase;          // of the picture, in 1/4096 of the way from the previous to the current anchor
    int LandingPhase;   // to which claims are carried
    uint Borrows;       // 1: what owners borrow is carried as well
    uint Mark;          // of claims that are borrowed
    uint Turn;          // of a shader that runs several times, from 0 on
    uint Written;       // how a pixel is written: 0 RGBA bytes, 1 BGRA bytes, 2 RGB10A2, 3 halves, 4 R11G11B10_FLOAT
    uint Pitch;         // bytes of a row of what is written
    uint NearerIsCurrent; // 1: of the two anchors that nearer in time is the current one
    uint CutShowsCurrent; // 1: it is shown across a cut
    uint IsOpticalFlow; // 1: motion was found in pictures, and depth is one everywhere
    // Where things lie in `Small`, in bytes.
    uint AtGivenTiles;  // tiles of the guidance: key, kind, places that nothing claims
    uint AtFieldTiles;  // of the current anchor's motion
    uint AtOwnerTiles;  // of what is in the previous anchor
    uint AtTiles;       // of what claims land on
    uint AtCovers;      // what covers a tile while claims land
    uint AtLevels;      // a pyramid of the farthest keys
    uint AtHidden;      // 64 bits to a tile: what neither anchor shows
    uint AtKnown;       // sums of the colours of each tile
    uint AtCells;       // colours that tiles lend to what is hidden
    uint AtRuns;        // what leaves over the ends of rows and columns
    uint AtJoined;      // the same, joined with its neighbours
    uint AtRows;        // sums of a few rows, of which light is told
    uint AtLumas;       // the small pictures
    uint AtDetails;     // what remains of them without the mean around
    uint AtBlocks;      // what blocks of them say
    uint AtTiny;        // smaller pictures still
    uint AtShifts;      // how well these correlate
};

Texture2D<float4> Previous : register(t0);
Texture2D<float4> Current : register(t1);
Texture2D<float2> Motion : register(t2);
Texture2D<float> Depth : register(t3);
Texture2D<float> PastDepth : register(t4);
Texture2D<float> Hud : register(t5);

RWByteAddressBuffer Small : register(u0);
// Claims while they land: a key to a place, one more row and column of places on each side of the tiles.
RWByteAddressBuffer Scratch : register(u1);
// Keys to the pixels of the current anchor.
RWByteAddressBuffer Field : register(u2);
// Keys to the pixels of the previous anchor.
RWByteAddressBuffer Owners : register(u3);
// Keys to the pixels where claims land: of the previous anchor, or between the two.
RWByteAddressBuffer Places : register(u4);
RWByteAddressBuffer Picture : register(u5);

// What one word each says, in bytes from the start of `Small`.
static const uint IS_CUT = 0;
static const uint HAS_DEPTH = 4;
static const uint TOP = 8;
static const uint BOTTOM = 12;
static const uint LEFT = 16;
static const uint RIGHT = 20;
static const uint UNCOVERED = 24;
static const uint IS_HIDDEN = 28;
static const uint IS_BLANK = 32;
static const uint MARGIN = 36;
static const uint PERSPECTIVE = 40;   // nearness, slope across, slope down, corner, least, most
static const uint HAS_BACK = 64;
static const uint BACK = 68;          // three rows of four
static const uint UNEXPLAINED = 116;
static const uint IS_DOUBTED = 120;   // whether it may be a cut
static const uint SHIFT = 124;        // where the whole has gone, in small pixels: across, down
static const uint HISTOGRAM_DISTANCE = 132;

static const int TILE = 8;
static const int WHOLE = 4096;
static const int LONGEST = 4095 * 64;
static const uint ORPHAN = 254;
static const uint HOLE = 255;
static const uint SMOOTH = 0;
static const uint ROUGH = 1;
// 2^-24 in bits: what ranks are made from.
static const uint LEAST = 103u << 23;

// A key is two words of which the smaller wins, the upper one first: rank (16), mark (8) and the components of the vector in
// 1/64 px (20 each).
static const uint2 EMPTY = uint2(0xffffffff, 0xffffffff);

bool is_empty(uint2 key)
{
    return key.x == 0xffffffff;
}

uint2 key_of(uint rank, uint mark, int2 v)
{
    uint2 c = uint2(v + (1 << 19)) & 0xfffff;
    return uint2(rank << 16 | mark << 8 | c.x >> 12, c.x << 20 | c.y);
}

int2 vector_of(uint2 key)
{
    return int2((key.x & 0xff) << 12 | key.y >> 20, key.y & 0xfffff) - (1 << 19);
}

uint rank_of(uint2 key)
{
    return key.x >> 16;
}

uint mark_of(uint2 key)
{
    return key.x >> 8 & 0xff;
}

uint2 marked(uint2 key, uint mark)
{
    return uint2((key.x & 0xffff00ff) | mark << 8, key.y);
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

bool alike(uint2 a, uint2 b)
{
    return all(abs(vector_of(a) - vector_of(b)) <= 64);
}

bool is_nearer(uint2 a, uint2 b)
{
    return min(rank_of(a) + 32, 0xffff) < rank_of(b);
}

bool slopes(uint2 a, uint2 b)
{
    return all(abs(vector_of(a) - vector_of(b)) <= 256) && abs(int(rank_of(a)) - int(rank_of(b))) <= 2048;
}

int2 part(int2 v, int reach)
{
    return (v * reach + WHOLE / 2) >> 12;
}

int2 landed(int2 from, int2 v, int reach)
{
    return (64 * from + part(v, reach) + 32) >> 6;
}

// How near what claims a place is: 1 at the near plane, 0 at the far one.
float nearness_of(uint2 key)
{
    return asfloat(LEAST + (0xffff - rank_of(key) << 12));
}

// The rank of what is so near.
uint rank_of_nearness(float near)
{
    uint bits = asuint(min(near, 1.0));
    return 0xffff - (max(bits, LEAST) - LEAST >> 12);
}

// By how much what claims a pixel was farther off in the previous anchor.
float change_of(uint2 key, int2 at)
{
    float4 a = asfloat(Small.Load4(PERSPECTIVE));
    float2 ends = asfloat(Small.Load2(PERSPECTIVE + 16));
    precise float c = a.x * nearness_of(key) + (a.y * float(at.x) + (a.z * float(at.y) + a.w));
    c = c < ends.y ? c : ends.y;
    return c > ends.x ? c : ends.x;
}

// The phase at which even motion has what claims a pixel, at the picture's phase `phase`.
int phase_of(int phase, uint2 key, int2 at)
{
    float2 ends = asfloat(Small.Load2(PERSPECTIVE + 16));
    if (phase == 0 || ends.x >= ends.y)
    {
        return phase;
    }
    float left = float(WHOLE - phase) / WHOLE;
    precise float found = float(phase) / (1.0 + left * change_of(key, at));
    float latest = 3 * WHOLE - 2;
    found = found < latest ? found : latest;
    return int(round(found));
}

bool is_on(int2 at)
{
    return all(at >= 0) && all(at < int2(Size));
}

// The pixel nearest to a position in 1/64 px; whether that is on the picture.
bool nearest(int2 spot, out int2 at)
{
    at = (spot + 32) >> 6;
    return is_on(at);
}

uint pixel(int2 at)
{
    return uint(at.y) * Size.x + uint(at.x);
}

uint2 own_of_field(int2 at)
{
    return Field.Load2(8 * pixel(at));
}

// A tile of a layer: its key, kind, and how many places nothing claims.
uint4 tile_at(uint layer, uint2 tile)
{
    return Small.Load4(layer + 16 * (tile.y * Tiles.x + tile.x));
}

// Pixels of a tile across and down.
uint2 extent(uint2 tile)
{
    return min(uint2(TILE, TILE), Size - TILE * tile);
}

bool is_inside(int2 at)
{
    return at.y >= int(Small.Load(TOP)) && at.y < int(Small.Load(BOTTOM)) && at.x >= int(Small.Load(LEFT))
        && at.x < int(Small.Load(RIGHT));
}

// Whether something lies over the current anchor at a pixel that stands still and in front: a bar, or what the caller says.
bool is_still(int2 at)
{
    bool is_hud = false;
    if (HasHud != 0)
    {
        is_hud = Hud.Load(int3(at, 0)) > 0;
    }
    return is_hud || IsPair != 0 && !is_inside(at);
}

bool is_cut()
{
    return Small.Load(IS_CUT) != 0;
}
