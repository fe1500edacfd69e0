//! `ID3D12CommandQueue`, `ID3D12Fence` and `ID3D12CommandAllocator`.

/// Queues.
pub(super) mod queues {
    use std::ffi::c_void;

    use windows::Win32::Graphics::Direct3D12::*;
    use windows::core::HRESULT;

    use super::super::hooks::{caller, hooks};
    use super::super::{report, tiles};

    /// Metadata value of an event whose name is a string of bytes.
    const BYTES: u32 = 1;

    /// Name of an event; of one in another form than a string of bytes its number.
    ///
    /// # Safety
    /// `data` has `size` bytes.
    unsafe fn event_name(kind: u32, data: *const c_void, size: u32) -> String {
        if kind != BYTES || data.is_null() {
            return format!("event of kind {kind}");
        }
        // SAFETY: the caller's promise.
        let bytes = unsafe { std::slice::from_raw_parts(data.cast::<u8>(), size as usize) };
        String::from_utf8_lossy(bytes).trim_end_matches('\0').to_owned()
    }

    hooks! { ID3D12CommandQueue_Vtbl;
        fn UpdateTileMappings[original](
            this, resource: *mut c_void, regions: u32, starts: *const D3D12_TILED_RESOURCE_COORDINATE,
            sizes: *const D3D12_TILE_REGION_SIZE, heap: *mut c_void, ranges: u32, range_flags: *const D3D12_TILE_RANGE_FLAGS,
            heap_starts: *const u32, counts: *const u32, flags: D3D12_TILE_MAPPING_FLAGS,
        ) {
            let update = tiles::Update { regions, starts, sizes, ranges, flags: range_flags, heap_starts, counts };
            report(caller(), |calls| {
                let heap = calls.id(heap);
                if let (Some(queue), Some(id)) = (calls.id(this), calls.resource(resource)) {
                    // SAFETY: the caller's own arguments.
                    calls.recorder.map_tiles(queue, id, unsafe { tiles::mappings(resource, heap, &update) });
                }
            });
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                original(this, resource, regions, starts, sizes, heap, ranges, range_flags, heap_starts, counts, flags)
            }
        }
        fn CopyTileMappings[original](
            this, to: *mut c_void, to_start: *const D3D12_TILED_RESOURCE_COORDINATE, from: *mut c_void,
            from_start: *const D3D12_TILED_RESOURCE_COORDINATE, size: *const D3D12_TILE_REGION_SIZE,
            flags: D3D12_TILE_MAPPING_FLAGS,
        ) {
            report(caller(), |calls| {
                let ids = (calls.id(this), calls.resource(to), calls.resource(from));
                if let (Some(queue), Some(to_id), Some(from_id)) = ids {
                    let copy = tiles::MappingCopy { to, to_start, from, from_start, size };
                    // SAFETY: the caller's own arguments.
                    calls.recorder.copy_tile_mappings(queue, to_id, from_id, unsafe { tiles::copies(&copy) });
                }
            });
            // SAFETY: the caller's own arguments, passed on.
            unsafe { original(this, to, to_start, from, from_start, size, flags) }
        }
        fn ExecuteCommandLists[original](this, count: u32, lists: *const *mut c_void) {
            let caller = caller();
            // SAFETY: the caller's own lists.
            let given = unsafe { std::slice::from_raw_parts(lists, count as usize) };
            report(caller, |calls| {
                let lists: Vec<_> = given.iter().filter_map(|list| calls.id(*list)).collect();
                if let Some(queue) = calls.id(this) {
                    calls.recorder.execute(queue, &lists);
                }
            });
            // SAFETY: the caller's own arguments, passed on.
            unsafe { original(this, count, lists) }
        }
        fn BeginEvent[original](this, kind: u32, data: *const c_void, size: u32) {
            // SAFETY: the caller's own bytes.
            let name = unsafe { event_name(kind, data, size) };
            report(0, |calls| {
                if let Some(queue) = calls.id(this) {
                    calls.recorder.begin_event(queue, &name);
                }
            });
            // SAFETY: the caller's own arguments, passed on.
            unsafe { original(this, kind, data, size) }
        }
        fn EndEvent[original](this) {
            report(0, |calls| {
                if let Some(queue) = calls.id(this) {
                    calls.recorder.end_event(queue);
                }
            });
            // SAFETY: the caller's own argument, passed on.
            unsafe { original(this) }
        }
        fn Signal[original](this, fence: *mut c_void, value: u64) -> HRESULT {
            report(caller(), |calls| {
                if let (Some(queue), Some(fence)) = (calls.id(this), calls.id(fence)) {
                    calls.recorder.signal(queue, fence, value);
                }
            });
            // SAFETY: the caller's own arguments, passed on.
            unsafe { original(this, fence, value) }
        }
        fn Wait[original](this, fence: *mut c_void, value: u64) -> HRESULT {
            report(caller(), |calls| {
                if let (Some(queue), Some(fence)) = (calls.id(this), calls.id(fence)) {
                    calls.recorder.wait(queue, fence, value);
                }
            });
            // SAFETY: the caller's own arguments, passed on.
            unsafe { original(this, fence, value) }
        }
    }
}

