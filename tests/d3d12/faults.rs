//! Injects failures into a device's calls, whoever makes them: this library, DirectML or ONNX Runtime.

use std::ffi::c_void;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock};

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Foundation::E_OUTOFMEMORY;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{GUID, HRESULT, Interface};

use super::tables::replace;

/// Calls until the failure; 0 for none.
static LEFT: AtomicU64 = AtomicU64::new(0);
/// Whether all calls after it fail as well.
static LASTS: AtomicBool = AtomicBool::new(false);
/// Whether a call has failed.
static CAME: AtomicBool = AtomicBool::new(false);
/// Fences, by address, whose completed value can be hidden.
static WATCHED: Mutex<Vec<usize>> = Mutex::new(Vec::new());
static STANDS: AtomicBool = AtomicBool::new(false);

/// Makes the `n`-th allocation from now on fail, once.
pub(crate) fn fail_at(n: u64) {
    LASTS.store(false, Ordering::SeqCst);
    LEFT.store(n, Ordering::SeqCst);
}

/// Makes the `n`-th allocation from now on fail, and all after it.
pub(crate) fn fail_from(n: u64) {
    LASTS.store(true, Ordering::SeqCst);
    LEFT.store(n, Ordering::SeqCst);
}

/// Ends the injection; returns whether the failure was still to come.
pub(crate) fn is_left() -> bool {
    LEFT.store(0, Ordering::SeqCst);
    !CAME.swap(false, Ordering::SeqCst)
}

/// Adds the fence of a device's queue for anchors.
pub(crate) fn watch(gpu: &Gpu) {
    let fence_point = gpu.anchors().now().expect("a moment");
    WATCHED.lock().expect("nobody panics here").push(fence_point.fence().as_raw() as usize);
}

/// While `stands`, the watched fences report no completed work, so that pools cannot reuse their memory and allocate anew. Waits
/// for them still end.
pub(crate) fn time_stands(stands: bool) {
    STANDS.store(stands, Ordering::SeqCst);
}

/// Whether this call fails.
fn fails() -> bool {
    let lasts = LASTS.load(Ordering::SeqCst);
    let next = |left: u64| if lasts && left == 1 { None } else { left.checked_sub(1) };
    let (Ok(left) | Err(left)) = LEFT.fetch_update(Ordering::SeqCst, Ordering::SeqCst, next);
    CAME.fetch_or(left == 1, Ordering::SeqCst);
    left == 1
}

/// Replaces functions in the table that devices share: each fails when it is its turn, else calls the original.
macro_rules! faulty {
    ($($name:ident($($argument:ident: $kind:ty),*);)*) => {
        #[allow(non_upper_case_globals, reason = "Direct3D's names")]
        mod theirs {
            use super::*;
            $(pub(super) static $name: OnceLock<unsafe extern "system" fn(*mut c_void, $($kind),*) -> HRESULT> = OnceLock::new();)*
        }
        #[allow(non_snake_case, reason = "Direct3D's names")]
        mod ours {
            use super::*;
            $(pub(super) unsafe extern "system" fn $name(this: *mut c_void, $($argument: $kind),*) -> HRESULT {
                if fails() {
                    return E_OUTOFMEMORY;
                }
                let theirs = theirs::$name.get().expect("what it replaces");
                // SAFETY: the caller's own arguments, passed on.
                unsafe { theirs(this, $($argument),*) }
            })*
        }
        /// Makes the allocations of all devices like `device`, and their fences' completed values, controllable for the rest of the process.
        pub(crate) fn install(device: &ID3D12Device) {
            let table = Interface::vtable(device);
            $(replace(&raw const table.$name, &theirs::$name, ours::$name);)*
            // SAFETY: a live device.
            let fence: ID3D12Fence = unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
            let table = Interface::vtable(&fence);
            replace(&raw const table.GetCompletedValue, &THEIR_VALUE, our_value);
        }
    };
}

static THEIR_VALUE: OnceLock<unsafe extern "system" fn(*mut c_void) -> u64> = OnceLock::new();

unsafe extern "system" fn our_value(this: *mut c_void) -> u64 {
    if STANDS.load(Ordering::SeqCst) && WATCHED.lock().expect("nobody panics here").contains(&(this as usize)) {
        return 0;
    }
    let theirs = THEIR_VALUE.get().expect("what it replaces");
    // SAFETY: the caller's own fence.
    unsafe { theirs(this) }
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
