//! Injects failures into a device's calls, by this library, DirectML or ONNX Runtime.

use std::ffi::c_void;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock};

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Foundation::E_OUTOFMEMORY;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{GUID, HRESULT, Interface};
use test_support::d3d12::function_tables::replace_function;

/// Calls up to and including the next failing one; 0 for none.
static CALLS_LEFT: AtomicU64 = AtomicU64::new(0);
/// Whether all later calls fail as well.
static PERMANENT: AtomicBool = AtomicBool::new(false);
/// Whether a call has failed.
static FAILED: AtomicBool = AtomicBool::new(false);
/// Fences, by address, whose completed value can be hidden.
static WATCHED: Mutex<Vec<usize>> = Mutex::new(Vec::new());
/// Whether their completed values are hidden.
static HIDDEN: AtomicBool = AtomicBool::new(false);

/// Makes the `n`-th allocation from now on fail, once.
pub(crate) fn fail_at(n: u64) {
    PERMANENT.store(false, Ordering::SeqCst);
    CALLS_LEFT.store(n, Ordering::SeqCst);
}

/// Makes the `n`-th allocation from now on fail, and all after it.
pub(crate) fn fail_from(n: u64) {
    PERMANENT.store(true, Ordering::SeqCst);
    CALLS_LEFT.store(n, Ordering::SeqCst);
}

/// Ends the injection; returns whether no call has failed.
pub(crate) fn stop() -> bool {
    CALLS_LEFT.store(0, Ordering::SeqCst);
    !FAILED.swap(false, Ordering::SeqCst)
}

/// Adds the fence of a device's queue for anchors to the watched ones.
pub(crate) fn watch(gpu: &Gpu) {
    let fence_point = gpu.anchors().signal().expect("a fence point");
    WATCHED.lock().expect("nobody panics here").push(fence_point.fence().as_raw() as usize);
}

/// While `hidden`, the watched fences report no completed work, so that pools cannot reuse their memory and allocate anew. Waits
/// for them still end.
pub(crate) fn hide_completed_work(hidden: bool) {
    HIDDEN.store(hidden, Ordering::SeqCst);
}

/// Whether this call fails.
fn fails() -> bool {
    let permanent = PERMANENT.load(Ordering::SeqCst);
    let next = |left: u64| if permanent && left == 1 { None } else { left.checked_sub(1) };
    let (Ok(left) | Err(left)) = CALLS_LEFT.fetch_update(Ordering::SeqCst, Ordering::SeqCst, next);
    FAILED.fetch_or(left == 1, Ordering::SeqCst);
    left == 1
}

/// Replaces functions in the table that devices share: each fails when it is its turn, else calls the original.
macro_rules! faulty {
    ($($name:ident($($argument:ident: $kind:ty),*);)*) => {
        #[allow(non_upper_case_globals, reason = "Direct3D's names")]
        mod originals {
            use super::*;
            $(pub(super) static $name: OnceLock<unsafe extern "system" fn(*mut c_void, $($kind),*) -> HRESULT> = OnceLock::new();)*
        }
        #[allow(non_snake_case, reason = "Direct3D's names")]
        mod hooks {
            use super::*;
            $(pub(super) unsafe extern "system" fn $name(this: *mut c_void, $($argument: $kind),*) -> HRESULT {
                if fails() {
                    return E_OUTOFMEMORY;
                }
                let original = originals::$name.get().expect("the original function");
                // SAFETY: the caller's own arguments, passed on.
                unsafe { original(this, $($argument),*) }
            })*
        }
        /// Makes the allocations of all devices like `device`, and their fences' completed values, controllable for the rest of the process.
        pub(crate) fn install(device: &ID3D12Device) {
            let table = Interface::vtable(device);
            $(replace_function(&raw const table.$name, &originals::$name, hooks::$name);)*
            // SAFETY: a live device.
            let fence: ID3D12Fence = unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
            let table = Interface::vtable(&fence);
            replace_function(&raw const table.GetCompletedValue, &ORIGINAL_VALUE, completed_value);
        }
    };
}

static ORIGINAL_VALUE: OnceLock<unsafe extern "system" fn(*mut c_void) -> u64> = OnceLock::new();

unsafe extern "system" fn completed_value(this: *mut c_void) -> u64 {
    if HIDDEN.load(Ordering::SeqCst) && WATCHED.lock().expect("nobody panics here").contains(&(this as usize)) {
        return 0;
    }
    let original = ORIGINAL_VALUE.get().expect("the original function");
    // SAFETY: the caller's own fence.
    unsafe { original(this) }
}

faulty! {
    CreateCommandQueue(wanted: *const D3D12_COMMAND_QUEUE_DESC, id: *const GUID, made: *mut *mut c_void);
    CreateCommandAllocator(kind: D3D12_COMMAND_LIST_TYPE, id: *const GUID, made: *mut *mut c_void);
    CreateComputePipelineState(wanted: *const D3D12_COMPUTE_PIPELINE_STATE_DESC, id: *const GUID, made: *mut *mut c_void);
    CreateDescriptorHeap(wanted: *const D3D12_DESCRIPTOR_HEAP_DESC, id: *const GUID, made: *mut *mut c_void);
    CreateCommittedResource(
        properties: *const D3D12_HEAP_PROPERTIES, flags: D3D12_HEAP_FLAGS, wanted: *const D3D12_RESOURCE_DESC,
        state: D3D12_RESOURCE_STATES, clear: *const D3D12_CLEAR_VALUE, id: *const GUID, made: *mut *mut c_void
    );
    CreateHeap(wanted: *const D3D12_HEAP_DESC, id: *const GUID, made: *mut *mut c_void);
    CreateFence(first: u64, flags: D3D12_FENCE_FLAGS, id: *const GUID, made: *mut *mut c_void);
    CreateQueryHeap(wanted: *const D3D12_QUERY_HEAP_DESC, id: *const GUID, made: *mut *mut c_void);
}
