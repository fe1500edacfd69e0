//! What a frame becomes: a copy of the one it was made of, recorded into the caller's list, as AMD's records one after a cut.

use std::ffi::c_void;
use std::mem::ManuallyDrop;

use windows::Win32::Graphics::Direct3D12::{
    D3D12_RESOURCE_BARRIER, D3D12_RESOURCE_BARRIER_0, D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES,
    D3D12_RESOURCE_BARRIER_TYPE_TRANSITION, D3D12_RESOURCE_STATE_COPY_DEST, D3D12_RESOURCE_STATE_COPY_SOURCE,
    D3D12_RESOURCE_STATES, D3D12_RESOURCE_TRANSITION_BARRIER, ID3D12GraphicsCommandList, ID3D12Resource,
};
use windows::core::Interface;

use crate::memory::get;

/// States of ffx-api, with Direct3D's.
const STATES: [(u32, i32); 12] = [
    (1, 0),
    (2, 0x8),
    (4, 0x40),
    (8, 0x80),
    (12, 0xc0),
    (16, 0x800),
    (20, 0xac3),
    (32, 0x400),
    (64, 0x200),
    (128, 0),
    (256, 0x4),
    (512, 0x10),
];

/// Records the copy; both pictures are afterwards in the states that they are told to be in.
///
/// # Safety
/// The struct of a picture whose list and resources were judged.
pub(crate) unsafe fn copy(head: *const u8) {
    // SAFETY: fields of the struct.
    let places = unsafe { [get::<*mut c_void>(head, 16), get(head, 24), get(head, 72)] };
    // SAFETY: as above.
    let states = unsafe { [64, 112].map(|at| get::<u32>(head, at)) };
    // SAFETY: judged to be of these kinds; the references stay the caller's.
    let found = unsafe {
        (
            ID3D12GraphicsCommandList::from_raw_borrowed(&places[0]),
            ID3D12Resource::from_raw_borrowed(&places[1]),
            ID3D12Resource::from_raw_borrowed(&places[2]),
        )
    };
    let (Some(list), Some(from), Some(to)) = found else { return };
    let state = |told| STATES.iter().find(|(known, _)| *known == told).map_or(0, |(_, state)| *state);
    let [from_state, to_state] = states.map(state).map(D3D12_RESOURCE_STATES);
    let copying =
        [(from, from_state, D3D12_RESOURCE_STATE_COPY_SOURCE), (to, to_state, D3D12_RESOURCE_STATE_COPY_DEST)];
    let there: Vec<_> = copying.iter().filter(|(_, now, then)| now != then).collect();
    let barriers = |back: bool| -> Vec<D3D12_RESOURCE_BARRIER> {
        let one = |(resource, now, then): &&(&ID3D12Resource, _, _)| {
            let (before, after) = if back { (*then, *now) } else { (*now, *then) };
            transition(resource, before, after)
        };
        there.iter().map(one).collect()
    };
    // SAFETY: an open list and live resources, by the caller's promise.
    unsafe {
        list.ResourceBarrier(&barriers(false));
        list.CopyResource(to, from);
        list.ResourceBarrier(&barriers(true));
    }
}

fn transition(
    resource: &ID3D12Resource,
    before: D3D12_RESOURCE_STATES,
    after: D3D12_RESOURCE_STATES,
) -> D3D12_RESOURCE_BARRIER {
    let transition = D3D12_RESOURCE_TRANSITION_BARRIER {
        // SAFETY: a copy of the pointer without a reference, as barriers take it; never dropped.
        pResource: unsafe { std::mem::transmute_copy(resource) },
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
