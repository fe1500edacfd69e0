//! `ID3D12Device`: new objects, views and residency.

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::{GUID, HRESULT, Interface};

use super::hooks::{self, HookGuard, caller, hooks};
use super::queue::{allocators, fences, queues};
use super::resource::Start;
use super::{Calls, barriers, faults, list, report, resource, views};
use crate::descriptors::{HeapDesc, View};
use crate::recorder::{HeapRange, Memory, ObjectKind};
use crate::regions::Region;
use crate::root_signature::{DescriptorKind, RootSignature};
use crate::states::ListKind;
use crate::timeline::Id;

/// Records the calls of a device.
///
/// # Safety
/// A live device.
pub(super) unsafe fn record(device: *mut c_void) {
    // The calls made here are not the program's.
    let _guard = HookGuard::enter();
    // SAFETY: the caller's promise; the tables are those of all devices.
    unsafe {
        let borrowed = ID3D12Device::from_raw_borrowed(&device).expect("a device");
        install(Interface::vtable(borrowed));
        faults::install(Interface::vtable(borrowed));
        if let Ok(third) = borrowed.cast::<ID3D12Device3>() {
            third::install(Interface::vtable(&third));
        }
        if let Ok(fourth) = borrowed.cast::<ID3D12Device4>() {
            fourth::install(Interface::vtable(&fourth));
        }
        if let Ok(eighth) = borrowed.cast::<ID3D12Device8>() {
            eighth::install(Interface::vtable(&eighth));
        }
        if let Ok(tenth) = borrowed.cast::<ID3D12Device10>() {
            tenth::install(Interface::vtable(&tenth));
        }
        hooks::device::install(device);
    }
    // A device of an adapter can be made twice, and is one object.
    report(caller(), |calls| {
        if calls.id(device).is_none() {
            calls.add(device, ObjectKind::Device, "device");
        }
    });
}

fn list_kind(kind: D3D12_COMMAND_LIST_TYPE) -> ListKind {
    match kind {
        D3D12_COMMAND_LIST_TYPE_COPY => ListKind::Copy,
        D3D12_COMMAND_LIST_TYPE_COMPUTE => ListKind::Compute,
        _ => ListKind::Direct,
    }
}

/// The object that a call made, if it was asked for and made.
///
/// # Safety
/// `made` is null, or the variable of a call that returned `result`.
unsafe fn made(result: HRESULT, made: *mut *mut c_void) -> Option<*mut c_void> {
    // SAFETY: the caller's promise.
    (result.is_ok() && !made.is_null()).then(|| unsafe { *made }).filter(|object| !object.is_null())
}

/// Bytes that a live resource takes in a heap.
fn allocated_bytes(object: *mut c_void) -> u64 {
    // SAFETY: a live resource, which is not released here.
    let resource = unsafe { ID3D12Resource::from_raw_borrowed(&object) }.expect("a resource");
    let mut device: Option<ID3D12Device> = None;
    // SAFETY: a live resource, and a variable that lives during the call.
    unsafe { resource.GetDevice(&mut device) }.expect("its device");
    // SAFETY: a live device and a live resource.
    unsafe { device.expect("its device").GetResourceAllocationInfo(0, &[resource.GetDesc()]) }.SizeInBytes
}

impl Calls {
    fn write_view(
        &mut self,
        function: &'static str,
        at: D3D12_CPU_DESCRIPTOR_HANDLE,
        kind: DescriptorKind,
        resource: Option<(Id, Region)>,
    ) {
        self.recorder.write_view(function, at.ptr as u64, View { kind, resource });
    }

    fn add_list(
        &mut self,
        object: *mut c_void,
        kind: D3D12_COMMAND_LIST_TYPE,
        allocator: Option<Id>,
        pipeline: Option<Id>,
    ) {
        let id = self.add(object, ObjectKind::List, "command list");
        self.recorder.create_list(id, list_kind(kind), allocator, pipeline);
        // SAFETY: a live list, and the tables of all lists.
        unsafe {
            hooks::list::install(object);
            let list = ID3D12GraphicsCommandList::from_raw_borrowed(&object).expect("a list");
            list::install(Interface::vtable(list));
            if let Ok(seventh) = list.cast::<ID3D12GraphicsCommandList7>() {
                barriers::install(Interface::vtable(&seventh));
            }
        }
    }

