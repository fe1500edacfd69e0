// What motion and depth of the current anchor tell of how the camera goes, of what lies between bars: eleven numbers by least squares
// from a few hundred pixels; where not nearly all agree, from those that agree with the best of several guesses. What needs more
// than a float has two. Also how the light of the two anchors differs. One group.

#include "frame.hlsli"
#include "double_float.hlsli"

static const uint LIGHTS = 64;
static const uint2 ASKED = uint2(20, 12);
static const uint SAMPLES = 240;
static const float AGREED = 0.5;
static const uint GUESSES = 24;
static const uint GUESSED_FROM = 6;
static const uint NUMBERS = 11;
// Entries of a triangle of numbers, and of what stands right of it.
static const uint TRIANGLE = 66;
static const uint ENTRIES = 77;

// Knuth's MMIX generator from 1 on, without the lower 33 bits.
static const uint RANDOM[144] =
{
    908834774, 1093944153, 1392341196, 822192870, 1708211034, 1074839795, 1189567130, 140486902, 1803298089,
    426146746, 1601520123, 1150530802, 1682947452, 680858400, 523087034, 1610444812, 911684890, 1228670495,
    1337093332, 436429365, 1859467627, 2103721357, 1180584926, 1334893410, 831492669, 1692817328, 1266356004,
    117939872, 2071799121, 1906775968, 608200607, 1374987538, 688839708, 1175113925, 1158372494, 533141082,
    1718403786, 394474858, 37380316, 656418589, 482739455, 1369587172, 2119158410, 770417080, 1249254861, 618054934,
    399563508, 1201712901, 28406063, 391455394, 984900522, 617997544, 1364384636, 7673794, 1281938461, 2091209000,
    764341718, 2013003955, 1795705207, 157133830, 604743753, 1365789462, 507872748, 1806540341, 1415970151, 190801055,
    1141628083, 480884856, 1962063522, 266621479, 1075841442, 451693341, 740520689, 2105384108, 1690019975,
    2066809988, 79738089, 784673094, 1314613935, 1227025925, 1020159361, 211819947, 942966199, 161510978, 299002642,
    554815857, 1431204920, 40102131, 186427448, 1167932542, 1457584022, 91427608, 1937264127, 1837909334, 1489476929,
    1116992738, 781101941, 1846053444, 1510409499, 979403040, 1213155369, 425751264, 1543602590, 2132147786,
    473200398, 1394691133, 874726676, 633766899, 680606958, 623239532, 431608954, 1840424448, 1603652883, 1936177049,
    602668305, 920036969, 795010395, 1968016884, 1876175849, 1326006200, 1292171382, 307973244, 1498976071, 874638097,
    1440355075, 1232874369, 495446914, 1958416728, 340578886, 763585204, 1835566148, 1261545781, 1234806524,
    1610932083, 1207922366, 1839948950, 568697870, 1981494699, 1648148983, 887041119, 1334714574, 580271668,
    801694302, 105918053
};

// Of each sample its place, where it was, and how near it is; lengths are in widths of the picture from its middle.
groupshared float4 At[SAMPLES];
groupshared float4 Was[SAMPLES];
groupshared float2 Near[SAMPLES];
groupshared uint IsAsked[SAMPLES];
groupshared uint IsCounted[SAMPLES];
// For what is solved and for each guess a triangle of sums, and right of it what becomes the numbers.
groupshared float2 Entries[GUESSES + 1][ENTRIES];
groupshared uint Agreeing[GUESSES + 1];
groupshared float4 Light[2][LIGHTS];
groupshared uint Count;
groupshared uint IsFound;
groupshared uint Nearest;
groupshared uint Farthest;
groupshared uint2 Ends;

// What number `k` counts with in the equation of one component.
float2 counts_with(uint sample, uint component, uint k)
{
    float4 at = At[sample];
    float2 was = component == 0 ? Was[sample].xy : Was[sample].zw;
    uint of = k < 8 ? k - 4 * component : k - 8;
    float2 plain = of == 0 ? at.xy : of == 1 ? at.zw : k < 8 && of == 2 ? float2(1, 0) : Near[sample];
    float2 scaled = -multiplied(was, plain);
    return k < 8 ? plain : scaled;
}

float2 left_of(uint sample, uint component)
{
    return component == 0 ? added(Was[sample].xy, -At[sample].xy) : added(Was[sample].zw, -At[sample].zw);
}

