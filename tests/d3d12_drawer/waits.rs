//! Counts the waits of a queue.

use std::ffi::c_void;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use cairn::gpu::windows::Win32::Graphics::Direct3D12::ID3D12CommandQueue;
use cairn::gpu::windows::core::{HRESULT, Interface};
use test_support::d3d12::function_tables::replace_function;

static QUEUE: AtomicUsize = AtomicUsize::new(0);
static WAITS: AtomicUsize = AtomicUsize::new(0);

type Wait = unsafe extern "system" fn(*mut c_void, *mut c_void, u64) -> HRESULT;
static ORIGINAL_WAIT: OnceLock<Wait> = OnceLock::new();

/// Counts the waits of `queue` from now on. Queues share their table of functions; other queues are not counted.
pub(crate) fn count(queue: &ID3D12CommandQueue) {
    QUEUE.store(queue.as_raw() as usize, Ordering::SeqCst);
    WAITS.store(0, Ordering::SeqCst);
    replace_function(&raw const Interface::vtable(queue).Wait, &ORIGINAL_WAIT, hook_wait);
}

/// The number of waits so far.
pub(crate) fn counted() -> usize {
    WAITS.load(Ordering::SeqCst)
}

unsafe extern "system" fn hook_wait(this: *mut c_void, fence: *mut c_void, value: u64) -> HRESULT {
    if this as usize == QUEUE.load(Ordering::SeqCst) {
        WAITS.fetch_add(1, Ordering::SeqCst);
    }
    let original = ORIGINAL_WAIT.get().expect("the original function");
    // SAFETY: the caller's own arguments.
    unsafe { original(this, fence, value) }
}
