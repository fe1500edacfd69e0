// Whether two buffers hold the same bits: sets the verdict to 1 where they do not, and leaves it alone else.

cbuffer Constants : register(b0)
{
    uint Words;   // of four bytes, the last padded alike in both
    uint Threads; // all there are
};

ByteAddressBuffer Found : register(t0);
ByteAddressBuffer Expected : register(t1);
RWByteAddressBuffer Verdict : register(u0);

[numthreads(256, 1, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    bool differs = false;
    for (uint i = at.x; i < Words; i += Threads)
    {
        differs = differs || Found.Load(i * 4) != Expected.Load(i * 4);
    }
    if (differs)
    {
        Verdict.InterlockedOr(0, 1);
    }
}
