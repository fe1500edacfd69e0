#pragma once

#include "CoreMinimal.h"
#include "RenderGraphFwd.h"

class FCairnStream;
class FRDGBuilder;

/**
 * Adds a pass that records the frame that is due into the engine's command list. The graph brings the texture into the state that Cairn
 * is told, and knows that it was written. Before the first anchor is made the pass leaves the texture as it is. Render thread; at most
 * once in a frame of the engine for each stream, so the component that the stream is of has bDrawIntoTarget switched off.
 *
 * Target: of two dimensions with one level, slice and sample, of any size; RGBA8 or BGRA8, or RGBA16F where the component has
 * bLinearFrames.
 * NowNs: when the frame will be shown, as CairnNow says it.
 */
CAIRNRUNTIME_API void CairnAddPass(
	FRDGBuilder& GraphBuilder, FRDGTextureRef Target, const TSharedRef<FCairnStream, ESPMode::ThreadSafe>& Stream, uint64 NowNs);

/** The clock of all streams, in nanoseconds. Any thread. */
CAIRNRUNTIME_API uint64 CairnNow();