// Row and column of an entry of the triangle.
uint2 entry_of(uint number)
{
    uint row = 0;
    [unroll]
    for (uint next = 1; next < NUMBERS; next++)
    {
        row += number >= next * (next + 1) / 2 ? 1 : 0;
    }
    return uint2(row, number - row * (row + 1) / 2);
}

// Whether number `k` counts in the equation of a component.
bool counts_in(uint component, uint k)
{
    return k >= 8 || k / 4 == component;
}

// What one sample adds to an entry; those beyond the triangle stand right of it.
float2 part_of(uint sample, uint number, uint2 entry)
{
    float2 sum = 0;
    [loop]
    for (uint component = 0; component < 2; component++)
    {
        bool is_right = number >= TRIANGLE;
        uint row = is_right ? number - TRIANGLE : entry.x;
        if (counts_in(component, row) && (is_right || counts_in(component, entry.y)))
        {
            float2 a = counts_with(sample, component, row);
            float2 b = is_right ? left_of(sample, component) : counts_with(sample, component, entry.y);
            sum = added(sum, multiplied(a, b));
        }
    }
    return sum;
}

float number(uint solver, uint k)
{
    return Entries[solver][TRIANGLE + k].x;
}

float2 exact_number(uint k)
{
    return Entries[0][TRIANGLE + k];
}

// By how much what a sample shows was farther off.
float change(uint sample, uint solver)
{
    return number(solver, 8) * At[sample].x + number(solver, 9) * At[sample].z + number(solver, 10) * Near[sample].x;
}

// The square of how far it was from where it is expected.
float error_of(uint sample, uint solver)
{
    float2 at = At[sample].xz;
    float2 was = Was[sample].xz;
    float near = Near[sample].x;
    float by = change(sample, solver);
    float2 moved = float2(number(solver, 0), number(solver, 4)) * at.x + float2(number(solver, 1), number(solver, 5)) * at.y
        + float2(number(solver, 2), number(solver, 6)) + float2(number(solver, 3), number(solver, 7)) * near;
    float2 told = float2(left_of(sample, 0).x, left_of(sample, 1).x);
    float2 apart = (moved - told - was * by) / (1 + by);
    return dot(apart, apart);
}

