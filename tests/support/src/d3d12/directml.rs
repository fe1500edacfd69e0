//! DirectML devices beside those of the library, whose tables of functions are the same.

use std::ffi::c_void;

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::AI::MachineLearning::DirectML::{
    DML_CREATE_DEVICE_FLAG_NONE, DML_CREATE_DEVICE_FLAGS, DML_FEATURE_LEVEL, DML_FEATURE_LEVEL_5_0, IDMLDevice1,
};
use cairn::gpu::windows::core::{GUID, HRESULT, Interface};

use crate::worlds::ort;

/// A device by the library that worlds use.
///
/// # Panics
/// If it cannot be made.
pub fn device(gpu: &Gpu) -> IDMLDevice1 {
    type Create = unsafe extern "system" fn(
        *mut c_void,
        DML_CREATE_DEVICE_FLAGS,
        DML_FEATURE_LEVEL,
        *const GUID,
        *mut *mut c_void,
    ) -> HRESULT;
    // SAFETY: runs the initialisers of Microsoft's own library.
    let library = unsafe { libloading::Library::new(ort().path().with_file_name("DirectML.dll")) };
    // The device runs its code.
    let library = Box::leak(Box::new(library.expect("DirectML")));
    // SAFETY: DMLCreateDevice1 has this type in every release.
    let create = unsafe { library.get::<Create>(b"DMLCreateDevice1\0") }.expect("its function");
    let mut device = std::ptr::null_mut();
    let (flags, level) = (DML_CREATE_DEVICE_FLAG_NONE, DML_FEATURE_LEVEL_5_0);
    // SAFETY: a live Direct3D device, and a variable that lives during the call.
    let made = unsafe { create(gpu.device().as_raw(), flags, level, &IDMLDevice1::IID, &mut device) };
    assert!(made.is_ok(), "a DirectML device: {made:?}");
    // SAFETY: the call above returned a reference of this type, used once.
    unsafe { IDMLDevice1::from_raw(device) }
}
