/*
 * The engine's public interface to its Direct3D 12 device in each version. 5.7 and 5.8 have the functions of 5.6; the plugin does not use
 * RHIWaitManualFence, which 5.8 changed.
 */
#pragma once

#include "rhi.h"

#include <d3d12.h>

struct ID3D12DynamicRHI : public FDynamicRHI {
    ERHIInterfaceType GetInterfaceType() const final { return ERHIInterfaceType::D3D12; }
    virtual ID3D12CommandQueue* RHIGetCommandQueue() const = 0;
    virtual ID3D12Device* RHIGetDevice(uint32 index) const = 0;
    virtual ID3D12Resource* RHIGetResource(FRHITexture* texture) const = 0;
#if UE_VERSION_OLDER_THAN(5, 5, 0)
    virtual ID3D12GraphicsCommandList* RHIGetGraphicsCommandList(uint32 device) const = 0;
    virtual void RHIFinishExternalComputeWork(uint32 device, ID3D12GraphicsCommandList* list) = 0;
#else
    virtual ID3D12GraphicsCommandList* RHIGetGraphicsCommandList(FRHICommandListBase& executing, uint32 device) const = 0;
    virtual void RHIFinishExternalComputeWork(FRHICommandListBase& executing, uint32 device, ID3D12GraphicsCommandList* list) = 0;
#endif
#if UE_VERSION_OLDER_THAN(5, 6, 0)
    virtual void RHITransitionResource(FRHICommandList& list, FRHITexture* texture, D3D12_RESOURCE_STATES state, uint32 subresource) = 0;
#else
    /* RHITransitionResource still exists, deprecated, and does nothing. */
    virtual void RHIFlushResourceBarriers(FRHICommandListBase& list, uint32 device) = 0;
    virtual void RHIUpdateResourceResidency(FRHICommandListBase& list, uint32 device, FRHIResource* resource) = 0;
#endif
    /** Closes the open list; the fence is signalled after it. */
    virtual void RHISignalManualFence(FRHICommandList& list, ID3D12Fence* fence, uint64 value) = 0;
};

inline ID3D12DynamicRHI* GetID3D12DynamicRHI() { return static_cast<ID3D12DynamicRHI*>(GDynamicRHI); }
