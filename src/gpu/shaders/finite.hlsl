// Checks a buffer of floats: sets the verdict to 1 if one is not finite, otherwise leaves it unchanged.

cbuffer Constants : register(b0)
{
    uint Words;      // 32-bit words; the last is padded with zeros
    uint2 Exponents; // exponent bits of a word's float, or of its two half floats; all are set if it is not finite
    uint Threads;    // number of threads
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
        Verdict.InterlockedOr(0, 1u);
    }
}
