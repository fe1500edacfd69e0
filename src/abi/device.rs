//! Devices, on which worlds run.

use std::ffi::c_char;
use std::path::PathBuf;

use super::boundary::call;
use super::handles::{Handle, Kind, Object, destroy, enter, insert, insert_to};
use super::results::{AbiResult, CAIRN_OK, Failure, cairn_result};
use super::structs::{Out, check_flags, check_out, check_zero, describe, read_or_default};
use super::text::{check_text_buffer, copy_text, fixed_text, optional_text};
use crate::LibrarySearch;
use crate::bundle::Precision;
use crate::runtime::{CpuOptions, Device, DeviceKind, Ort, WebGpuOptions};

/// The host's processor, by ONNX Runtime's CPU provider.
pub const CAIRN_DEVICE_CPU: u32 = 1;
/// A Direct3D 12 adapter, by ONNX Runtime's DirectML provider.
pub const CAIRN_DEVICE_D3D12: u32 = 2;

/// A graphics adapter, by ONNX Runtime's WebGPU provider.
pub const CAIRN_DEVICE_WEBGPU: u32 = 3;

/// Float32.
pub const CAIRN_PRECISION_F32: u32 = 1;
/// Float16.
pub const CAIRN_PRECISION_F16: u32 = 2;

/// A flag of cairn_device_options: uses ONNX Runtime's deterministic kernels only. At a fixed thread count its CPU kernels repeat bit
/// for bit without the flag, too. On a Direct3D 12 device it means what CAIRN_D3D12_DETERMINISTIC means. The WebGPU provider has no such
/// kernels: on Intel adapters it may add in another order each time.
pub const CAIRN_DEVICE_DETERMINISTIC: u32 = 1;
/// A flag of cairn_device_options: environment variables and the user's cache directory may name libraries, which are loaded into
/// the process. For tools: in a game, anyone who sets its environment variables can run code in it.
pub const CAIRN_DEVICE_ENVIRONMENT: u32 = 2;

/// A device that runs worlds.
pub struct cairn_device(());

impl Handle for cairn_device {
    const KIND: Kind = Kind::Device;
    const NAME: &'static str = "cairn_device";
    type Object = Device;
}

impl Object for Device {}

/// Options of a device, and the paths of the libraries it needs. All zero: one thread for each physical core, and libraries beside
/// this one or beside the program.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_device_options {
    /// sizeof(cairn_device_options)
    pub struct_size: u32,
    /// Threads of a CPU device that share one pass, 1 to 1024, including the caller's; 0 for one for each physical core. The last bits
    /// of a rollout's numbers depend on it. Direct3D 12 devices ignore it.
    pub threads: u32,
    /// CAIRN_DEVICE_DETERMINISTIC and CAIRN_DEVICE_ENVIRONMENT, or 0.
    pub flags: u32,
    /// 0
    pub reserved: u32,
    /// Path of the library file of ONNX Runtime 1.24 or newer (tested: 1.24.4 and 1.32.0), UTF-8. A process uses one file only. A host
    /// with a Direct3D 12 device needs onnxruntime.dll of onnxruntime-directml 1.24.4, with DirectML.dll beside it, which also runs CPU
    /// devices. Null: searches beside this library, then beside the program. With CAIRN_DEVICE_ENVIRONMENT, searches the user's cache
    /// directory last; if the environment variable CAIRN_ONNXRUNTIME is set, uses the file it names instead of searching.
    pub onnxruntime: *const c_char,
    /// Folder of AMD's libraries for FSR, UTF-8, for presenters and swap chains on a Direct3D 12 device. Null: beside this library, else
    /// beside the program. With CAIRN_DEVICE_ENVIRONMENT, if the environment variable CAIRN_FFX_DIR is set, only the folder it names.
    pub ffx: *const c_char,
    /// Path of the library of ONNX Runtime's WebGPU provider, UTF-8, for cairn_device_create_gpu. Null: beside ONNX Runtime's library. With
    /// CAIRN_DEVICE_ENVIRONMENT, if the environment variable CAIRN_WEBGPU is set, the file it names.
    pub webgpu: *const c_char,
}
describe!(cairn_device_options, [32], { struct_size, threads, flags, reserved, onnxruntime, ffx, webgpu });

