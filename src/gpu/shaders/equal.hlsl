// Compares two buffers: sets the verdict to 1 if their bits differ, otherwise leaves it unchanged.

cbuffer Constants : register(b0)
{
    uint Words;   // 32-bit words; the last is padded equally in both
    uint Threads; // number of threads
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
        Verdict.InterlockedOr(0, 1u);
    }
}
