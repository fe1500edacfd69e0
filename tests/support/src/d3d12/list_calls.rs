//! Counts the calls by which a thread records dispatches and barriers into command lists.

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::OnceLock;

use cairn::gpu::windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_BARRIER, ID3D12GraphicsCommandList};
use cairn::gpu::windows::core::Interface;

use super::function_tables::replace_function;

thread_local! {
    static CALLS: Cell<usize> = const { Cell::new(0) };
}

type Dispatch = unsafe extern "system" fn(*mut c_void, u32, u32, u32);
type ResourceBarrier = unsafe extern "system" fn(*mut c_void, u32, *const D3D12_RESOURCE_BARRIER);
static DISPATCH: OnceLock<Dispatch> = OnceLock::new();
static RESOURCE_BARRIER: OnceLock<ResourceBarrier> = OnceLock::new();

/// The number of dispatches and calls for barriers that `record` makes on this thread, in lists of the same kind as `list`.
pub fn count_list_calls(list: &ID3D12GraphicsCommandList, record: impl FnOnce()) -> usize {
    let table = Interface::vtable(list);
    replace_function(&raw const table.Dispatch, &DISPATCH, dispatch);
    replace_function(&raw const table.ResourceBarrier, &RESOURCE_BARRIER, resource_barrier);
    CALLS.set(0);
    record();
    CALLS.get()
}

unsafe extern "system" fn dispatch(this: *mut c_void, x: u32, y: u32, z: u32) {
    CALLS.set(CALLS.get() + 1);
    let original = DISPATCH.get().expect("the original function");
    // SAFETY: the caller's own arguments.
    unsafe { original(this, x, y, z) }
}

unsafe extern "system" fn resource_barrier(this: *mut c_void, count: u32, barriers: *const D3D12_RESOURCE_BARRIER) {
    CALLS.set(CALLS.get() + 1);
    let original = RESOURCE_BARRIER.get().expect("the original function");
    // SAFETY: the caller's own arguments.
    unsafe { original(this, count, barriers) }
}
