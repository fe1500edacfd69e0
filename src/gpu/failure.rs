//! Conversion of Direct3D failures to this library's errors: the only place where an HRESULT becomes an error.

use windows::Win32::Foundation::E_OUTOFMEMORY;
use windows::Win32::Graphics::Direct3D12::ID3D12Device;
use windows::Win32::Graphics::Dxgi::{
    DXGI_ERROR_ACCESS_DENIED, DXGI_ERROR_DEVICE_HUNG, DXGI_ERROR_DEVICE_REMOVED, DXGI_ERROR_DEVICE_RESET,
    DXGI_ERROR_DRIVER_INTERNAL_ERROR, DXGI_ERROR_INVALID_CALL,
};
use windows::core::{Error as ComError, HRESULT};

use crate::{Error, ErrorKind};

/// The error of a call that failed before there was a device.
pub(super) fn failed(call: &str, error: &ComError) -> Error {
    let code = error.code();
    let kind = match code {
        E_OUTOFMEMORY => ErrorKind::OutOfMemory,
        DXGI_ERROR_DEVICE_REMOVED | DXGI_ERROR_DEVICE_HUNG | DXGI_ERROR_DEVICE_RESET => ErrorKind::DeviceRemoved,
        _ => ErrorKind::Device,
    };
    Error::new(kind, format!("{call} failed with {:#010x}{}", code.0, known(code)))
}

/// The error of a failed call on `device`: the removal reason if the device was removed, else the call's own failure.
pub(crate) fn failed_on(device: &ID3D12Device, call: &str, error: &ComError) -> Error {
    removed(device).unwrap_or_else(|| failed(call, error))
}

/// The removal reason of a device, if it was removed.
pub(super) fn removed(device: &ID3D12Device) -> Option<Error> {
    // SAFETY: a live device; the call takes nothing.
    let reason = unsafe { device.GetDeviceRemovedReason() }.err()?.code();
    let cause = format!("the Direct3D 12 device was removed: {:#010x}{}", reason.0, known(reason));
    Some(Error::new(ErrorKind::DeviceRemoved, cause).remedy("Release what was made on it and make a new device"))
}

/// The text of a common code, after a space; empty for other codes.
fn known(code: HRESULT) -> &'static str {
    match code {
        DXGI_ERROR_DEVICE_REMOVED => {
            " (DXGI_ERROR_DEVICE_REMOVED: the adapter was taken out, or its driver was replaced)"
        }
        DXGI_ERROR_DEVICE_HUNG => " (DXGI_ERROR_DEVICE_HUNG: a command took too long or was invalid)",
        DXGI_ERROR_DEVICE_RESET => " (DXGI_ERROR_DEVICE_RESET: another program's command hung the adapter)",
        DXGI_ERROR_DRIVER_INTERNAL_ERROR => " (DXGI_ERROR_DRIVER_INTERNAL_ERROR: a fault of the driver)",
        DXGI_ERROR_INVALID_CALL => " (DXGI_ERROR_INVALID_CALL: the device was used against its rules)",
        DXGI_ERROR_ACCESS_DENIED => " (DXGI_ERROR_ACCESS_DENIED)",
        E_OUTOFMEMORY => " (E_OUTOFMEMORY)",
        _ => "",
    }
}
