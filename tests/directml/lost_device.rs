//! DirectML devices of this process that seem to be lost.

use std::ffi::c_void;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicI32, Ordering};

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::AI::MachineLearning::DirectML::{
    DML_CREATE_DEVICE_FLAG_NONE, DML_CREATE_DEVICE_FLAGS, DML_FEATURE_LEVEL, DML_FEATURE_LEVEL_5_0, IDMLDevice,
};
use cairn::gpu::windows::core::{GUID, HRESULT, Interface};
use test_support::d3d12::function_tables::replace_function;
use test_support::worlds::ort;

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
    type Create = unsafe extern "system" fn(
        *mut c_void,
        DML_CREATE_DEVICE_FLAGS,
        DML_FEATURE_LEVEL,
        *const GUID,
        *mut *mut c_void,
    ) -> HRESULT;
    // SAFETY: Microsoft's own library, which is loaded.
    let library =
        unsafe { libloading::Library::new(ort().path().with_file_name("DirectML.dll")) }.expect("it is there");
    // SAFETY: DMLCreateDevice1 has this type in every release.
    let create = unsafe { library.get::<Create>(b"DMLCreateDevice1\0") }.expect("it is there");
    let mut device = std::ptr::null_mut();
    let (flags, level) = (DML_CREATE_DEVICE_FLAG_NONE, DML_FEATURE_LEVEL_5_0);
    // SAFETY: a live Direct3D device, and a variable that lives during the call.
    let made = unsafe { create(gpu.device().as_raw(), flags, level, &IDMLDevice::IID, &mut device) };
    assert!(made.is_ok(), "a DirectML device: {made:?}");
    // SAFETY: the call above returned a reference of this type, used once.
    let device = unsafe { IDMLDevice::from_raw(device) };
    replace_function(
        &raw const Interface::vtable(&device).GetDeviceRemovedReason,
        &ORIGINAL,
        removed_reason as GetReason,
    );
}
