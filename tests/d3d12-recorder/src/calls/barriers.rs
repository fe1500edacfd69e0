//! `ID3D12GraphicsCommandList7`: enhanced barriers.

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use super::hooks::{caller, hooks};
use super::{Calls, report};
use crate::layouts::{Access, EnhancedBarrier, Layout, Side, Sync};
use crate::recorder::enhanced::Subresources;
use crate::timeline::Id;

fn side(sync: D3D12_BARRIER_SYNC, access: D3D12_BARRIER_ACCESS, layout: D3D12_BARRIER_LAYOUT) -> Side {
    Side { sync: Sync(sync.0 as u32), access: Access(access.0 as u32), layout: Layout(layout.0 as u32) }
}

/// A side of a barrier without a layout.
fn memory_side(sync: D3D12_BARRIER_SYNC, access: D3D12_BARRIER_ACCESS) -> Side {
    side(sync, access, D3D12_BARRIER_LAYOUT_UNDEFINED)
}

fn subresources(range: &D3D12_BARRIER_SUBRESOURCE_RANGE) -> Subresources {
    let first = range.IndexOrFirstMipLevel;
    match range.NumMipLevels {
        0 if first == u32::MAX => Subresources::All,
        0 => Subresources::One(first),
        levels => {
            let from = |start: u32, count: u32| start..start.saturating_add(count);
            Subresources::Ranges {
                levels: from(first, levels),
                slices: from(range.FirstArraySlice, range.NumArraySlices),
                planes: from(range.FirstPlane, range.NumPlanes),
            }
        }
    }
}

fn global_barrier(of: &D3D12_GLOBAL_BARRIER) -> EnhancedBarrier {
    EnhancedBarrier {
        before: memory_side(of.SyncBefore, of.AccessBefore),
        after: memory_side(of.SyncAfter, of.AccessAfter),
    }
}

fn buffer_barrier(of: &D3D12_BUFFER_BARRIER) -> EnhancedBarrier {
    EnhancedBarrier {
        before: memory_side(of.SyncBefore, of.AccessBefore),
        after: memory_side(of.SyncAfter, of.AccessAfter),
    }
}

fn texture_barrier(of: &D3D12_TEXTURE_BARRIER) -> EnhancedBarrier {
    EnhancedBarrier {
        before: side(of.SyncBefore, of.AccessBefore, of.LayoutBefore),
        after: side(of.SyncAfter, of.AccessAfter, of.LayoutAfter),
    }
}

/// Reports a group of barriers of a list.
///
/// # Safety
/// The group's union has the member of its type, with as many barriers as the group says.
unsafe fn report_group(calls: &mut Calls, list: Id, group: &D3D12_BARRIER_GROUP) {
    let count = group.NumBarriers as usize;
    let id = |calls: &mut Calls, resource: &Option<ID3D12Resource>| calls.resource(resource.as_ref()?.as_raw());
    match group.Type {
        D3D12_BARRIER_TYPE_GLOBAL => {
            for i in 0..count {
                // SAFETY: the caller's promise.
                let of = unsafe { &*group.Anonymous.pGlobalBarriers.add(i) };
                calls.recorder.global_barrier(list, global_barrier(of));
            }
        }
        D3D12_BARRIER_TYPE_BUFFER => {
            for i in 0..count {
                // SAFETY: the caller's promise.
                let of = unsafe { &*group.Anonymous.pBufferBarriers.add(i) };
                if let Some(resource) = id(calls, &of.pResource) {
                    calls.recorder.buffer_barrier(list, resource, (of.Offset, of.Size), buffer_barrier(of));
                }
            }
        }
        D3D12_BARRIER_TYPE_TEXTURE => {
            for i in 0..count {
                // SAFETY: the caller's promise.
                let of = unsafe { &*group.Anonymous.pTextureBarriers.add(i) };
                if let Some(resource) = id(calls, &of.pResource) {
                    let discards = of.Flags.contains(D3D12_TEXTURE_BARRIER_FLAG_DISCARD);
                    let range = subresources(&of.Subresources);
                    calls.recorder.texture_barrier(list, resource, &range, texture_barrier(of), discards);
                }
            }
        }
        _ => {}
    }
}

