// Sets squares of tiles without visible pixels to the picture's mean; to black if no pixel is visible. One group.

#include "frame.hlsli"

static const uint THREADS = 256;

groupshared float4 Colours[THREADS];
groupshared float Weights[THREADS];

[numthreads(256, 1, 1)]
void main(uint thread : SV_GroupIndex)
{
    uint tiles = Small.Load(HAS_EMPTY_SQUARE) != 0 ? Tiles.x * Tiles.y : 0;
    float4 colour = 0;
    float weight = 0;
    for (uint i = thread; i < tiles; i += THREADS)
    {
        colour += asfloat(Small.Load4(AtColourSums + 20 * i));
        weight += asfloat(Small.Load(AtColourSums + 20 * i + 16));
    }
    Colours[thread] = colour;
    Weights[thread] = weight;
    GroupMemoryBarrierWithGroupSync();
    for (uint half = THREADS / 2; half > 0; half /= 2)
    {
        if (thread < half)
        {
            Colours[thread] += Colours[thread + half];
            Weights[thread] += Weights[thread + half];
        }
        GroupMemoryBarrierWithGroupSync();
    }
    float4 mean = float4(0, 0, 0, 255);
    if (Weights[0] > 0)
    {
        mean = Colours[0] / Weights[0];
    }
    for (uint cell = thread; cell < tiles; cell += THREADS)
    {
        if (asfloat(Small.Load(AtTileColours + 20 * cell + 16)) == 0)
        {
            Small.Store4(AtTileColours + 20 * cell, asuint(mean));
            Small.Store(AtTileColours + 20 * cell + 16, asuint(1.0));
        }
    }
}
