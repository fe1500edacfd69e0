//! Devices: where worlds run.

use std::ffi::c_char;
use std::path::Path;

use super::boundary::call;
use super::handles::{Handle, Kind, Object, destroy, enter, insert};
use super::results::{CAIRN_OK, Failure, Outcome, cairn_result};
use super::structs::{Out, check_out, describe, read_or_default};
use super::text::{fixed_text, optional_text};
use crate::bundle::Precision;
use crate::runtime::{CpuOptions, Device, Ort};

/// The host's processor, by ONNX Runtime's CPU provider.
pub const CAIRN_DEVICE_CPU: u32 = 1;
/// A Direct3D 12 adapter, by ONNX Runtime's DirectML provider.
pub const CAIRN_DEVICE_D3D12: u32 = 2;

/// Float32.
pub const CAIRN_PRECISION_F32: u32 = 1;
/// Float16.
pub const CAIRN_PRECISION_F16: u32 = 2;

/// A flag of cairn_cpu_options: ONNX Runtime's deterministic kernels only. Its CPU kernels repeat bit for bit at a fixed
/// thread count without it, too.
pub const CAIRN_CPU_DETERMINISTIC: u32 = 1;

/// A device that runs worlds.
pub struct cairn_device(());

impl Handle for cairn_device {
    const KIND: Kind = Kind::Device;
    const NAME: &'static str = "cairn_device";
    type Object = Device;
}

impl Object for Device {}

/// How the processor is used. All zero: one thread for each physical core.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_cpu_options {
    /// sizeof(cairn_cpu_options)
    pub struct_size: u32,
    /// Threads that share one pass, 1 to 1024, the caller's own among them; 0 for one for each physical core. The numbers of
    /// a rollout depend on it in their last bits.
    pub threads: u32,
    /// CAIRN_CPU_DETERMINISTIC, or 0.
    pub flags: u32,
    /// 0
    pub reserved: u32,
    /// The file of ONNX Runtime 1.24.x, UTF-8. Null: the one the environment variable CAIRN_ONNXRUNTIME names, else the first
    /// beside this library, beside the program, or in the user's cache directory. A process uses one file only.
    pub onnxruntime: *const c_char,
}
describe!(cairn_cpu_options, [], { struct_size, threads, flags, reserved, onnxruntime });

/// What a device is.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_device_info {
    /// sizeof(cairn_device_info)
    pub struct_size: u32,
    /// CAIRN_DEVICE_CPU or CAIRN_DEVICE_D3D12
    pub kind: u32,
    /// What it computes in unless told otherwise: CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16
    pub precision: u32,
    /// Threads that share one pass.
    pub threads: u32,
    /// For people, such as "ONNX Runtime 1.24.4 CPU, 8 threads"; UTF-8.
    pub description: [c_char; 128],
    /// MiB of its adapter's memory that the system grants to the process now, which may change at any time; 0 where none says so.
    pub memory_budget_mib: u32,
    /// MiB of it that the process uses, whoever in it does.
    pub memory_used_mib: u32,
}
describe!(cairn_device_info, [144], {
    struct_size, kind, precision, threads, description, memory_budget_mib, memory_used_mib,
});

/// Makes a device of the host's processor and loads ONNX Runtime. Works on every system.
///
/// options: may be null for the defaults.
///
/// Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point
/// to is read during the call only. ONNX Runtime can be started once: it stays loaded until the process ends, and so does this
/// library, which it calls.
/// Threads: any thread, at any time. Takes a fraction of a second the first time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_RUNTIME_MISSING when ONNX Runtime is
/// not there or has another version; CAIRN_ERROR_UNSUPPORTED when the process uses another file of it already;
/// CAIRN_ERROR_DEVICE when it does not start.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_create_cpu(
    options: *const cairn_cpu_options,
    device: *mut *mut cairn_device,
) -> cairn_result {
    call("cairn_device_create_cpu", || {
        check_out(device, "device")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { read_or_default(options, "options") }?;
        // SAFETY: the host's promise about what options point to.
        let path = unsafe { optional_text(options.onnxruntime, "options.onnxruntime") }?;
        let cpu = cpu_options(&options)?;
        let ort = Ort::find(path.map(Path::new))?;
        let handle = insert::<cairn_device>(Device::cpu(&ort, cpu)?)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { device.write(handle) };
        Ok(CAIRN_OK)
    })
}

/// Says what a device is.
///
/// Ownership: info stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_get_info(
    device: *const cairn_device,
    info: *mut cairn_device_info,
) -> cairn_result {
    call("cairn_device_get_info", || {
        let device = enter(device)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::new(info, "info") }?;
        let memory = device.memory().unwrap_or_default();
        info.write(&cairn_device_info {
            struct_size: 0,
            kind: if device.is_gpu() { CAIRN_DEVICE_D3D12 } else { CAIRN_DEVICE_CPU },
            precision: precision_number(device.precision()),
            threads: u32::try_from(device.threads()).unwrap_or(u32::MAX),
            description: fixed_text(&device.describe()),
            memory_budget_mib: mib(memory.granted),
            memory_used_mib: mib(memory.used.saturating_add(MIB - 1)),
        });
        Ok(CAIRN_OK)
    })
}

/// Destroys the handle of a device; null is allowed. Worlds that run on the device keep it alive.
///
/// Ownership: on success device is no handle any more; on failure it is as it was.
/// Threads: any thread; waits for calls in flight on the device. Not from within their callbacks.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_destroy(device: *mut cairn_device) -> cairn_result {
    call("cairn_device_destroy", || destroy(device))
}

const MIB: u64 = 1 << 20;

fn mib(bytes: u64) -> u32 {
    u32::try_from(bytes / MIB).unwrap_or(u32::MAX)
}

/// Checks what the header's options say.
pub(super) fn cpu_options(options: &cairn_cpu_options) -> Outcome<CpuOptions> {
    if options.flags & !CAIRN_CPU_DETERMINISTIC != 0 {
        return Err(Failure::argument("options.flags", format!("{:#x} has an unknown bit", options.flags)));
    }
    if options.reserved != 0 {
        return Err(Failure::argument("options.reserved", "it must be 0"));
    }
    Ok(CpuOptions {
        threads: Some(options.threads as usize).filter(|threads| *threads > 0),
        deterministic: options.flags & CAIRN_CPU_DETERMINISTIC != 0,
    })
}

/// A precision as the header numbers it.
pub(super) fn precision_number(precision: Precision) -> u32 {
    match precision {
        Precision::F32 => CAIRN_PRECISION_F32,
        Precision::F16 => CAIRN_PRECISION_F16,
    }
}

/// What the header's number means; 0 leaves the choice to the device.
pub(super) fn precision(number: u32, name: &str) -> Outcome<Option<Precision>> {
    match number {
        0 => Ok(None),
        CAIRN_PRECISION_F32 => Ok(Some(Precision::F32)),
        CAIRN_PRECISION_F16 => Ok(Some(Precision::F16)),
        other => Err(Failure::argument(name, format!("{other} is no precision of this library"))),
    }
}
