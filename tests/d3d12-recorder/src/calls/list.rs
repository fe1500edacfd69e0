//! `ID3D12GraphicsCommandList`.

use std::ffi::c_void;

use windows::Win32::Foundation::RECT;
use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT;
use windows::core::{BOOL, HRESULT, Interface};

use super::hooks::{caller, hooks};
use super::{Calls, report};
use crate::recorder::Use;
use crate::regions::Region;
use crate::root_signature::DescriptorKind;
use crate::states::{BarrierPart, ListKind, State};
use crate::timeline::Id;

/// Reports a call of a list that is known.
fn recorded(this: *mut c_void, event: impl FnOnce(&mut Calls, Id)) {
    report(caller(), |calls| {
        if let Some(list) = calls.id(this) {
            event(calls, list);
        }
    });
}

/// The side of a copy of textures.
fn side(calls: &mut Calls, location: &D3D12_TEXTURE_COPY_LOCATION, state: State) -> Option<Use> {
    let object = location.pResource.as_ref()?.as_raw();
    let resource = calls.resource(object)?;
    let region = match location.Type {
        D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT => {
            // SAFETY: the member that the type names.
            let placed = unsafe { location.Anonymous.PlacedFootprint };
            let of = placed.Footprint;
            let rows = u64::from(of.Height) * u64::from(of.Depth);
            Region::Bytes(placed.Offset..placed.Offset + rows * u64::from(of.RowPitch))
        }
        // SAFETY: the member that the type names.
        _ => calls.recorder.subresource(resource, unsafe { location.Anonymous.SubresourceIndex }),
    };
    Some(Use::new(resource, region, state))
}

/// Width, height and depth of what a location of a copy has.
///
/// # Safety
/// Its union has the member of its type, and its resource is live.
unsafe fn extent(location: &D3D12_TEXTURE_COPY_LOCATION) -> Option<[u32; 3]> {
    if location.Type == D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT {
        // SAFETY: the member that the type names.
        let of = unsafe { location.Anonymous.PlacedFootprint }.Footprint;
        return Some([of.Width, of.Height, of.Depth]);
    }
    let resource = location.pResource.as_ref()?;
    // SAFETY: a live resource, and the member that the type names.
    let (desc, number) = unsafe { (resource.GetDesc(), location.Anonymous.SubresourceIndex) };
    let level = number % u32::from(desc.MipLevels).max(1);
    let depth = if desc.Dimension == D3D12_RESOURCE_DIMENSION_TEXTURE3D { u32::from(desc.DepthOrArraySize) } else { 1 };
    Some([desc.Width as u32, desc.Height, depth].map(|size| (size >> level).max(1)))
}

/// Whether a copy to the origin of `to` covers it.
///
/// # Safety
/// As [`extent`].
unsafe fn covers(
    to: Option<&D3D12_TEXTURE_COPY_LOCATION>,
    from: Option<&D3D12_TEXTURE_COPY_LOCATION>,
    part: Option<&D3D12_BOX>,
) -> bool {
    // SAFETY: the caller's promise.
    let (to, from) = unsafe { (to.and_then(|to| extent(to)), from.and_then(|from| extent(from))) };
    let copied = match part {
        Some(part) => Some([part.right - part.left, part.bottom - part.top, part.back - part.front]),
        None => from,
    };
    to.is_some() && to == copied
}

/// # Safety
/// Each barrier's union has the member of its type.
unsafe fn barrier(calls: &mut Calls, list: Id, barrier: &D3D12_RESOURCE_BARRIER) {
    match barrier.Type {
        D3D12_RESOURCE_BARRIER_TYPE_TRANSITION => {
            // SAFETY: the caller's promise.
            let of = unsafe { &barrier.Anonymous.Transition };
            let Some(resource) = of.pResource.as_ref().and_then(|resource| calls.resource(resource.as_raw())) else {
                return;
            };
            let part = match barrier.Flags {
                D3D12_RESOURCE_BARRIER_FLAG_BEGIN_ONLY => BarrierPart::Begin,
                D3D12_RESOURCE_BARRIER_FLAG_END_ONLY => BarrierPart::End,
                _ => BarrierPart::Whole,
            };
            let subresource = (of.Subresource != D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES).then_some(of.Subresource);
            let states = (State(of.StateBefore.0 as u32), State(of.StateAfter.0 as u32));
            calls.recorder.transition(list, resource, subresource, states, part);
        }
        D3D12_RESOURCE_BARRIER_TYPE_ALIASING => {
            // SAFETY: the caller's promise.
            let of = unsafe { &barrier.Anonymous.Aliasing };
            let mut id = |resource: &Option<ID3D12Resource>| calls.resource(resource.as_ref()?.as_raw());
            let (before, after) = (id(&of.pResourceBefore), id(&of.pResourceAfter));
            calls.recorder.aliasing_barrier(list, before, after);
        }
        D3D12_RESOURCE_BARRIER_TYPE_UAV => {
            // SAFETY: the caller's promise.
            let of = unsafe { &barrier.Anonymous.UAV };
            let resource = of.pResource.as_ref().and_then(|resource| calls.resource(resource.as_raw()));
            calls.recorder.uav_barrier(list, resource);
        }
        _ => {}
    }
}

