//! Loads DirectML: the library beside ONNX Runtime's, by its absolute path.

use std::ffi::c_void;
use std::path::PathBuf;

use windows::Win32::AI::MachineLearning::DirectML::{
    DML_CREATE_DEVICE_FLAG_NONE, DML_CREATE_DEVICE_FLAGS, DML_FEATURE_LEVEL, DML_FEATURE_LEVEL_5_0, IDMLDevice,
};
use windows::Win32::Foundation::HMODULE;
use windows::Win32::System::LibraryLoader::GetProcAddress;
use windows::core::{GUID, HRESULT, Interface, s};

use super::unsupported;
use crate::gpu::Gpu;
use crate::libraries::{self, load_refusal};
use crate::runtime::Ort;
use crate::{Error, ErrorKind, Result};

/// The library. It is never unloaded: its devices run its code.
pub(super) struct DirectMlLibrary {
    module: HMODULE,
    path: PathBuf,
}

/// Loads DirectML, beside another one that the engine may have loaded: a library that is named by its whole path is that file. ONNX Runtime
/// uses the device that is made of it, and loads no DirectML of its own then.
pub(super) fn load(ort: &Ort) -> Result<DirectMlLibrary> {
    let path = ort.path().with_file_name("DirectML.dll");
    let missing = |why: String, remedy: &str| {
        Error::new(ErrorKind::RuntimeMissing, why).field(path.display().to_string()).remedy(remedy)
    };
    if !path.is_file() {
        return Err(missing("DirectML's library is not there".to_owned(), REMEDY));
    }
    // SAFETY: a library beside the one that the caller named, and so trusts.
    let module = unsafe { libraries::load(&path) }.map_err(|e| {
        let (cause, remedy) = load_refusal(&path, e.code(), REMEDY);
        missing(format!("DirectML's library cannot be loaded: {cause}"), remedy)
    })?;
    Ok(DirectMlLibrary { module, path })
}

const REMEDY: &str = "Put the DirectML.dll of the package onnxruntime-directml beside onnxruntime.dll";

impl DirectMlLibrary {
    /// Makes a DirectML device on a Direct3D device.
    pub(super) fn device(&self, gpu: &Gpu) -> Result<IDMLDevice> {
        type Create = unsafe extern "system" fn(
            *mut c_void,
            DML_CREATE_DEVICE_FLAGS,
            DML_FEATURE_LEVEL,
            *const GUID,
            *mut *mut c_void,
        ) -> HRESULT;
        // SAFETY: a loaded module and a static name.
        let create = unsafe { GetProcAddress(self.module, s!("DMLCreateDevice1")) }.ok_or_else(|| {
            Error::new(ErrorKind::RuntimeMissing, "this DirectML is older than its interface 1")
                .field(self.path.display().to_string())
        })?;
        // SAFETY: DMLCreateDevice1 has this type in every release.
        let create: Create = unsafe { std::mem::transmute(create) };
        let mut device = std::ptr::null_mut();
        let direct3d = gpu.device().as_raw();
        // SAFETY: a live Direct3D device, and a pointer that is valid during the call.
        let result = unsafe {
            create(direct3d, DML_CREATE_DEVICE_FLAG_NONE, DML_FEATURE_LEVEL_5_0, &IDMLDevice::IID, &mut device)
        };
        if result.is_err() || device.is_null() {
            let why = format!("DMLCreateDevice1 failed with {:#010x} at feature level 5.0", result.0);
            return Err(gpu.removed().unwrap_or_else(|| unsupported(why)));
        }
        // SAFETY: the call above returned a reference of this type, used once.
        Ok(unsafe { IDMLDevice::from_raw(device) })
    }
}