    /// A resource from a heap's properties and flags.
    fn add_committed(&mut self, object: *mut c_void, properties: *const D3D12_HEAP_PROPERTIES, start: Start) {
        // SAFETY: the description of a call that succeeded.
        let memory = resource::memory(unsafe { &*properties });
        self.add_resource_with(object, memory, start, None);
    }

    /// A resource in a heap, from a byte of it on.
    fn add_placed(&mut self, object: *mut c_void, heap: *mut c_void, at: u64, start: Start) {
        // SAFETY: a live heap, which is not released here.
        let memory = match unsafe { ID3D12Heap::from_raw_borrowed(&heap) } {
            // SAFETY: a live heap.
            Some(heap) => resource::memory(&unsafe { heap.GetDesc() }.Properties),
            None => Memory::Default,
        };
        let placed = self.id(heap).map(|heap| HeapRange { heap, bytes: at..at + allocated_bytes(object) });
        self.add_resource_with(object, memory, start, placed);
    }

    fn add_heap(&mut self, object: *mut c_void) {
        self.add(object, ObjectKind::Heap, "heap");
        // SAFETY: a live heap.
        unsafe { hooks::heap::install(object) };
    }

    fn add_pipeline(&mut self, object: *mut c_void, root: Option<Id>) {
        let id = self.add(object, ObjectKind::Pipeline, "pipeline");
        self.recorder.create_pipeline(id, root);
        // SAFETY: a live pipeline.
        unsafe { hooks::pipeline::install(object) };
    }

    /// `count` objects of a call about residency.
    ///
    /// # Safety
    /// `objects` has as many pointers.
    unsafe fn pageable(&self, count: u32, objects: *const *mut c_void) -> Vec<Id> {
        // SAFETY: the caller's promise.
        (0..count as usize).filter_map(|i| self.id(unsafe { *objects.add(i) })).collect()
    }
}

/// Reports a new object.
///
/// # Safety
/// As [`made`].
unsafe fn created(result: HRESULT, variable: *mut *mut c_void, add: impl FnOnce(&mut Calls, *mut c_void)) {
    // SAFETY: the caller's promise.
    if let Some(object) = unsafe { made(result, variable) } {
        report(caller(), |calls| add(calls, object));
    }
}

