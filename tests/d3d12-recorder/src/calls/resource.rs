//! `ID3D12Resource`: new resources, and their mapped memory.

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::core::{HRESULT, Interface};

use super::hooks::{self, caller};
use super::{Calls, report};
use crate::layouts::Layout;
use crate::recorder::{HeapRange, Memory, ObjectKind, ResourceDesc};
use crate::states::State;
use crate::timeline::Id;

/// Type of the heap that has a resource.
pub(super) fn memory(properties: &D3D12_HEAP_PROPERTIES) -> Memory {
    match properties.Type {
        D3D12_HEAP_TYPE_DEFAULT => Memory::Default,
        D3D12_HEAP_TYPE_UPLOAD => Memory::Upload,
        D3D12_HEAP_TYPE_READBACK => Memory::Readback,
        _ => Memory::Custom,
    }
}

/// Depth and stencil, or brightness and colour, are planes.
fn planes(format: DXGI_FORMAT) -> u32 {
    match format {
        DXGI_FORMAT_R24G8_TYPELESS
        | DXGI_FORMAT_D24_UNORM_S8_UINT
        | DXGI_FORMAT_R32G8X24_TYPELESS
        | DXGI_FORMAT_D32_FLOAT_S8X24_UINT
        | DXGI_FORMAT_NV12
        | DXGI_FORMAT_P010 => 2,
        _ => 1,
    }
}

/// What a resource is in after its creation.
#[derive(Debug, Clone, Copy)]
pub(super) enum Start {
    State(D3D12_RESOURCE_STATES),
    Layout(D3D12_BARRIER_LAYOUT),
}

impl Calls {
    /// A new resource in a state.
    pub(super) fn add_resource(
        &mut self,
        object: *mut c_void,
        memory: Memory,
        state: D3D12_RESOURCE_STATES,
        placed: Option<HeapRange>,
    ) -> Id {
        self.add_resource_with(object, memory, Start::State(state), placed)
    }

    /// A new resource, whose calls are recorded.
    pub(super) fn add_resource_with(
        &mut self,
        object: *mut c_void,
        memory: Memory,
        start: Start,
        placed: Option<HeapRange>,
    ) -> Id {
        let (state, layout) = match start {
            Start::State(state) => (State(state.0 as u32), None),
            Start::Layout(layout) => (State::COMMON, Some(Layout(layout.0 as u32))),
        };
        // SAFETY: a live resource, which is not released here.
        let resource = unsafe { ID3D12Resource::from_raw_borrowed(&object) }.expect("a resource");
        // SAFETY: a live resource.
        let desc = unsafe { resource.GetDesc() };
        let is_buffer = desc.Dimension == D3D12_RESOURCE_DIMENSION_BUFFER;
        let is_volume = desc.Dimension == D3D12_RESOURCE_DIMENSION_TEXTURE3D;
        let slices = if is_volume { 1 } else { u32::from(desc.DepthOrArraySize) };
        let allowed = [
            (D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, State::RENDER_TARGET.0),
            (D3D12_RESOURCE_FLAG_ALLOW_DEPTH_STENCIL, State::DEPTH_WRITE.0 | State::DEPTH_READ.0),
            (D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, State::UNORDERED_ACCESS.0),
        ];
        let allowed =
            allowed.iter().filter(|(flag, _)| desc.Flags.contains(*flag)).fold(0, |all, (_, state)| all | state);
        // SAFETY: a live buffer.
        let address = is_buffer.then(|| unsafe { resource.GetGPUVirtualAddress() }).filter(|address| *address != 0);
        let label = match is_buffer {
            true => format!("buffer of {} bytes", desc.Width),
            false => format!("texture of {}x{} and format {}", desc.Width, desc.Height, desc.Format.0),
        };
        let id = self.add(object, ObjectKind::Resource, label);
        let described = ResourceDesc {
            is_buffer,
            bytes: desc.Width,
            shape: [u32::from(desc.MipLevels), slices, planes(desc.Format)],
            memory,
            is_simultaneous: desc.Flags.contains(D3D12_RESOURCE_FLAG_ALLOW_SIMULTANEOUS_ACCESS),
            allowed: State(allowed),
            state,
            layout,
            placed,
            address,
        };
        self.recorder.create_resource(id, described);
        // SAFETY: a live resource, and the table of all resources.
        unsafe {
            hooks::resource::install(object);
            install(Interface::vtable(resource));
        }
        id
    }

    /// Number of a resource. One that no call made, such as a buffer of a swap chain, is in COMMON when it is first seen.
    pub(super) fn resource(&mut self, object: *mut c_void) -> Option<Id> {
        if object.is_null() {
            return None;
        }
        if let Some(id) = self.id(object) {
            return Some(id);
        }
        let id = self.add_resource(object, Memory::Default, D3D12_RESOURCE_STATE_COMMON, None);
        self.recorder.keep(id);
        Some(id)
    }
}

/// A range of the processor's accesses; null for all of the resource.
///
/// # Safety
/// Null, or a range that lives during the call.
unsafe fn range(range: *const D3D12_RANGE) -> Option<std::ops::Range<u64>> {
    // SAFETY: the caller's promise.
    unsafe { range.as_ref() }.map(|range| range.Begin as u64..range.End as u64)
}

hooks::hooks! { ID3D12Resource_Vtbl;
    fn Map[original](this, subresource: u32, read: *const D3D12_RANGE, data: *mut *mut c_void) -> HRESULT {
        let caller = caller();
        // SAFETY: the caller's own arguments, passed on.
        let (read_range, result) = unsafe { (range(read), original(this, subresource, read, data)) };
        report(caller, |calls| {
            if let Some(resource) = calls.resource(this) {
                calls.recorder.map(resource, subresource, read_range);
            }
        });
        result
    }
    fn Unmap[original](this, subresource: u32, written: *const D3D12_RANGE) {
        // SAFETY: the caller's own arguments.
        let written_range = unsafe { range(written) };
        report(caller(), |calls| {
            if let Some(resource) = calls.resource(this) {
                calls.recorder.unmap(resource, written_range);
            }
        });
        // SAFETY: the caller's own arguments, passed on.
        unsafe { original(this, subresource, written) }
    }
}