/// Properties of a device.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_device_info {
    /// sizeof(cairn_device_info)
    pub struct_size: u32,
    /// CAIRN_DEVICE_CPU, CAIRN_DEVICE_D3D12 or CAIRN_DEVICE_WEBGPU
    pub kind: u32,
    /// Default precision of worlds: CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16
    pub precision: u32,
    /// Threads that share one pass.
    pub threads: u32,
    /// Description for people, such as "ONNX Runtime 1.24.4 CPU, 8 threads"; UTF-8.
    pub description: [c_char; 128],
    /// MiB of its adapter's memory that the system grants to the process at present; may change at any time; 0 if unknown.
    pub memory_budget_mib: u32,
    /// MiB of its adapter's memory that the whole process uses, the host included.
    pub memory_used_mib: u32,
}
describe!(cairn_device_info, [144], {
    struct_size, kind, precision, threads, description, memory_budget_mib, memory_used_mib,
});

/// Creates a device on the host's processor and loads ONNX Runtime. Works on every system.
///
/// options: may be null for the defaults.
///
/// Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point
/// to is read during the call only. ONNX Runtime can be started only once: it stays loaded until the process ends, and so does this
/// library, which it calls.
/// Threads: any thread, at any time. Takes a fraction of a second the first time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_RUNTIME_MISSING when ONNX Runtime is
/// missing, is too old, or computes a small graph wrongly; CAIRN_ERROR_UNSUPPORTED when the process already uses another file of it;
/// CAIRN_ERROR_DEVICE when it does not start.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_create_cpu(
    options: *const cairn_device_options,
    device: *mut *mut cairn_device,
) -> cairn_result {
    call("cairn_device_create_cpu", || {
        check_out(device, "device")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { DeviceOptions::read(options) }?;
        let made = options.on_cpu()?.0;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_device>(made, device) }
    })
}

/// Creates a device on a graphics adapter, by ONNX Runtime's WebGPU provider: by Vulkan on Linux, and on Windows by Direct3D 12, or by Vulkan if
/// a copy of the system's vulkan-1.dll lies beside the provider's library. Experimental: this function may change without a new
/// CAIRN_ABI_VERSION. The provider's library is of the PyPI package onnxruntime-ep-webgpu 0.4.0: libonnxruntime_providers_webgpu.so, on Windows
/// onnxruntime_providers_webgpu.dll. Worlds are float16 where the adapter has it.
///
/// adapter: a part of the adapter's name in any case, its vendor such as "0x1002", or its number among those that Vulkan lists, UTF-8. An adapter
/// that the processor emulates is used only if it is named so. Null for the fastest; it must be null where the provider uses Direct3D 12. All
/// such devices of a process use one adapter, and their work takes turns.
/// options: may be null for the defaults. threads and ffx are not used.
///
/// Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What adapter and options point to is
/// read during the call only. ONNX Runtime, the provider and this library stay loaded until the process ends.
/// Threads: any thread, at any time. Takes a fraction of a second the first time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, also when no adapter is named so; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_RUNTIME_MISSING when
/// ONNX Runtime or the provider's library is missing or has another version; CAIRN_ERROR_UNSUPPORTED when there is no such adapter, or the
/// process already uses another one; CAIRN_ERROR_DEVICE when the adapter does not work; CAIRN_ERROR_DEVICE_REMOVED when the process's device is
/// lost and something that was made on it is left: destroy its rollouts, worlds and devices first.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_create_gpu(
    adapter: *const c_char,
    options: *const cairn_device_options,
    device: *mut *mut cairn_device,
) -> cairn_result {
    call("cairn_device_create_gpu", || {
        check_out(device, "device")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { DeviceOptions::read(options) }?;
        // SAFETY: the host's promise about `adapter`.
        let adapter = unsafe { optional_text(adapter, "adapter") }?.map(str::to_owned);
        let made = options.on_gpu(adapter)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_device>(made, device) }
    })
}

