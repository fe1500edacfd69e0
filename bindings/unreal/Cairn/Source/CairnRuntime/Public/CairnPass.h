#pragma once

#include "CoreMinimal.h"

class FCairnStream;
class FRDGBuilder;
class FRDGTexture;
/* As the engine's own RenderGraphFwd.h, which 5.1 does not have. */
using FRDGTextureRef = FRDGTexture*;

/**
 * Adds a pass that records the frame that is due into the engine's command list. The graph transitions the texture into the state that Cairn
 * expects, and knows that it was written. Before the first anchor the pass leaves the texture as it is. Render thread; at most once per
 * stream in a frame of the engine, so switch bDrawIntoTarget off in the stream's component.
 *
 * Target: two-dimensional, with one mip level, slice and sample, of any size; RGBA8 or BGRA8, or RGBA16F if the component has
 * bLinearFrames. Before 5.6 it must have been created with TexCreate_RenderTargetable or TexCreate_UAV, as render targets are: the engine follows
 * the states of no other textures.
 * NowNs: time at which the frame will be shown, on the clock of CairnNow.
 */
CAIRNRUNTIME_API void CairnAddPass(
	FRDGBuilder& GraphBuilder, FRDGTextureRef Target, const TSharedRef<FCairnStream, ESPMode::ThreadSafe>& Stream, uint64 NowNs);

/** The clock of all streams, in nanoseconds. Any thread. */
CAIRNRUNTIME_API uint64 CairnNow();
