#pragma once

/*
 * Everything that differs between engine versions 5.1 to 5.8: how to get and return a command list (5.5), and how to make the engine record
 * its pending barriers before others record (5.6). 5.7 and 5.8 have the functions of 5.6.
 */

#include "CoreMinimal.h"
#include "Misc/EngineVersionComparison.h"
#include "RHICommandList.h"
#include "RenderGraphBuilder.h"
#include "RenderGraphUtils.h"
#include "ShaderParameterMacros.h"

#if UE_VERSION_OLDER_THAN(5, 1, 0)
#error "Cairn needs Unreal Engine 5.1 or later: earlier ones have no public interface to their Direct3D 12 device"
#endif

#if CAIRN_WITH_D3D12

#include "ID3D12DynamicRHI.h"

/* From 5.6 on the engine has a function that records its pending barriers. Before, it records them when it copies a texture. */
#define CAIRN_FLUSHES_BY_COPY UE_VERSION_OLDER_THAN(5, 6, 0)

BEGIN_SHADER_PARAMETER_STRUCT(FCairnPassParameters, )
	RDG_TEXTURE_ACCESS(Target, ERHIAccess::CopyDest)
#if CAIRN_FLUSHES_BY_COPY
	RDG_TEXTURE_ACCESS(FlushFrom, ERHIAccess::CopySrc)
	RDG_TEXTURE_ACCESS(FlushTo, ERHIAccess::CopyDest)
#endif
END_SHADER_PARAMETER_STRUCT()

namespace CairnEngine
{
	/** The only graphics card: with several, Cairn does not start. */
	constexpr uint32 DeviceIndex = 0;

	/** Parameters of a pass that writes Target, with the extra texture that some versions need. */
	inline FCairnPassParameters* MakeParameters(FRDGBuilder& GraphBuilder, FRDGTextureRef Target)
	{
		FCairnPassParameters* Parameters = GraphBuilder.AllocParameters<FCairnPassParameters>();
		Parameters->Target = Target;
#if CAIRN_FLUSHES_BY_COPY
		const FRDGTextureDesc Texel = FRDGTextureDesc::Create2D(
			FIntPoint(1, 1), PF_B8G8R8A8, FClearValueBinding::Black, TexCreate_RenderTargetable | TexCreate_ShaderResource);
		const FRDGTextureRef From = GraphBuilder.CreateTexture(Texel, TEXT("Cairn.FlushFrom"));
		Parameters->FlushFrom = From;
		Parameters->FlushTo = GraphBuilder.CreateTexture(Texel, TEXT("Cairn.FlushTo"));
		// The graph only allows reading textures that were written.
		AddClearRenderTargetPass(GraphBuilder, From);
#endif
		return Parameters;
	}

	/** A fence and the value that it gets after the device has executed a list. */
	struct FFencePoint
	{
		ID3D12Fence* Fence = nullptr;
		uint64 Value = 0;
	};

	/**
	 * Calls FFencePoint Record(ID3D12GraphicsCommandList*, ID3D12Resource*) with the engine's own list open, on the thread that records it, with
	 * the target resident and in COPY_DEST. If it returns a fence, the fence is signalled after the list. Call this inside the pass.
	 */
	template <typename RecordType>
	void Enqueue(FRHICommandListImmediate& RHICmdList, const FCairnPassParameters* Parameters, RecordType&& Record)
	{
		FRHITexture* const Target = Parameters->Target->GetRHI();
#if CAIRN_FLUSHES_BY_COPY
		RHICmdList.EnqueueLambda([Target](FRHICommandListImmediate& Executing)
		{
			// The graph leaves transitions within graphics work to the engine, which makes this one, and learns that the list uses the texture.
			GetID3D12DynamicRHI()->RHITransitionResource(
				Executing, Target, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES);
		});
		RHICmdList.CopyTexture(Parameters->FlushFrom->GetRHI(), Parameters->FlushTo->GetRHI(), FRHICopyTextureInfo());
#endif
		RHICmdList.EnqueueLambda([Target, Record = Forward<RecordType>(Record)](FRHICommandListImmediate& Executing) mutable
		{
			ID3D12DynamicRHI* const RHI = GetID3D12DynamicRHI();
#if !CAIRN_FLUSHES_BY_COPY
			RHI->RHIUpdateResourceResidency(Executing, DeviceIndex, Target);
			RHI->RHIFlushResourceBarriers(Executing, DeviceIndex);
#endif
#if UE_VERSION_OLDER_THAN(5, 5, 0)
			ID3D12GraphicsCommandList* const List = RHI->RHIGetGraphicsCommandList(DeviceIndex);
			const FFencePoint Point = Record(List, RHI->RHIGetResource(Target));
			RHI->RHIFinishExternalComputeWork(DeviceIndex, List);
#else
			ID3D12GraphicsCommandList* const List = RHI->RHIGetGraphicsCommandList(Executing, DeviceIndex);
			const FFencePoint Point = Record(List, RHI->RHIGetResource(Target));
			RHI->RHIFinishExternalComputeWork(Executing, DeviceIndex, List);
#endif
			// This must be last: it closes the list, and RHIFinishExternalComputeWork asserts that its list is still the current one.
			if (Point.Fence != nullptr)
			{
				RHI->RHISignalManualFence(Executing, Point.Fence, Point.Value);
			}
		});
	}
}

#endif
