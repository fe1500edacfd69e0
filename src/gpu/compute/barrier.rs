//! Barriers.

use std::mem::ManuallyDrop;

use windows::Win32::Graphics::Direct3D12::*;

/// From one state of a whole resource to another, for a list's `ResourceBarrier`: it takes no reference, so the resource must live until
/// then.
pub fn transition(
    resource: &ID3D12Resource,
    before: D3D12_RESOURCE_STATES,
    after: D3D12_RESOURCE_STATES,
) -> D3D12_RESOURCE_BARRIER {
    let transition = D3D12_RESOURCE_TRANSITION_BARRIER {
        pResource: borrowed(resource),
        Subresource: D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES,
        StateBefore: before,
        StateAfter: after,
    };
    D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_TRANSITION,
        Anonymous: D3D12_RESOURCE_BARRIER_0 { Transition: ManuallyDrop::new(transition) },
        ..Default::default()
    }
}

/// What was written as an unordered view is seen by the next dispatch.
pub(super) fn written(resource: &ID3D12Resource) -> D3D12_RESOURCE_BARRIER {
    let uav = D3D12_RESOURCE_UAV_BARRIER { pResource: borrowed(resource) };
    D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_UAV,
        Anonymous: D3D12_RESOURCE_BARRIER_0 { UAV: ManuallyDrop::new(uav) },
        ..Default::default()
    }
}

/// Whatever was written as an unordered view is seen by the next dispatch.
pub(super) fn all_written() -> D3D12_RESOURCE_BARRIER {
    let uav = D3D12_RESOURCE_UAV_BARRIER { pResource: ManuallyDrop::new(None) };
    D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_UAV,
        Anonymous: D3D12_RESOURCE_BARRIER_0 { UAV: ManuallyDrop::new(uav) },
        ..Default::default()
    }
}

/// A resource as a call names it that takes no reference and only reads it.
pub(super) fn borrowed(resource: &ID3D12Resource) -> ManuallyDrop<Option<ID3D12Resource>> {
    // SAFETY: the same pointer; what is never dropped releases no reference.
    unsafe { std::mem::transmute_copy(resource) }
}