hooks! { ID3D12Device_Vtbl;
    fn CreateCommandQueue[original](this, desc: *const D3D12_COMMAND_QUEUE_DESC, id: *const GUID, made: *mut *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on; a live queue, and the table of all queues.
        unsafe {
            let result = original(this, desc, id, made);
            created(result, made, |calls, object| {
                let kind = list_kind((*desc).Type);
                let id = calls.add(object, ObjectKind::Queue, "queue");
                calls.recorder.create_queue(id, kind);
                hooks::queue::install(object);
                queues::install(Interface::vtable(ID3D12CommandQueue::from_raw_borrowed(&object).expect("a queue")));
            });
            result
        }
    }
    fn CreateCommandAllocator[original](this, kind: D3D12_COMMAND_LIST_TYPE, id: *const GUID, made: *mut *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on; a live allocator, and the table of all allocators.
        unsafe {
            let result = original(this, kind, id, made);
            created(result, made, |calls, object| {
                let id = calls.add(object, ObjectKind::Allocator, "allocator");
                calls.recorder.create_allocator(id, list_kind(kind));
                hooks::allocator::install(object);
                allocators::install(Interface::vtable(ID3D12CommandAllocator::from_raw_borrowed(&object).expect("an allocator")));
            });
            result
        }
    }
    fn CreateGraphicsPipelineState[original](
        this, desc: *const D3D12_GRAPHICS_PIPELINE_STATE_DESC, id: *const GUID, made: *mut *mut c_void,
    ) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, desc, id, made);
            created(result, made, |calls, object| calls.add_pipeline(object, None));
            result
        }
    }
    fn CreateComputePipelineState[original](
        this, desc: *const D3D12_COMPUTE_PIPELINE_STATE_DESC, id: *const GUID, made: *mut *mut c_void,
    ) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, desc, id, made);
            created(result, made, |calls, object| {
                let root = (*desc).pRootSignature.as_ref().and_then(|root| calls.id(root.as_raw()));
                calls.add_pipeline(object, root);
            });
            result
        }
    }
    fn CreateCommandList[original](
        this, node: u32, kind: D3D12_COMMAND_LIST_TYPE, allocator: *mut c_void, pipeline: *mut c_void, id: *const GUID,
        made: *mut *mut c_void,
    ) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, node, kind, allocator, pipeline, id, made);
            created(result, made, |calls, object| {
                let (allocator, pipeline) = (calls.id(allocator), calls.id(pipeline));
                calls.add_list(object, kind, allocator, pipeline);
            });
            result
        }
    }
    fn CreateDescriptorHeap[original](this, desc: *const D3D12_DESCRIPTOR_HEAP_DESC, id: *const GUID, made: *mut *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on; a live device and a live heap.
        unsafe {
            let result = original(this, desc, id, made);
            let step = ID3D12Device::from_raw_borrowed(&this).expect("a device").GetDescriptorHandleIncrementSize((*desc).Type);
            created(result, made, |calls, object| {
                let heap = ID3D12DescriptorHeap::from_raw_borrowed(&object).expect("a heap");
                let is_visible = (*desc).Flags.contains(D3D12_DESCRIPTOR_HEAP_FLAG_SHADER_VISIBLE);
                let described = HeapDesc {
                    cpu: heap.GetCPUDescriptorHandleForHeapStart().ptr as u64,
                    gpu: is_visible.then(|| heap.GetGPUDescriptorHandleForHeapStart().ptr),
                    step: u64::from(step),
                    count: (*desc).NumDescriptors,
                    has_samplers: (*desc).Type == D3D12_DESCRIPTOR_HEAP_TYPE_SAMPLER,
                };
                let id = calls.add(object, ObjectKind::DescriptorHeap, "descriptor heap");
                calls.recorder.create_descriptor_heap(id, described);
                hooks::descriptor_heap::install(object);
            });
            result
        }
    }
    fn CreateRootSignature[original](
        this, node: u32, bytes: *const c_void, size: usize, id: *const GUID, made: *mut *mut c_void,
    ) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, node, bytes, size, id, made);
            created(result, made, |calls, object| {
                // Root signatures are shared: a second one of the same content can be the first.
                if calls.id(object).is_some() {
                    return;
                }
                let id = calls.add(object, ObjectKind::RootSignature, "root signature");
                if let Some(signature) = RootSignature::parse(std::slice::from_raw_parts(bytes.cast(), size)) {
                    calls.recorder.create_root_signature(id, signature);
                }
                hooks::root_signature::install(object);
            });
            result
        }
    }
    fn CreateConstantBufferView[original](this, desc: *const D3D12_CONSTANT_BUFFER_VIEW_DESC, at: D3D12_CPU_DESCRIPTOR_HANDLE) {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            report(caller(), |calls| {
                let part = desc.as_ref().and_then(|desc| {
                    let (buffer, bytes) = calls.recorder.buffer_at(desc.BufferLocation)?;
                    Some((buffer, Region::Bytes(bytes.start..bytes.start + u64::from(desc.SizeInBytes))))
                });
                calls.write_view("ID3D12Device::CreateConstantBufferView", at, DescriptorKind::Cbv, part);
            });
            original(this, desc, at);
        }
    }
    fn CreateShaderResourceView[original](
        this, resource: *mut c_void, desc: *const D3D12_SHADER_RESOURCE_VIEW_DESC, at: D3D12_CPU_DESCRIPTOR_HANDLE,
    ) {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            report(caller(), |calls| {
                let part = calls.resource(resource).map(|resource| (resource, views::of_srv(desc.as_ref())));
                calls.write_view("ID3D12Device::CreateShaderResourceView", at, DescriptorKind::Srv, part);
            });
            original(this, resource, desc, at);
        }
    }
    fn CreateUnorderedAccessView[original](
        this, resource: *mut c_void, counter: *mut c_void, desc: *const D3D12_UNORDERED_ACCESS_VIEW_DESC,
        at: D3D12_CPU_DESCRIPTOR_HANDLE,
    ) {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            report(caller(), |calls| {
                let part = calls.resource(resource).map(|resource| (resource, views::of_uav(desc.as_ref())));
                calls.write_view("ID3D12Device::CreateUnorderedAccessView", at, DescriptorKind::Uav, part);
            });
            original(this, resource, counter, desc, at);
        }
    }
    fn CreateRenderTargetView[original](
        this, resource: *mut c_void, desc: *const D3D12_RENDER_TARGET_VIEW_DESC, at: D3D12_CPU_DESCRIPTOR_HANDLE,
    ) {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            report(caller(), |calls| {
                let part = calls.resource(resource).map(|resource| (resource, views::of_rtv(desc.as_ref())));
                calls.write_view("ID3D12Device::CreateRenderTargetView", at, DescriptorKind::Target, part);
            });
            original(this, resource, desc, at);
        }
    }
    fn CreateDepthStencilView[original](
        this, resource: *mut c_void, desc: *const D3D12_DEPTH_STENCIL_VIEW_DESC, at: D3D12_CPU_DESCRIPTOR_HANDLE,
    ) {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            report(caller(), |calls| {
                let part = calls.resource(resource).map(|resource| (resource, Region::All));
                calls.write_view("ID3D12Device::CreateDepthStencilView", at, DescriptorKind::Target, part);
            });
            original(this, resource, desc, at);
        }
    }
    fn CreateSampler[original](this, desc: *const D3D12_SAMPLER_DESC, at: D3D12_CPU_DESCRIPTOR_HANDLE) {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            report(caller(), |calls| calls.write_view("ID3D12Device::CreateSampler", at, DescriptorKind::Sampler, None));
            original(this, desc, at);
        }
    }
    fn CopyDescriptors[original](
        this, to_count: u32, to: *const D3D12_CPU_DESCRIPTOR_HANDLE, to_sizes: *const u32, from_count: u32,
        from: *const D3D12_CPU_DESCRIPTOR_HANDLE, from_sizes: *const u32, kind: D3D12_DESCRIPTOR_HEAP_TYPE,
    ) {
        // SAFETY: the caller's own arguments, passed on; sizes that are null are 1.
        unsafe {
            report(caller(), |calls| {
                let expand = |calls: &Calls, count: u32, starts: *const D3D12_CPU_DESCRIPTOR_HANDLE, sizes: *const u32| {
                    let range = |i: usize| {
                        let start = (*starts.add(i)).ptr as u64;
                        let size = if sizes.is_null() { 1 } else { *sizes.add(i) };
                        let step = calls.recorder.descriptor_step(start).unwrap_or_default();
                        (0..u64::from(size)).map(move |j| start + j * step).collect::<Vec<_>>()
                    };
                    (0..count as usize).flat_map(range).collect::<Vec<u64>>()
                };
                let (to, from) = (expand(calls, to_count, to, to_sizes), expand(calls, from_count, from, from_sizes));
                for (to, from) in to.into_iter().zip(from) {
                    calls.recorder.copy_view("ID3D12Device::CopyDescriptors", to, from);
                }
            });
            original(this, to_count, to, to_sizes, from_count, from, from_sizes, kind);
        }
    }
    fn CopyDescriptorsSimple[original](
        this, count: u32, to: D3D12_CPU_DESCRIPTOR_HANDLE, from: D3D12_CPU_DESCRIPTOR_HANDLE, kind: D3D12_DESCRIPTOR_HEAP_TYPE,
    ) {
        report(caller(), |calls| {
            let (to, from) = (to.ptr as u64, from.ptr as u64);
            let step = calls.recorder.descriptor_step(to).unwrap_or_default();
            for i in 0..u64::from(count) {
                calls.recorder.copy_view("ID3D12Device::CopyDescriptorsSimple", to + i * step, from + i * step);
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, count, to, from, kind) }
    }
    fn CreateCommittedResource[original](
        this, properties: *const D3D12_HEAP_PROPERTIES, flags: D3D12_HEAP_FLAGS, desc: *const D3D12_RESOURCE_DESC,
        state: D3D12_RESOURCE_STATES, clear: *const D3D12_CLEAR_VALUE, id: *const GUID, made: *mut *mut c_void,
    ) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, properties, flags, desc, state, clear, id, made);
            created(result, made, |calls, object| calls.add_committed(object, properties, Start::State(state)));
            result
        }
    }
    fn CreateHeap[original](this, desc: *const D3D12_HEAP_DESC, id: *const GUID, made: *mut *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, desc, id, made);
            created(result, made, |calls, object| calls.add_heap(object));
            result
        }
    }
    fn CreatePlacedResource[original](
        this, heap: *mut c_void, at: u64, desc: *const D3D12_RESOURCE_DESC, state: D3D12_RESOURCE_STATES,
        clear: *const D3D12_CLEAR_VALUE, id: *const GUID, made: *mut *mut c_void,
    ) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, heap, at, desc, state, clear, id, made);
            created(result, made, |calls, object| calls.add_placed(object, heap, at, Start::State(state)));
            result
        }
    }
    fn CreateReservedResource[original](
        this, desc: *const D3D12_RESOURCE_DESC, state: D3D12_RESOURCE_STATES, clear: *const D3D12_CLEAR_VALUE, id: *const GUID,
        made: *mut *mut c_void,
    ) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, desc, state, clear, id, made);
            created(result, made, |calls, object| _ = calls.add_resource(object, Memory::Default, state, None));
            result
        }
    }
    fn CreateFence[original](this, first: u64, flags: D3D12_FENCE_FLAGS, id: *const GUID, made: *mut *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on; a live fence, and the table of all fences.
        unsafe {
            let result = original(this, first, flags, id, made);
            created(result, made, |calls, object| {
                let id = calls.add(object, ObjectKind::Fence, "fence");
                calls.recorder.create_fence(id, first);
                hooks::fence::install(object);
                fences::install(Interface::vtable(ID3D12Fence::from_raw_borrowed(&object).expect("a fence")));
            });
            result
        }
    }
    fn CreateQueryHeap[original](this, desc: *const D3D12_QUERY_HEAP_DESC, id: *const GUID, made: *mut *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, desc, id, made);
            created(result, made, |calls, object| {
                calls.add(object, ObjectKind::QueryHeap, "query heap");
                hooks::query_heap::install(object);
            });
            result
        }
    }
    fn MakeResident[original](this, count: u32, objects: *const *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            let result = original(this, count, objects);
            if result.is_ok() {
                report(caller(), |calls| calls.pageable(count, objects).into_iter().for_each(|id| calls.recorder.make_resident(id)));
            }
            result
        }
    }
    fn Evict[original](this, count: u32, objects: *const *mut c_void) -> HRESULT {
        // SAFETY: the caller's own arguments, passed on.
        unsafe {
            report(caller(), |calls| {
                for id in calls.pageable(count, objects) {
                    calls.recorder.evict("ID3D12Device::Evict", id);
                }
            });
            original(this, count, objects)
        }
    }
}

