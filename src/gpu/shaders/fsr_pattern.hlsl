// Test pattern of two layers with known motion: a background, and in front of it a grid of square blocks. Writes a frame, its motion or
// depth, or the frame that a provider should generate half way between frames 0 and 1 with the motion it assumes.

cbuffer Constants : register(b0)
{
    uint2 Size;          // size of the picture written
    float2 Scale;        // pixels of a frame per pixel of the picture
    float2 Jitter;       // of the camera, in pixels of the picture
    uint Mode;
    float Number;        // of the frame; a provider gets 0 and 1
    float2 Background;   // motion from frame 0 to frame 1, in pixels of a frame
    float2 Foreground;   // the same for the blocks
    float2 OfBackground; // value of its pixels, or the motion that the provider assumes
    float2 OfForeground; // the same for the blocks
    float Side;          // of a block, in pixels of a frame
    float Wave;          // frequency factor, 1 for frames of 640 columns: the pattern scales with the size
    float Margin;        // pixels beside a block's edge that are not compared, in pixels of a frame
};

static const uint FRAME = 0, VALUES = 1, GENERATED = 2, REVERSED = 3, BLACK = 4;

// The provider's frame.
Texture2D<float4> Found : register(t0);
RWTexture2D<float4> Picture : register(u0);

// Whether a block of the unshifted grid, which has a period of two sides, covers a position; `larger` extends the block at each edge.
bool is_block(float2 at, float larger)
{
    float2 from_centre = abs(at / (2 * Side) - 0.25 - round(at / (2 * Side) - 0.25)) * 2 * Side;
    return all(from_centre < Side / 2 + larger);
}

float3 background(float2 at)
{
    float2 p = at * Wave;
    return 0.5 + 0.4 * sin(float3(p.x * 0.05, p.y * 0.07 + p.x * 0.02, p.x * 0.03 - p.y * 0.04));
}

float3 foreground(float2 at)
{
    float2 p = at * Wave;
    return 0.5 + 0.4 * sin(float3(p.y * 0.06 + 1, p.x * 0.05 - p.y * 0.03 + 2, p.x * 0.04 + p.y * 0.05 + 4));
}

float3 frame(float2 at, float number)
{
    float2 of_blocks = at - Foreground * number;
    return is_block(of_blocks, 0) ? foreground(of_blocks) : background(at - Background * number);
}

float3 generated(float2 at)
{
    bool is_front = is_block(at - Foreground / 2, 0);
    // With reversed depth the background occludes the blocks.
    if (Mode == REVERSED && !is_block(at + OfBackground / 2 - Foreground, 0))
    {
        is_front = false;
    }
    float2 half_way = (is_front ? OfForeground : OfBackground) / 2;
    return (frame(at + half_way, 1) + frame(at - half_way, 0)) / 2;
}

// Excludes content that is occluded in one of the frames, and the filtered edges.
bool is_compared(float2 at)
{
    bool is_front = is_block(at - Foreground / 2, -Margin);
    bool is_behind = !is_block(at - Foreground / 2, Margin) && !is_block(at + Background / 2 - Foreground, Margin)
        && !is_block(at - Background / 2, Margin);
    return is_front || is_behind;
}

[numthreads(8, 8, 1)]
void main(uint3 id : SV_DispatchThreadID)
{
    if (any(id.xy >= Size))
    {
        return;
    }
    float2 at = (float2(id.xy) + 0.5 - Jitter) * Scale - 0.5;
    float3 colour = 0;
    if (Mode == FRAME)
    {
        colour = frame(at, Number);
    }
    else if (Mode == VALUES)
    {
        colour.xy = is_block(at - Foreground * Number, 0) ? OfForeground : OfBackground;
    }
    else if (!is_compared(at))
    {
        colour = Found.Load(int3(id.xy, 0)).rgb;
    }
    else if (Mode != BLACK)
    {
        colour = Number != 0.5 ? frame(at, Number) : generated(at);
    }
    Picture[id.xy] = float4(colour, 1);
}