[numthreads(256, 1, 1)]
void main(uint thread : SV_GroupIndex)
{
    uint i;
    float4 before = 0;
    float4 after = 0;
    uint2 sparse = (Size + 7) / 8;
    if (IsPair != 0)
    {
        [loop]
        for (i = thread; i < sparse.y && thread < LIGHTS; i += LIGHTS)
        {
            before += asfloat(Small.Load4(AtRows + 32 * i));
            after += asfloat(Small.Load4(AtRows + 32 * i + 16));
        }
    }
    if (thread < LIGHTS)
    {
        Light[0][thread] = before;
        Light[1][thread] = after;
    }
    if (thread == 0)
    {
        Count = 0;
        Nearest = 0;
        Farthest = asuint(1.0);
        IsFound = 0;
        Ends = 0;
    }
    GroupMemoryBarrierWithGroupSync();
    [loop]
    for (uint half = LIGHTS / 2; half > 0; half /= 2)
    {
        if (thread < half)
        {
            Light[0][thread] += Light[0][thread + half];
            Light[1][thread] += Light[1][thread + half];
        }
        GroupMemoryBarrierWithGroupSync();
    }
    if (thread == 0)
    {
        float count = float(sparse.x * sparse.y);
        float4 apart = abs(Light[1][0] / count - Light[0][0] / count);
        Small.Store(MARGIN, asuint(24 + 4 * max(max(apart.x, apart.y), max(apart.z, apart.w))));
    }

    // Samples, in their order.
    bool is_asked = false;
    float2 motion = 0;
    float depth = 0;
    uint2 pixel_at = 0;
    if (thread < SAMPLES)
    {
        pixel_at = (2 * uint2(thread % ASKED.x, thread / ASKED.x) + 1) * Size / (2 * ASKED);
        motion = Motion.Load(int3(pixel_at / GuidanceTiles.x, 0));
        depth = Depth.Load(int3(pixel_at / GuidanceTiles.y, 0));
        is_asked = all((asuint(motion) & 0x7f800000) != 0x7f800000) && depth >= 0 && depth <= 1;
        is_asked = is_asked && !is_still(int2(pixel_at));
        is_asked = is_asked && all(Size >= ASKED) && !is_cut();
        IsAsked[thread] = is_asked ? 1 : 0;
    }
    GroupMemoryBarrierWithGroupSync();
    if (is_asked)
    {
        uint place = 0;
        [loop]
        for (i = 0; i < thread; i++)
        {
            place += IsAsked[i];
        }
        float2 width = float2(float(Size.x), 0);
        float2 center = float2(pixel_at / GuidanceTiles.x * GuidanceTiles.x) + float(GuidanceTiles.x - 1) / 2;
        center -= float2(Size - 1) / 2;
        float2 x = float2(center.x, 0);
        float2 y = float2(center.y, 0);
        At[place] = float4(divided(x, width), divided(y, width));
        Was[place] = float4(divided(exact_sum(center.x, motion.x), width), divided(exact_sum(center.y, motion.y), width));
        float near = 1 - depth;
        Near[place] = float2(near, 0);
        IsCounted[place] = 1;
        InterlockedMax(Nearest, asuint(near));
        InterlockedMin(Farthest, asuint(near));
        InterlockedAdd(Count, 1);
    }
    GroupMemoryBarrierWithGroupSync();
    uint samples = Count;
    float2 nearest_depth = float2(asfloat(Nearest), 0);
    // Without depths forward motion cannot be told from a picture that grows.
    precise float three_quarters = 0.75 * nearest_depth.x;
    bool has_depth = asfloat(Farthest) < three_quarters;
    if (thread < samples)
    {
        float2 scaled = 0;
        if (has_depth)
        {
            scaled = divided(Near[thread], nearest_depth);
        }
        Near[thread] = scaled;
    }
    GroupMemoryBarrierWithGroupSync();
    float within = AGREED / float(Size.x);
    float bound = within * within;
    uint2 entry = entry_of(min(thread, TRIANGLE - 1));

    // Always 0: the compiler would take loops apart whose first turn it can count.
    uint none = IsPair >> 1;
    uint stages = 3 - none;
    uint numbers = NUMBERS - none;

    // First of all samples, with guesses beside; then twice of those that agree.
    [loop]
    for (uint stage = none; stage < stages; stage++)
    {
        if (thread < ENTRIES)
        {
            float2 sum = 0;
            [loop]
            for (i = 0; i < samples; i++)
            {
                if (IsCounted[i] != 0)
                {
                    sum = added(sum, part_of(i, thread, entry));
                }
            }
            Entries[0][thread] = sum;
        }
        GroupMemoryBarrierWithGroupSync();
        uint solvers = stage == 0 ? GUESSES + 1 : 1;
        if (thread < solvers && samples > 0)
        {
            [loop]
            for (i = 0; i < ENTRIES && thread > 0; i++)
            {
                uint2 place = entry_of(min(i, TRIANGLE - 1));
                float2 sum = 0;
                [loop]
                for (uint from = 0; from < GUESSED_FROM; from++)
                {
                    sum = added(sum, part_of(RANDOM[GUESSED_FROM * (thread - 1) + from] % samples, i, place));
                }
                Entries[thread][i] = sum;
            }
            // Cholesky's method.
            [loop]
            for (uint row = none; row < numbers; row++)
            {
                uint of_row = row * (row + 1) / 2;
                // Where pixels cannot tell, the numbers are near zero.
                Entries[thread][of_row + row] = added(Entries[thread][of_row + row], float2(9.99999997e-7, 2.5248e-14));
                [loop]
                for (uint column = none; column <= row; column++)
                {
                    uint of_column = column * (column + 1) / 2;
                    float2 sum = Entries[thread][of_row + column];
                    [loop]
                    for (uint k = 0; k < column; k++)
                    {
                        sum = added(sum, -multiplied(Entries[thread][of_row + k], Entries[thread][of_column + k]));
                    }
                    bool is_last = column == row;
                    float2 result = is_last ? root(sum) : divided(sum, Entries[thread][of_column + column]);
                    Entries[thread][of_row + column] = result;
                }
                float2 right = Entries[thread][TRIANGLE + row];
                [loop]
                for (uint k = 0; k < row; k++)
                {
                    right = added(right, -multiplied(Entries[thread][of_row + k], Entries[thread][TRIANGLE + k]));
                }
                Entries[thread][TRIANGLE + row] = divided(right, Entries[thread][of_row + row]);
            }
            bool is_solved = true;
            [loop]
            for (uint up = none; up < numbers; up++)
            {
                uint of = NUMBERS - 1 - up;
                float2 right = Entries[thread][TRIANGLE + of];
                [loop]
                for (uint k = of + 1; k < numbers; k++)
                {
                    right = added(right, -multiplied(Entries[thread][k * (k + 1) / 2 + of], Entries[thread][TRIANGLE + k]));
                }
                float2 result = divided(right, Entries[thread][of * (of + 1) / 2 + of]);
                Entries[thread][TRIANGLE + of] = result;
                is_solved = is_solved && (asuint(result.x) & 0x7f800000) != 0x7f800000;
            }
            uint agreeing = 0;
            [loop]
            for (i = 0; i < samples; i++)
            {
                agreeing += error_of(i, thread) <= bound ? 1 : 0;
            }
            // One more than agree, and nothing for none.
            Agreeing[thread] = is_solved ? agreeing + 1 : 0;
        }
        GroupMemoryBarrierWithGroupSync();
        if (thread == 0)
        {
            uint best = 0;
            uint most = Agreeing[0];
            bool is_lost = samples * 2 < SAMPLES || most == 0 || stage > 0 && IsFound == 0;
            [loop]
            for (uint guess = 1; guess < solvers && 10 * (most - 1) < 9 * samples; guess++)
            {
                if (Agreeing[guess] > most)
                {
                    best = guess;
                    most = Agreeing[guess];
                }
            }
            [loop]
            for (i = 0; i < NUMBERS; i++)
            {
                Entries[0][TRIANGLE + i] = Entries[best][TRIANGLE + i];
            }
            IsFound = is_lost || stage == 2 && 2 * (most - 1) < samples ? 0 : 1;
        }
        GroupMemoryBarrierWithGroupSync();
        if (thread < samples)
        {
            bool agrees = error_of(thread, 0) <= bound;
            IsCounted[thread] = agrees ? 1 : 0;
            if (stage == 2 && agrees)
            {
                // Of numbers of one sign the bits are in order.
                float by = change(thread, 0);
                if (by < 0)
                {
                    InterlockedMax(Ends.x, asuint(-by));
                }
                else
                {
                    InterlockedMax(Ends.y, asuint(by));
                }
            }
        }
        GroupMemoryBarrierWithGroupSync();
    }
    if (thread != 0 || IsFound == 0)
    {
        return;
    }
    float2 width = float2(float(Size.x), 0);
    float2 middle = float2(Size - 1) / 2;
    float2 across = divided(exact_number(8), width);
    float2 down = divided(exact_number(9), width);
    float2 corner = added(-multiplied(across, float2(middle.x, 0)), -multiplied(down, float2(middle.y, 0)));
    float2 of_nearness = 0;
    if (has_depth)
    {
        of_nearness = divided(exact_number(10), nearest_depth);
    }
    float least = min(max(-1.25 * asfloat(Ends.x) - 0.02, -0.5), 0.9);
    float most = min(max(1.25 * asfloat(Ends.y) + 0.02, -0.5), 0.9);
    Small.Store4(PERSPECTIVE, asuint(float4(of_nearness.x, across.x, down.x, corner.x)));
    Small.Store2(PERSPECTIVE + 16, asuint(float2(least, most)));
    if (!has_depth)
    {
        return;
    }
    // The way back: the inverse of what places count with, and what nearness does then.
    float2 one = float2(1, 0);
    float2 a[9] = { added(exact_number(0), one), exact_number(1), exact_number(2), exact_number(4), added(exact_number(5), one),
        exact_number(6), exact_number(8), exact_number(9), one };
    float2 minors[9];
    [loop]
    for (uint m = 0; m < 9; m++)
    {
        uint2 r = uint2((m / 3 + 1) % 3, (m / 3 + 2) % 3);
        uint2 c = uint2((m % 3 + 1) % 3, (m % 3 + 2) % 3);
        float2 first = multiplied(a[3 * r.x + c.x], a[3 * r.y + c.y]);
        minors[m] = added(first, -multiplied(a[3 * r.x + c.y], a[3 * r.y + c.x]));
    }
    float2 whole = added(added(multiplied(a[0], minors[0]), multiplied(a[1], minors[1])), multiplied(a[2], minors[2]));
    bool is_finite = true;
    [loop]
    for (uint r = 0; r < 3; r++)
    {
        float4 row = 0;
        float2 of_near = 0;
        [unroll]
        for (uint c = 0; c < 3; c++)
        {
            float2 inverse = divided(minors[3 * c + r], whole);
            float2 counts = c == 0 ? exact_number(3) : c == 1 ? exact_number(7) : exact_number(10);
            of_near = added(of_near, -multiplied(inverse, divided(counts, nearest_depth)));
            row[c] = inverse.x;
        }
        row.w = of_near.x;
        is_finite = is_finite && all((asuint(row) & 0x7f800000) != 0x7f800000);
        Small.Store4(BACK + 16 * r, asuint(row));
    }
    Small.Store(HAS_BACK, is_finite ? 1 : 0);
}
