//! Counts the device objects that each thread creates, and controls the driver's cached pipeline blobs.

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::gpu::windows::Win32::Foundation::E_FAIL;
use cairn::gpu::windows::Win32::Graphics::Direct3D::ID3DBlob;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{GUID, HRESULT, Interface};

use super::function_tables::replace_function;

/// Numbers of objects that a thread has created.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CreatedObjects {
    /// All objects.
    pub objects: u64,
    /// Pipelines that the driver compiled.
    pub compiled: u64,
    /// Pipelines that were loaded from a cached blob.
    pub loaded: u64,
}

thread_local! {
    static MADE: Cell<CreatedObjects> = const { Cell::new(CreatedObjects { objects: 0, compiled: 0, loaded: 0 }) };
}

/// The objects that this thread creates in `work`.
pub fn count_created<T>(work: impl FnOnce() -> T) -> (T, CreatedObjects) {
    let before = MADE.take();
    let done = work();
    let made = MADE.replace(before);
    (done, made)
}

fn count(change: impl FnOnce(&mut CreatedObjects)) {
    let mut made = MADE.get();
    made.objects += 1;
    change(&mut made);
    MADE.set(made);
}

/// Whether the driver has another version than the one that compiled the given blob.
static DRIVER_CHANGED: AtomicBool = AtomicBool::new(false);

/// Sets whether the driver has another version from now on.
pub fn set_driver_changed(changed: bool) {
    DRIVER_CHANGED.store(changed, Ordering::SeqCst);
}

/// D3D12_ERROR_DRIVER_VERSION_MISMATCH
const MISMATCH: HRESULT = HRESULT(0x887e_0002_u32.cast_signed());

/// The driver's cached blob of each pipeline: any blob will do.
fn blob() -> ID3DBlob {
    let empty = D3D12_ROOT_SIGNATURE_DESC::default();
    let mut blob = None;
    // SAFETY: a description and a variable that live during the call.
    unsafe { D3D12SerializeRootSignature(&empty, D3D_ROOT_SIGNATURE_VERSION_1, &mut blob, None) }.expect("a blob");
    blob.expect("a blob")
}

type GetBlob = unsafe extern "system" fn(*mut c_void, *mut *mut c_void) -> HRESULT;
static ORIGINAL_BLOB: OnceLock<GetBlob> = OnceLock::new();

unsafe extern "system" fn hook_blob(_: *mut c_void, to: *mut *mut c_void) -> HRESULT {
    // SAFETY: the caller's variable.
    unsafe { to.write(blob().into_raw()) };
    HRESULT(0)
}

type CreateCompute = unsafe extern "system" fn(
    *mut c_void,
    *const D3D12_COMPUTE_PIPELINE_STATE_DESC,
    *const GUID,
    *mut *mut c_void,
) -> HRESULT;
static ORIGINAL_COMPUTE: OnceLock<CreateCompute> = OnceLock::new();

unsafe extern "system" fn hook_compute(
    this: *mut c_void,
    wanted: *const D3D12_COMPUTE_PIPELINE_STATE_DESC,
    id: *const GUID,
    made: *mut *mut c_void,
) -> HRESULT {
    // SAFETY: the caller's description.
    let cached = unsafe { (*wanted).CachedPSO };
    let original = ORIGINAL_COMPUTE.get().expect("the original function");
    if cached.pCachedBlob.is_null() {
        count(|made| made.compiled += 1);
        // SAFETY: the caller's own arguments.
        let result = unsafe { original(this, wanted, id, made) };
        if result.is_ok() {
            // SAFETY: it was made just now.
            unsafe { return_cached_blob(made) };
        }
        return result;
    }
    // SAFETY: the caller's bytes.
    let given = unsafe { std::slice::from_raw_parts(cached.pCachedBlob.cast::<u8>(), cached.CachedBlobSizeInBytes) };
    let own = blob();
    // SAFETY: a live blob.
    let own = unsafe { std::slice::from_raw_parts(own.GetBufferPointer().cast::<u8>(), own.GetBufferSize()) };
    if DRIVER_CHANGED.load(Ordering::SeqCst) {
        return MISMATCH;
    }
    if given != own {
        return E_FAIL;
    }
    count(|made| made.loaded += 1);
    // Leaves out the blob, which this driver cannot read.
    // SAFETY: the caller's description, copied.
    let mut plain = unsafe { std::mem::ManuallyDrop::new(wanted.read()) };
    plain.CachedPSO = D3D12_CACHED_PIPELINE_STATE::default();
    // SAFETY: as above.
    unsafe { original(this, &*plain, id, made) }
}

/// Makes all pipelines return a cached blob, as some drivers do, by the table of functions that they share with this one.
unsafe fn return_cached_blob(made: *mut *mut c_void) {
    // SAFETY: the caller's pipeline, which lives.
    let pipeline = unsafe { ID3D12PipelineState::from_raw_borrowed(&*made) }.expect("a pipeline");
    replace_function(&raw const Interface::vtable(pipeline).GetCachedBlob, &ORIGINAL_BLOB, hook_blob);
}

/// Replaces functions in the table that devices share: each is counted, then calls the original.
macro_rules! counted {
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
                count(|_| ());
                let original = originals::$name.get().expect("the original function");
                // SAFETY: the caller's own arguments, passed on.
                unsafe { original(this, $($argument),*) }
            })*
        }
        /// Counts the objects that devices like `device` create, for the rest of the process.
        pub fn install(device: &ID3D12Device) {
            let table = Interface::vtable(device);
            $(replace_function(&raw const table.$name, &originals::$name, hooks::$name);)*
            replace_function(&raw const table.CreateComputePipelineState, &ORIGINAL_COMPUTE, hook_compute);
        }
    };
}

counted! {
    CreateCommandQueue(wanted: *const D3D12_COMMAND_QUEUE_DESC, id: *const GUID, made: *mut *mut c_void);
    CreateCommandAllocator(kind: D3D12_COMMAND_LIST_TYPE, id: *const GUID, made: *mut *mut c_void);
    CreateCommandList(
        node: u32, kind: D3D12_COMMAND_LIST_TYPE, allocator: *mut c_void, first: *mut c_void, id: *const GUID,
        made: *mut *mut c_void
    );
    CreateDescriptorHeap(wanted: *const D3D12_DESCRIPTOR_HEAP_DESC, id: *const GUID, made: *mut *mut c_void);
    CreateRootSignature(node: u32, bytes: *const c_void, size: usize, id: *const GUID, made: *mut *mut c_void);
    CreateCommittedResource(
        properties: *const D3D12_HEAP_PROPERTIES, flags: D3D12_HEAP_FLAGS, wanted: *const D3D12_RESOURCE_DESC,
        state: D3D12_RESOURCE_STATES, clear: *const D3D12_CLEAR_VALUE, id: *const GUID, made: *mut *mut c_void
    );
    CreateHeap(wanted: *const D3D12_HEAP_DESC, id: *const GUID, made: *mut *mut c_void);
    CreatePlacedResource(
        heap: *mut c_void, at: u64, wanted: *const D3D12_RESOURCE_DESC, state: D3D12_RESOURCE_STATES,
        clear: *const D3D12_CLEAR_VALUE, id: *const GUID, made: *mut *mut c_void
    );
    CreateFence(first: u64, flags: D3D12_FENCE_FLAGS, id: *const GUID, made: *mut *mut c_void);
    CreateQueryHeap(wanted: *const D3D12_QUERY_HEAP_DESC, id: *const GUID, made: *mut *mut c_void);
}