/// Creates the best device of this machine: on Windows by DirectML on the first Direct3D 12 adapter, elsewhere and where that is not possible
/// as cairn_device_create_gpu with no name, else on the processor as cairn_device_create_cpu. Adapters that the processor emulates are not taken.
/// A host that has a Direct3D 12 device uses cairn_device_create_d3d12 with that. cairn_device_get_info names the kind that was taken.
/// Experimental: this function may change without a new CAIRN_ABI_VERSION.
///
/// options: may be null for the defaults. threads are for a CPU device.
/// refusals: gets a line for each better kind that was not taken, with the reason, for people; UTF-8, cut to whole characters. At least capacity
/// bytes, or null with capacity 0. Always ends in a NUL when capacity > 0. The same is in the log.
/// length: gets the length without the NUL; may be null.
///
/// Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point to is read during
/// the call only. ONNX Runtime and this library stay loaded until the process ends.
/// Threads: any thread, at any time. Takes up to seconds the first time.
/// Results: CAIRN_OK; CAIRN_TRUNCATED when the device is there and refusals do not fit; else as cairn_device_create_cpu.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_create_auto(
    options: *const cairn_device_options,
    refusals: *mut c_char,
    capacity: usize,
    length: *mut usize,
    device: *mut *mut cairn_device,
) -> cairn_result {
    call("cairn_device_create_auto", || {
        check_out(device, "device")?;
        check_text_buffer(refusals, "refusals", capacity, length)?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { DeviceOptions::read(options) }?;
        let ort = Ort::find(&options.libraries)?;
        let (made, refused) = Device::auto(&ort, options.cpu, &options.libraries)?;
        let lines: Vec<_> = refused.iter().map(|(kind, why)| format!("not {kind}: {why}")).collect();
        for line in &lines {
            log::warn!("{line}");
        }
        let handle = insert::<cairn_device>(made)?;
        // SAFETY: the host's promise about the buffer and the length, which were checked above.
        let result = unsafe { copy_text(&lines.join("\n"), refusals, capacity, length) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { device.write(handle) };
        Ok(result)
    })
}

/// Gives the properties of a device.
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
            kind: match device.kind() {
                DeviceKind::Cpu => CAIRN_DEVICE_CPU,
                DeviceKind::Direct3d12 => CAIRN_DEVICE_D3D12,
                DeviceKind::WebGpu => CAIRN_DEVICE_WEBGPU,
            },
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
/// Ownership: on success device is no longer a handle; on failure it is unchanged.
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

/// The header's options, checked and copied.
#[derive(Debug, Clone)]
pub(super) struct DeviceOptions {
    /// Options of a CPU device. Direct3D 12 devices use only the choice of deterministic kernels.
    pub(super) cpu: CpuOptions,
    pub(super) libraries: LibrarySearch,
}

impl DeviceOptions {
    /// Reads a host's options; a null pointer means the defaults.
    ///
    /// # Safety
    /// `options` is null or points to as many readable bytes as its first four say, and its texts are null or readable up to their NULs.
    pub(super) unsafe fn read(options: *const cairn_device_options) -> AbiResult<Self> {
        // SAFETY: the caller's promise.
        let options = unsafe { read_or_default(options, "options") }?;
        let known = CAIRN_DEVICE_DETERMINISTIC | CAIRN_DEVICE_ENVIRONMENT;
        check_flags(options.flags, known, "options.flags")?;
        check_zero(options.reserved, "options.reserved")?;
        // SAFETY: the caller's promise about what options point to.
        let onnxruntime = unsafe { optional_text(options.onnxruntime, "options.onnxruntime") }?;
        // SAFETY: as above.
        let ffx = unsafe { optional_text(options.ffx, "options.ffx") }?;
        // SAFETY: as above.
        let webgpu = unsafe { optional_text(options.webgpu, "options.webgpu") }?;
        let cpu = CpuOptions {
            threads: Some(options.threads as usize).filter(|threads| *threads > 0),
            deterministic: options.flags & CAIRN_DEVICE_DETERMINISTIC != 0,
        };
        cpu.check()?;
        Ok(Self {
            cpu,
            libraries: LibrarySearch {
                onnxruntime: onnxruntime.map(PathBuf::from),
                ffx: ffx.map(PathBuf::from),
                webgpu: webgpu.map(PathBuf::from),
                environment: options.flags & CAIRN_DEVICE_ENVIRONMENT != 0,
            },
        })
    }

    /// A graphics adapter, by the WebGPU provider.
    fn on_gpu(self, adapter: Option<String>) -> crate::Result<Device> {
        let ort = Ort::find(&self.libraries)?;
        let options = WebGpuOptions { deterministic: self.cpu.deterministic, adapter, libraries: self.libraries };
        Device::webgpu(&ort, &options)
    }

    /// A CPU device, and the ONNX Runtime it uses.
    pub(super) fn on_cpu(self) -> crate::Result<(Device, Ort)> {
        let ort = Ort::find(&self.libraries)?;
        let device = Device::cpu(&ort, self.cpu)?;
        Ok((device.with_library_search(self.libraries), ort))
    }
}

/// A precision as the header numbers it.
pub(super) fn precision_number(precision: Precision) -> u32 {
    match precision {
        Precision::F32 => CAIRN_PRECISION_F32,
        Precision::F16 => CAIRN_PRECISION_F16,
    }
}

/// The precision of the header's number; `None` for 0, which leaves the choice to the device.
pub(super) fn precision(number: u32, name: &str) -> AbiResult<Option<Precision>> {
    match number {
        0 => Ok(None),
        CAIRN_PRECISION_F32 => Ok(Some(Precision::F32)),
        CAIRN_PRECISION_F16 => Ok(Some(Precision::F16)),
        other => Err(Failure::argument(name, format!("{other} is no precision of this library"))),
    }
}