/// Fences.
pub(super) mod fences {
    use std::ffi::c_void;

    use windows::Win32::Foundation::HANDLE;
    use windows::Win32::Graphics::Direct3D12::ID3D12Fence_Vtbl;
    use windows::Win32::System::Threading::CreateEventW;
    use windows::core::{HRESULT, PCWSTR};

    use super::super::hooks::{caller, hooks};
    use super::super::{EVENTS, FenceEvent, report};

    /// The processor found a value, or waited for it.
    fn observe(fence: *mut c_void, value: u64) {
        report(0, |calls| {
            if let Some(fence) = calls.id(fence) {
                calls.recorder.observe(fence, value);
            }
        });
    }

    hooks! { ID3D12Fence_Vtbl;
        fn GetCompletedValue[original](this) -> u64 {
            // SAFETY: the caller's own argument, passed on.
            let value = unsafe { original(this) };
            observe(this, value);
            value
        }
        fn SetEventOnCompletion[original](this, value: u64, event: HANDLE) -> HRESULT {
            if event.is_invalid() {
                // SAFETY: the caller's own arguments, passed on.
                let result = unsafe { original(this, value, event) };
                if result.is_ok() {
                    // It has waited.
                    observe(this, value);
                }
                return result;
            }
            // Our own event first: it is set before the program can go on.
            if let Some(fence) = report(0, |calls| calls.id(this)) {
                // SAFETY: no attributes and no name.
                let own = unsafe { CreateEventW(None, true, false, PCWSTR::null()) }.expect("an event");
                let own = FenceEvent { event: own, fence, value };
                // SAFETY: the caller's own fence, and an event that lives until it was set.
                if unsafe { original(this, value, own.event) }.is_ok() {
                    EVENTS.lock().push(own);
                }
            }
            // SAFETY: the caller's own arguments, passed on.
            unsafe { original(this, value, event) }
        }
        fn Signal[original](this, value: u64) -> HRESULT {
            report(caller(), |calls| {
                if let Some(fence) = calls.id(this) {
                    calls.recorder.signal_by_host(fence, value);
                }
            });
            // SAFETY: the caller's own arguments, passed on.
            unsafe { original(this, value) }
        }
    }
}

/// Allocators.
pub(super) mod allocators {
    use std::ffi::c_void;

    use windows::Win32::Graphics::Direct3D12::ID3D12CommandAllocator_Vtbl;
    use windows::core::HRESULT;

    use super::super::hooks::{caller, hooks};
    use super::super::report;

    hooks! { ID3D12CommandAllocator_Vtbl;
        fn Reset[original](this) -> HRESULT {
            report(caller(), |calls| {
                if let Some(allocator) = calls.id(this) {
                    calls.recorder.reset_allocator(allocator);
                }
            });
            // SAFETY: the caller's own argument, passed on.
            unsafe { original(this) }
        }
    }
}
