#include "CairnPass.h"

#include "CairnStream.h"

#if CAIRN_WITH_D3D12

#include "CairnEngine.h"

void CairnAddPass(
	FRDGBuilder& GraphBuilder, FRDGTextureRef Target, const TSharedRef<FCairnStream, ESPMode::ThreadSafe>& Stream, uint64 NowNs)
{
	FCairnPassParameters* const Parameters = CairnEngine::MakeParameters(GraphBuilder, Target);
	// Shaders run in the pass and its last command is a copy. The target's readers may be outside this graph, so the pass is never culled.
	GraphBuilder.AddPass(
		RDG_EVENT_NAME("Cairn"), Parameters, ERDGPassFlags::Compute | ERDGPassFlags::Copy | ERDGPassFlags::NeverCull,
		[Parameters, Stream, NowNs](FRHICommandListImmediate& RHICmdList)
		{
			CairnEngine::Enqueue(
				RHICmdList, Parameters,
				[Stream, NowNs](ID3D12GraphicsCommandList* List, ID3D12Resource* Texture)
				{
					CairnEngine::FFencePoint Point;
					Point.Value = Stream->Record(List, Texture, NowNs);
					Point.Fence = Point.Value > 0 ? Stream->GetFence() : nullptr;
					return Point;
				});
		});
}

#else

void CairnAddPass(FRDGBuilder&, FRDGTextureRef, const TSharedRef<FCairnStream, ESPMode::ThreadSafe>&, uint64) {}

uint64 CairnNow()
{
	return 0;
}

#endif