/// `ID3D12Device3`.
mod third {
    use super::*;

    hooks! { ID3D12Device3_Vtbl;
        fn EnqueueMakeResident[original](
            this, flags: D3D12_RESIDENCY_FLAGS, count: u32, objects: *const *mut c_void, fence: *mut c_void, value: u64,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, flags, count, objects, fence, value);
                if result.is_ok() {
                    report(caller(), |calls| {
                        calls.pageable(count, objects).into_iter().for_each(|id| calls.recorder.make_resident(id));
                        if let Some(fence) = calls.id(fence) {
                            calls.recorder.signal_by_host(fence, value);
                        }
                    });
                }
                result
            }
        }
    }
}

/// `ID3D12Device4`.
mod fourth {
    use super::*;

    hooks! { ID3D12Device4_Vtbl;
        fn CreateCommandList1[original](
            this, node: u32, kind: D3D12_COMMAND_LIST_TYPE, flags: D3D12_COMMAND_LIST_FLAGS, id: *const GUID, made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, node, kind, flags, id, made);
                created(result, made, |calls, object| calls.add_list(object, kind, None, None));
                result
            }
        }
        fn CreateCommittedResource1[original](
            this, properties: *const D3D12_HEAP_PROPERTIES, flags: D3D12_HEAP_FLAGS, desc: *const D3D12_RESOURCE_DESC,
            state: D3D12_RESOURCE_STATES, clear: *const D3D12_CLEAR_VALUE, session: *mut c_void, id: *const GUID,
            made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, properties, flags, desc, state, clear, session, id, made);
                created(result, made, |calls, object| calls.add_committed(object, properties, Start::State(state)));
                result
            }
        }
        fn CreateHeap1[original](
            this, desc: *const D3D12_HEAP_DESC, session: *mut c_void, id: *const GUID, made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, desc, session, id, made);
                created(result, made, |calls, object| calls.add_heap(object));
                result
            }
        }
    }
}

