//! Resource barriers.

use std::mem::ManuallyDrop;

use windows::Win32::Graphics::Direct3D12::*;

/// A transition barrier of all subresources for `ResourceBarrier`. It holds no reference, so the resource must live until that call.
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

/// A UAV barrier: later dispatches see the writes to `resource`.
pub(super) fn uav_barrier(resource: &ID3D12Resource) -> D3D12_RESOURCE_BARRIER {
    let uav = D3D12_RESOURCE_UAV_BARRIER { pResource: borrowed(resource) };
    D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_UAV,
        Anonymous: D3D12_RESOURCE_BARRIER_0 { UAV: ManuallyDrop::new(uav) },
        ..Default::default()
    }
}

/// A UAV barrier for all resources.
pub(super) fn uav_barrier_of_all() -> D3D12_RESOURCE_BARRIER {
    let uav = D3D12_RESOURCE_UAV_BARRIER { pResource: ManuallyDrop::new(None) };
    D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_UAV,
        Anonymous: D3D12_RESOURCE_BARRIER_0 { UAV: ManuallyDrop::new(uav) },
        ..Default::default()
    }
}

/// A resource argument for a call that only reads the pointer and takes no reference.
pub(in crate::gpu) fn borrowed(resource: &ID3D12Resource) -> ManuallyDrop<Option<ID3D12Resource>> {
    // SAFETY: the same pointer; `ManuallyDrop` releases no reference.
    unsafe { std::mem::transmute_copy(resource) }
}