hooks! { ID3D12GraphicsCommandList7_Vtbl;
    fn Barrier[original](this, count: u32, groups: *const D3D12_BARRIER_GROUP) {
        report(caller(), |calls| {
            let Some(list) = calls.id(this) else { return };
            calls.recorder.barrier_call(list);
            for i in 0..count as usize {
                // SAFETY: the caller's own groups.
                unsafe { report_group(calls, list, &*groups.add(i)) };
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, count, groups) }
    }
}

/// Conversion of D3D12 barrier structs; the lab's drivers lack enhanced barriers.
#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::mem::ManuallyDrop;

    use super::*;
    use crate::recorder::{Memory, ObjectKind, Recorder, ResourceDesc};
    use crate::rules::Rule;
    use crate::states::{ListKind, State};

    /// Addresses of a texture and of a buffer, which nothing dereferences.
    const TEXTURE: usize = 0x1000;
    const BUFFER: usize = 0x2000;

    fn at(address: usize) -> ManuallyDrop<Option<ID3D12Resource>> {
        // SAFETY: a number that is only compared, and not released.
        ManuallyDrop::new(Some(unsafe { ID3D12Resource::from_raw(address as *mut c_void) }))
    }

    fn calls() -> (Calls, Id) {
        let mut recorder = Recorder::default();
        let mut create = |kind| recorder.create(kind, "object", None);
        let [texture, buffer] = [ObjectKind::Resource; 2].map(&mut create);
        let [queue, allocator, list] = [ObjectKind::Queue, ObjectKind::Allocator, ObjectKind::List].map(&mut create);
        for (id, is_buffer) in [(texture, false), (buffer, true)] {
            let desc = ResourceDesc {
                is_buffer,
                bytes: 256,
                shape: if is_buffer { [1; 3] } else { [3, 2, 1] },
                memory: Memory::Default,
                is_simultaneous: false,
                allowed: State::UNORDERED_ACCESS,
                state: State::COMMON,
                layout: None,
                placed: None,
                address: None,
            };
            recorder.create_resource(id, desc);
        }
        recorder.create_queue(queue, ListKind::Direct);
        recorder.create_allocator(allocator, ListKind::Direct);
        recorder.create_list(list, ListKind::Direct, Some(allocator), None);
        (Calls { recorder, ids: HashMap::from([(TEXTURE, texture), (BUFFER, buffer)]), chains: HashMap::new() }, list)
    }

    fn to_written() -> D3D12_TEXTURE_BARRIER {
        D3D12_TEXTURE_BARRIER {
            SyncBefore: D3D12_BARRIER_SYNC_ALL,
            SyncAfter: D3D12_BARRIER_SYNC_COMPUTE_SHADING,
            AccessBefore: D3D12_BARRIER_ACCESS_COMMON,
            AccessAfter: D3D12_BARRIER_ACCESS_UNORDERED_ACCESS,
            LayoutBefore: D3D12_BARRIER_LAYOUT_COMMON,
            LayoutAfter: D3D12_BARRIER_LAYOUT_UNORDERED_ACCESS,
            pResource: at(TEXTURE),
            Subresources: D3D12_BARRIER_SUBRESOURCE_RANGE { IndexOrFirstMipLevel: u32::MAX, ..Default::default() },
            Flags: D3D12_TEXTURE_BARRIER_FLAG_NONE,
        }
    }

    fn rules_of(group: &D3D12_BARRIER_GROUP) -> Vec<Rule> {
        let (mut calls, list) = calls();
        // SAFETY: the groups of this file.
        unsafe { report_group(&mut calls, list, group) };
        calls.recorder.take_findings().into_iter().map(|finding| finding.rule).collect()
    }

    fn texture_rules(barrier: D3D12_TEXTURE_BARRIER) -> Vec<Rule> {
        rules_of(&D3D12_BARRIER_GROUP {
            Type: D3D12_BARRIER_TYPE_TEXTURE,
            NumBarriers: 1,
            Anonymous: D3D12_BARRIER_GROUP_0 { pTextureBarriers: &raw const barrier },
        })
    }

    #[test]
    fn texture_barriers_keep_their_values_and_subresources() {
        let expected = EnhancedBarrier {
            before: Side { sync: Sync::ALL, access: Access::COMMON, layout: Layout::COMMON },
            after: Side {
                sync: Sync::COMPUTE_SHADING,
                access: Access::UNORDERED_ACCESS,
                layout: Layout::UNORDERED_ACCESS,
            },
        };
        assert_eq!(texture_barrier(&to_written()), expected);
        assert_eq!(texture_rules(to_written()), []);
        let one = |number| D3D12_BARRIER_SUBRESOURCE_RANGE { IndexOrFirstMipLevel: number, ..Default::default() };
        assert_eq!(texture_rules(D3D12_TEXTURE_BARRIER { Subresources: one(5), ..to_written() }), []);
        let behind = D3D12_TEXTURE_BARRIER { Subresources: one(6), ..to_written() };
        assert_eq!(texture_rules(behind), [Rule::BarrierSubresources]);
        let levels = |count| D3D12_BARRIER_SUBRESOURCE_RANGE {
            IndexOrFirstMipLevel: 1,
            NumMipLevels: count,
            NumArraySlices: 2,
            NumPlanes: 1,
            ..Default::default()
        };
        assert_eq!(texture_rules(D3D12_TEXTURE_BARRIER { Subresources: levels(2), ..to_written() }), []);
        let behind = D3D12_TEXTURE_BARRIER { Subresources: levels(3), ..to_written() };
        assert_eq!(texture_rules(behind), [Rule::BarrierSubresources]);
        let wrong = D3D12_TEXTURE_BARRIER { SyncAfter: D3D12_BARRIER_SYNC_COPY, ..to_written() };
        assert_eq!(texture_rules(wrong), [Rule::BarrierIncompatibleValues]);
        let of_buffer = D3D12_TEXTURE_BARRIER { pResource: at(BUFFER), ..to_written() };
        assert_eq!(texture_rules(of_buffer), [Rule::BarrierType]);
    }

    /// A barrier from a shader's writes to a copy.
    fn to_copied() -> D3D12_BUFFER_BARRIER {
        D3D12_BUFFER_BARRIER {
            SyncBefore: D3D12_BARRIER_SYNC_COMPUTE_SHADING,
            SyncAfter: D3D12_BARRIER_SYNC_COPY,
            AccessBefore: D3D12_BARRIER_ACCESS_UNORDERED_ACCESS,
            AccessAfter: D3D12_BARRIER_ACCESS_COPY_SOURCE,
            pResource: at(BUFFER),
            Offset: 0,
            Size: 256,
        }
    }

    /// As [`to_copied`], of all memory.
    fn all_to_copied() -> D3D12_GLOBAL_BARRIER {
        let D3D12_BUFFER_BARRIER { SyncBefore, SyncAfter, AccessBefore, AccessAfter, .. } = to_copied();
        D3D12_GLOBAL_BARRIER { SyncBefore, SyncAfter, AccessBefore, AccessAfter }
    }

    /// The conversion of both.
    fn expected_to_copied() -> EnhancedBarrier {
        let layout = Layout::UNDEFINED;
        EnhancedBarrier {
            before: Side { sync: Sync::COMPUTE_SHADING, access: Access::UNORDERED_ACCESS, layout },
            after: Side { sync: Sync::COPY, access: Access::COPY_SOURCE, layout },
        }
    }

    #[test]
    fn buffer_barriers_keep_their_values() {
        assert_eq!(buffer_barrier(&to_copied()), expected_to_copied());
        let rules = |barrier: D3D12_BUFFER_BARRIER| {
            rules_of(&D3D12_BARRIER_GROUP {
                Type: D3D12_BARRIER_TYPE_BUFFER,
                NumBarriers: 1,
                Anonymous: D3D12_BARRIER_GROUP_0 { pBufferBarriers: &raw const barrier },
            })
        };
        assert_eq!(rules(to_copied()), []);
        assert_eq!(rules(D3D12_BUFFER_BARRIER { Size: 128, ..to_copied() }), [Rule::BarrierBufferRange]);
        let wrong = D3D12_BUFFER_BARRIER { SyncBefore: D3D12_BARRIER_SYNC_COPY, ..to_copied() };
        assert_eq!(rules(wrong), [Rule::BarrierIncompatibleValues]);
    }

    #[test]
    fn global_barriers_keep_their_values() {
        assert_eq!(global_barrier(&all_to_copied()), expected_to_copied());
        let rules = |barrier: D3D12_GLOBAL_BARRIER| {
            rules_of(&D3D12_BARRIER_GROUP {
                Type: D3D12_BARRIER_TYPE_GLOBAL,
                NumBarriers: 1,
                Anonymous: D3D12_BARRIER_GROUP_0 { pGlobalBarriers: &raw const barrier },
            })
        };
        assert_eq!(rules(all_to_copied()), []);
        let wrong = D3D12_GLOBAL_BARRIER { SyncBefore: D3D12_BARRIER_SYNC_NONE, ..all_to_copied() };
        assert_eq!(rules(wrong), [Rule::BarrierIncompatibleValues]);
    }
}
