//! DirectML devices of this process that seem to be lost.

use std::ffi::c_void;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicI32, Ordering};

use cairn::gpu::Gpu;
use cairn::gpu::windows::core::{HRESULT, Interface};
use test_support::d3d12::directml;
use test_support::d3d12::function_tables::replace_function;

type GetReason = unsafe extern "system" fn(*mut c_void) -> HRESULT;

/// What all devices answer, if it is an error.
static REASON: AtomicI32 = AtomicI32::new(0);
static ORIGINAL: OnceLock<GetReason> = OnceLock::new();

unsafe extern "system" fn removed_reason(this: *mut c_void) -> HRESULT {
    match HRESULT(REASON.load(Ordering::SeqCst)) {
        // SAFETY: the caller's own argument, passed on.
        none if none.is_ok() => unsafe { ORIGINAL.get().expect("the original function")(this) },
        reason => reason,
    }
}

/// Devices are lost for this reason from now on, or not at all.
pub(crate) fn lose(reason: HRESULT) {
    REASON.store(reason.0, Ordering::SeqCst);
}

/// Replaces the function that all devices share, by way of another device.
pub(crate) fn install(gpu: &Gpu) {
    let device = directml::device(gpu);
    let table = Interface::vtable(&device);
    replace_function(&raw const table.base__.GetDeviceRemovedReason, &ORIGINAL, removed_reason as GetReason);
}