/// `ID3D12Device8`.
mod eighth {
    use super::*;

    hooks! { ID3D12Device8_Vtbl;
        fn CreateCommittedResource2[original](
            this, properties: *const D3D12_HEAP_PROPERTIES, flags: D3D12_HEAP_FLAGS, desc: *const D3D12_RESOURCE_DESC1,
            state: D3D12_RESOURCE_STATES, clear: *const D3D12_CLEAR_VALUE, session: *mut c_void, id: *const GUID,
            made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, properties, flags, desc, state, clear, session, id, made);
                created(result, made, |calls, object| calls.add_committed(object, properties, Start::State(state)));
                result
            }
        }
        fn CreatePlacedResource1[original](
            this, heap: *mut c_void, at: u64, desc: *const D3D12_RESOURCE_DESC1, state: D3D12_RESOURCE_STATES,
            clear: *const D3D12_CLEAR_VALUE, id: *const GUID, made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, heap, at, desc, state, clear, id, made);
                created(result, made, |calls, object| calls.add_placed(object, heap, at, Start::State(state)));
                result
            }
        }
    }
}

/// `ID3D12Device10`: resources with a layout.
mod tenth {
    use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT;

    use super::*;

    hooks! { ID3D12Device10_Vtbl;
        fn CreateCommittedResource3[original](
            this, properties: *const D3D12_HEAP_PROPERTIES, flags: D3D12_HEAP_FLAGS, desc: *const D3D12_RESOURCE_DESC1,
            layout: D3D12_BARRIER_LAYOUT, clear: *const D3D12_CLEAR_VALUE, session: *mut c_void, count: u32,
            formats: *const DXGI_FORMAT, id: *const GUID, made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result =
                    original(this, properties, flags, desc, layout, clear, session, count, formats, id, made);
                created(result, made, |calls, object| calls.add_committed(object, properties, Start::Layout(layout)));
                result
            }
        }
        fn CreatePlacedResource2[original](
            this, heap: *mut c_void, at: u64, desc: *const D3D12_RESOURCE_DESC1, layout: D3D12_BARRIER_LAYOUT,
            clear: *const D3D12_CLEAR_VALUE, count: u32, formats: *const DXGI_FORMAT, id: *const GUID,
            made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, heap, at, desc, layout, clear, count, formats, id, made);
                created(result, made, |calls, object| calls.add_placed(object, heap, at, Start::Layout(layout)));
                result
            }
        }
        fn CreateReservedResource2[original](
            this, desc: *const D3D12_RESOURCE_DESC, layout: D3D12_BARRIER_LAYOUT, clear: *const D3D12_CLEAR_VALUE,
            session: *mut c_void, count: u32, formats: *const DXGI_FORMAT, id: *const GUID, made: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, desc, layout, clear, session, count, formats, id, made);
                created(result, made, |calls, object| {
                    _ = calls.add_resource_with(object, Memory::Default, Start::Layout(layout), None);
                });
                result
            }
        }
    }
}
