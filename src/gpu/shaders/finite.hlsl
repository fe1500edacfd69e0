// Whether every number of a buffer is finite: sets the verdict to 1 where one is not, and leaves it alone else.

cbuffer Constants : register(b0)
{
    uint Words;      // of four bytes, the last padded with zeroes
    uint2 Exponents; // the bits of a word that are all set where its one float, or its first or second half, is not finite
    uint Threads;    // all there are
};

ByteAddressBuffer Numbers : register(t0);
RWByteAddressBuffer Verdict : register(u0);

[numthreads(256, 1, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    bool bad = false;
    for (uint i = at.x; i < Words; i += Threads)
    {
        bad = bad || any((Numbers.Load(i * 4).xx & Exponents) == Exponents);
    }
    if (bad)
    {
        Verdict.InterlockedOr(0, 1);
    }
}