/// A use of a whole resource.
fn whole(calls: &mut Calls, object: *mut c_void, state: State) -> Option<Use> {
    Some(Use::new(calls.resource(object)?, Region::All, state))
}

hooks! { ID3D12GraphicsCommandList_Vtbl;
    fn Close[original](this) -> HRESULT {
        recorded(this, |calls, list| calls.recorder.close(list));
        // SAFETY: the caller's own argument, passed on.
        unsafe { original(this) }
    }
    fn Reset[original](this, allocator: *mut c_void, pipeline: *mut c_void) -> HRESULT {
        recorded(this, |calls, list| {
            if let Some(allocator) = calls.id(allocator) {
                let pipeline = calls.id(pipeline);
                calls.recorder.reset_list(list, allocator, pipeline);
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, allocator, pipeline) }
    }
    fn DrawInstanced[original](this, vertices: u32, instances: u32, first: u32, first_instance: u32) {
        recorded(this, |calls, list| calls.recorder.draw(list, "ID3D12GraphicsCommandList::DrawInstanced"));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, vertices, instances, first, first_instance) }
    }
    fn DrawIndexedInstanced[original](this, indices: u32, instances: u32, first: u32, base: i32, first_instance: u32) {
        recorded(this, |calls, list| calls.recorder.draw(list, "ID3D12GraphicsCommandList::DrawIndexedInstanced"));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, indices, instances, first, base, first_instance) }
    }
    fn Dispatch[original](this, x: u32, y: u32, z: u32) {
        recorded(this, |calls, list| calls.recorder.dispatch(list));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, x, y, z) }
    }
    fn ExecuteIndirect[original](
        this, signature: *mut c_void, most: u32, arguments: *mut c_void, offset: u64, count: *mut c_void, count_offset: u64,
    ) {
        recorded(this, |calls, list| {
            if let Some(arguments) = calls.resource(arguments) {
                let count = calls.resource(count);
                calls.recorder.dispatch_indirect(list, arguments, count);
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, signature, most, arguments, offset, count, count_offset) }
    }
    fn CopyBufferRegion[original](this, to: *mut c_void, to_offset: u64, from: *mut c_void, from_offset: u64, bytes: u64) {
        recorded(this, |calls, list| {
            if let (Some(to), Some(from)) = (calls.resource(to), calls.resource(from)) {
                calls.recorder.copy_buffer(list, (to, to_offset), (from, from_offset), bytes);
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, to, to_offset, from, from_offset, bytes) }
    }
    fn CopyTextureRegion[original](
        this, to: *const D3D12_TEXTURE_COPY_LOCATION, x: u32, y: u32, z: u32, from: *const D3D12_TEXTURE_COPY_LOCATION,
        part: *const D3D12_BOX,
    ) {
        recorded(this, |calls, list| {
            // SAFETY: the caller's own locations.
            let (to, from) = unsafe { (to.as_ref(), from.as_ref()) };
            // SAFETY: the caller's own locations and part, and live resources.
            let is_whole = unsafe { (x, y, z) == (0, 0, 0) && covers(to, from, part.as_ref()) };
            let to = to.and_then(|to| side(calls, to, State::COPY_DEST));
            let to = to.map(|to| Use { initialises: is_whole, ..to });
            let from = from.and_then(|from| side(calls, from, State::COPY_SOURCE));
            let uses = [to, from].into_iter().flatten().collect();
            calls.recorder.work(list, "ID3D12GraphicsCommandList::CopyTextureRegion", ListKind::Copy, uses, &[]);
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, to, x, y, z, from, part) }
    }
    fn CopyResource[original](this, to: *mut c_void, from: *mut c_void) {
        recorded(this, |calls, list| {
            let to = whole(calls, to, State::COPY_DEST).map(|to| Use { initialises: true, ..to });
            let uses = [to, whole(calls, from, State::COPY_SOURCE)];
            let uses = uses.into_iter().flatten().collect();
            calls.recorder.work(list, "ID3D12GraphicsCommandList::CopyResource", ListKind::Copy, uses, &[]);
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, to, from) }
    }
    fn ResolveSubresource[original](this, to: *mut c_void, to_number: u32, from: *mut c_void, from_number: u32, format: DXGI_FORMAT) {
        recorded(this, |calls, list| {
            let sides = [(to, to_number, State::RESOLVE_DEST), (from, from_number, State::RESOLVE_SOURCE)];
            let mut uses = Vec::new();
            for (object, number, state) in sides {
                if let Some(resource) = calls.resource(object) {
                    uses.push(Use::new(resource, calls.recorder.subresource(resource, number), state));
                }
            }
            calls.recorder.work(list, "ID3D12GraphicsCommandList::ResolveSubresource", ListKind::Direct, uses, &[]);
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, to, to_number, from, from_number, format) }
    }
    fn ResolveQueryData[original](this, heap: *mut c_void, kind: D3D12_QUERY_TYPE, first: u32, count: u32, to: *mut c_void, offset: u64) {
        recorded(this, |calls, list| {
            let heap = calls.id(heap);
            let resource = calls.resource(to);
            let region = Region::Bytes(offset..offset + 8 * u64::from(count));
            let uses = resource.map(|resource| Use::new(resource, region, State::COPY_DEST)).into_iter().collect();
            let function = "ID3D12GraphicsCommandList::ResolveQueryData";
            calls.recorder.work(list, function, ListKind::Copy, uses, heap.as_slice());
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, heap, kind, first, count, to, offset) }
    }
    fn SetPipelineState[original](this, pipeline: *mut c_void) {
        recorded(this, |calls, list| {
            if let Some(pipeline) = calls.id(pipeline) {
                calls.recorder.set_pipeline(list, pipeline);
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, pipeline) }
    }
    fn ResourceBarrier[original](this, count: u32, barriers: *const D3D12_RESOURCE_BARRIER) {
        recorded(this, |calls, list| {
            calls.recorder.barrier_call(list);
            for i in 0..count as usize {
                // SAFETY: the caller's own barriers.
                unsafe { barrier(calls, list, &*barriers.add(i)) };
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, count, barriers) }
    }
    fn SetDescriptorHeaps[original](this, count: u32, heaps: *const *mut c_void) {
        recorded(this, |calls, list| {
            // SAFETY: the caller's own heaps.
            let heaps = (0..count as usize).filter_map(|i| calls.id(unsafe { *heaps.add(i) })).collect();
            calls.recorder.set_heaps(list, heaps);
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, count, heaps) }
    }
    fn SetComputeRootSignature[original](this, root: *mut c_void) {
        recorded(this, |calls, list| {
            if let Some(root) = calls.id(root) {
                calls.recorder.set_root(list, root);
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, root) }
    }
    fn SetComputeRootDescriptorTable[original](this, parameter: u32, table: D3D12_GPU_DESCRIPTOR_HANDLE) {
        recorded(this, |calls, list| calls.recorder.set_table(list, parameter, table.ptr));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, parameter, table) }
    }
    fn SetComputeRoot32BitConstant[original](this, parameter: u32, value: u32, offset: u32) {
        recorded(this, |calls, list| calls.recorder.set_constants(list, parameter, offset, 1));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, parameter, value, offset) }
    }
    fn SetComputeRoot32BitConstants[original](this, parameter: u32, count: u32, values: *const c_void, offset: u32) {
        recorded(this, |calls, list| calls.recorder.set_constants(list, parameter, offset, count));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, parameter, count, values, offset) }
    }
    fn SetComputeRootConstantBufferView[original](this, parameter: u32, address: u64) {
        let function = "ID3D12GraphicsCommandList::SetComputeRootConstantBufferView";
        recorded(this, |calls, list| calls.recorder.set_root_view(list, function, parameter, DescriptorKind::Cbv, address));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, parameter, address) }
    }
    fn SetComputeRootShaderResourceView[original](this, parameter: u32, address: u64) {
        let function = "ID3D12GraphicsCommandList::SetComputeRootShaderResourceView";
        recorded(this, |calls, list| calls.recorder.set_root_view(list, function, parameter, DescriptorKind::Srv, address));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, parameter, address) }
    }
    fn SetComputeRootUnorderedAccessView[original](this, parameter: u32, address: u64) {
        let function = "ID3D12GraphicsCommandList::SetComputeRootUnorderedAccessView";
        recorded(this, |calls, list| calls.recorder.set_root_view(list, function, parameter, DescriptorKind::Uav, address));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, parameter, address) }
    }
    fn OMSetRenderTargets[original](
        this, count: u32, targets: *const D3D12_CPU_DESCRIPTOR_HANDLE, is_range: BOOL, depth: *const D3D12_CPU_DESCRIPTOR_HANDLE,
    ) {
        recorded(this, |calls, list| {
            // SAFETY: the caller's own descriptors: one that starts a range, or as many as it says.
            let given = unsafe {
                let count = if is_range.as_bool() { count.min(1) } else { count };
                (0..count as usize).map(|i| (*targets.add(i)).ptr as u64).collect::<Vec<_>>()
            };
            let step = given.first().and_then(|first| calls.recorder.descriptor_step(*first)).unwrap_or_default();
            let addresses: Vec<u64> = match given.first() {
                Some(&first) if is_range.as_bool() => (0..u64::from(count)).map(|i| first + i * step).collect(),
                _ => given,
            };
            // SAFETY: the caller's own descriptor, or null.
            let depth = unsafe { depth.as_ref() }.map(|depth| (depth.ptr as u64, State::DEPTH_WRITE));
            let targets: Vec<_> = addresses.into_iter().map(|address| (address, State::RENDER_TARGET)).chain(depth).collect();
            calls.recorder.set_targets(list, &targets);
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, count, targets, is_range, depth) }
    }
    fn ClearDepthStencilView[original](
        this, view: D3D12_CPU_DESCRIPTOR_HANDLE, flags: D3D12_CLEAR_FLAGS, depth: f32, stencil: u8, count: u32, parts: *const RECT,
    ) {
        let function = "ID3D12GraphicsCommandList::ClearDepthStencilView";
        let (address, how) = (view.ptr as u64, (State::DEPTH_WRITE, ListKind::Direct));
        recorded(this, |calls, list| calls.recorder.clear(list, function, address, how, count == 0));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, view, flags, depth, stencil, count, parts) }
    }
    fn ClearRenderTargetView[original](
        this, view: D3D12_CPU_DESCRIPTOR_HANDLE, colour: *const f32, count: u32, parts: *const RECT,
    ) {
        let function = "ID3D12GraphicsCommandList::ClearRenderTargetView";
        let (address, how) = (view.ptr as u64, (State::RENDER_TARGET, ListKind::Direct));
        recorded(this, |calls, list| calls.recorder.clear(list, function, address, how, count == 0));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, view, colour, count, parts) }
    }
    fn DiscardResource[original](this, resource: *mut c_void, region: *const D3D12_DISCARD_REGION) {
        recorded(this, |calls, list| {
            let Some(resource) = calls.resource(resource) else { return };
            // SAFETY: the caller's own region, or null.
            let (parts, is_whole) = match unsafe { region.as_ref() } {
                Some(region) => {
                    let end = region.FirstSubresource.saturating_add(region.NumSubresources);
                    (region.FirstSubresource..end, region.NumRects == 0)
                }
                None => (0..calls.recorder.subresources(resource), true),
            };
            calls.recorder.discard(list, resource, parts, is_whole);
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, resource, region) }
    }
    fn ClearUnorderedAccessViewUint[original](
        this, table: D3D12_GPU_DESCRIPTOR_HANDLE, view: D3D12_CPU_DESCRIPTOR_HANDLE, resource: *mut c_void, values: *const u32,
        count: u32, parts: *const RECT,
    ) {
        let function = "ID3D12GraphicsCommandList::ClearUnorderedAccessViewUint";
        let (address, how) = (view.ptr as u64, (State::UNORDERED_ACCESS, ListKind::Compute));
        recorded(this, |calls, list| calls.recorder.clear(list, function, address, how, count == 0));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, table, view, resource, values, count, parts) }
    }
    fn ClearUnorderedAccessViewFloat[original](
        this, table: D3D12_GPU_DESCRIPTOR_HANDLE, view: D3D12_CPU_DESCRIPTOR_HANDLE, resource: *mut c_void, values: *const f32,
        count: u32, parts: *const RECT,
    ) {
        let function = "ID3D12GraphicsCommandList::ClearUnorderedAccessViewFloat";
        let (address, how) = (view.ptr as u64, (State::UNORDERED_ACCESS, ListKind::Compute));
        recorded(this, |calls, list| calls.recorder.clear(list, function, address, how, count == 0));
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, table, view, resource, values, count, parts) }
    }
}
