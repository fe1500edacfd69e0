//! DirectML's device on a Direct3D device.

use windows::Win32::AI::MachineLearning::DirectML::{
    DML_FEATURE_DATA_TENSOR_DATA_TYPE_SUPPORT, DML_FEATURE_QUERY_TENSOR_DATA_TYPE_SUPPORT,
    DML_FEATURE_TENSOR_DATA_TYPE_SUPPORT, DML_TENSOR_DATA_TYPE_FLOAT16, IDMLDevice,
};
use windows::core::Interface;

use crate::gpu::Gpu;
use crate::{Error, ErrorKind};

/// DirectML's device, with the Direct3D device on which it was made.
#[derive(Clone)]
pub(super) struct DirectMlDevice {
    device: IDMLDevice,
    gpu: Gpu,
}

// SAFETY: IDMLDevice may be used from any thread by DirectML's contract; the bindings do not know it.
unsafe impl Send for DirectMlDevice {}
// SAFETY: as above.
unsafe impl Sync for DirectMlDevice {}

impl DirectMlDevice {
    pub(super) fn new(device: IDMLDevice, gpu: &Gpu) -> Self {
        Self { device, gpu: gpu.clone() }
    }

    /// The object for ONNX Runtime, which takes a reference of its own.
    pub(super) fn raw(&self) -> *mut std::ffi::c_void {
        self.device.as_raw()
    }

    /// Whether operators compute in float16 on the adapter, which is optional.
    pub(super) fn has_float16(&self) -> bool {
        let query = DML_FEATURE_QUERY_TENSOR_DATA_TYPE_SUPPORT { DataType: DML_TENSOR_DATA_TYPE_FLOAT16 };
        let mut support = DML_FEATURE_DATA_TENSOR_DATA_TYPE_SUPPORT::default();
        // SAFETY: a live device, and two structs of the feature's types with their sizes.
        let answered = unsafe {
            self.device.CheckFeatureSupport(
                DML_FEATURE_TENSOR_DATA_TYPE_SUPPORT,
                size_of_val(&query) as u32,
                Some((&raw const query).cast()),
                size_of_val(&support) as u32,
                (&raw mut support).cast(),
            )
        };
        answered.is_ok() && support.IsSupported.as_bool()
    }

    /// The removal reason if one of the two devices was removed. DirectML's own can be removed alone, for instance when memory is exhausted. Then
    /// all calls on it and on its objects have no effect.
    pub(super) fn removed(&self) -> Option<Error> {
        if let Some(gone) = self.gpu.removed() {
            return Some(gone);
        }
        // SAFETY: a live device; the call takes nothing.
        let reason = unsafe { self.device.GetDeviceRemovedReason() }.err()?.code();
        let cause = format!("DirectML's device was removed: {:#010x}", reason.0);
        Some(Error::new(ErrorKind::DeviceRemoved, cause).remedy("Release what was made on it and make a new device"))
    }

    /// The removal reason in the place of `error` if a device was removed and `error` does not say so.
    pub(super) fn or_removed(&self, error: Error) -> Error {
        error.or_removed(|| self.removed())
    }
}
