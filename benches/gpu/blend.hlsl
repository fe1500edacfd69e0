// The mean of two pictures, to which the cost of every generated frame is compared.

Texture2D<float4> Before : register(t0);
Texture2D<float4> After : register(t1);
RWTexture2D<unorm float4> Mean : register(u0);

[numthreads(8, 8, 1)]
void main(uint3 at : SV_DispatchThreadID)
{
    Mean[at.xy] = 0.5 * (Before[at.xy] + After[at.xy]);
}
