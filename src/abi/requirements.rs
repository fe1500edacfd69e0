//! Lists adapters, and the requirements of a device.

use std::ffi::c_char;

use super::boundary::call;
use super::d3d12::backend;
use super::device::{CAIRN_DEVICE_CPU, CAIRN_DEVICE_D3D12, CAIRN_DEVICE_WEBGPU, DeviceOptions, cairn_device_options};
use super::results::{CAIRN_OK, Failure, cairn_result};
use super::structs::{describe, write_array};
use super::text::fixed_text;
use crate::bundle::available_memory;
use crate::runtime::{Ort, WebGpuRequirements, webgpu_adapters};

/// The operating system and the build of this library.
pub const CAIRN_REQUIREMENT_PLATFORM: u32 = 1;
/// ONNX Runtime's library.
pub const CAIRN_REQUIREMENT_ONNXRUNTIME: u32 = 2;
/// Memory of the system.
pub const CAIRN_REQUIREMENT_MEMORY: u32 = 3;

/// AMD's libraries for FSR: one entry for each file that was found.
pub const CAIRN_REQUIREMENT_FSR_LIBRARIES: u32 = 4;
/// A provider of FSR frame generation for the first adapter.
pub const CAIRN_REQUIREMENT_FSR_PROVIDER: u32 = 5;
/// The system's build number, for FSR.
pub const CAIRN_REQUIREMENT_FSR_SYSTEM: u32 = 6;
/// Direct3D 12's library, for FSR: the system's, or that of the Agility SDK that a program brings.
pub const CAIRN_REQUIREMENT_FSR_DIRECT3D: u32 = 7;
/// The shader model of the first adapter, for FSR.
pub const CAIRN_REQUIREMENT_FSR_SHADER_MODEL: u32 = 8;
/// The library's own shaders on the first adapter, for frames between anchors.
pub const CAIRN_REQUIREMENT_SHADERS: u32 = 9;
/// The library of ONNX Runtime's WebGPU provider.
pub const CAIRN_REQUIREMENT_WEBGPU: u32 = 10;
/// A graphics adapter for the WebGPU provider.
pub const CAIRN_REQUIREMENT_ADAPTER: u32 = 11;

/// The requirement is met.
pub const CAIRN_REQUIREMENT_MET: u32 = 1;
/// The requirement is not met, and the device cannot be created.
pub const CAIRN_REQUIREMENT_NOT_MET: u32 = 2;
/// Whether the requirement is met depends on the world, or the system does not report it.
pub const CAIRN_REQUIREMENT_UNKNOWN: u32 = 3;
/// The requirement is not met, and a device can be created without it; cairn_requirement.needed says what needs it.
pub const CAIRN_REQUIREMENT_OPTIONAL: u32 = 4;

/// A processor or an adapter on which a device can be created.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_adapter {
    /// The stride of the array.
    pub struct_size: u32,
    /// CAIRN_DEVICE_CPU, CAIRN_DEVICE_D3D12 or CAIRN_DEVICE_WEBGPU
    pub kind: u32,
    /// Its index among those of its kind, from 0. As text it names a WebGPU adapter for cairn_device_create_gpu.
    pub index: u32,
    /// 0
    pub reserved: u32,
    /// The LUID of a Direct3D 12 adapter, low part first; else 0.
    pub luid: u64,
    /// Bytes of the adapter's own memory, or for the processor of the system's memory; 0 if unknown.
    pub memory: u64,
    /// Name, for people; UTF-8.
    pub name: [c_char; 128],
}
describe!(cairn_adapter, [], { struct_size, kind, index, reserved, luid, memory, name });

/// One requirement of a device.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_requirement {
    /// The stride of the array.
    pub struct_size: u32,
    /// CAIRN_REQUIREMENT_PLATFORM to CAIRN_REQUIREMENT_ADAPTER; a newer library may have more.
    pub what: u32,
    /// CAIRN_REQUIREMENT_MET, CAIRN_REQUIREMENT_NOT_MET, CAIRN_REQUIREMENT_UNKNOWN or CAIRN_REQUIREMENT_OPTIONAL
    pub status: u32,
    /// 0
    pub reserved: u32,
    /// What is needed, for people; UTF-8.
    pub needed: [c_char; 96],
    /// What was found; UTF-8.
    pub found: [c_char; 512],
}
describe!(cairn_requirement, [], { struct_size, what, status, reserved, needed, found });

/// Lists what devices can be created on: always the processor, on Windows the Direct3D 12 adapters if this build can use them, and on Linux
/// the adapters that Vulkan lists, which need the library of the WebGPU provider as well (cairn_device_requirements).
///
/// adapters: an array of capacity elements, stride bytes apart, usually sizeof(cairn_adapter); null with capacity 0 to learn
/// the count.
/// count: gets the total number, which may be more than capacity.
///
/// Ownership: the array stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE for a stride that is no size of cairn_adapter.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_adapters(
    adapters: *mut cairn_adapter,
    stride: usize,
    capacity: u32,
    count: *mut u32,
) -> cairn_result {
    call("cairn_adapters", || {
        let processor = cairn_adapter {
            struct_size: 0,
            kind: CAIRN_DEVICE_CPU,
            index: 0,
            reserved: 0,
            luid: 0,
            memory: total_memory().unwrap_or(0),
            name: fixed_text(&processor_name()),
        };
        let by_webgpu = (0..).zip(webgpu_adapters()).map(|(index, adapter)| cairn_adapter {
            struct_size: 0,
            kind: CAIRN_DEVICE_WEBGPU,
            index,
            reserved: 0,
            luid: 0,
            memory: adapter.memory,
            name: fixed_text(&adapter.name),
        });
        let rows: Vec<_> = std::iter::once(processor).chain(backend::adapters()).chain(by_webgpu).collect();
        // SAFETY: the host's promise about the array and the count.
        unsafe { write_array(&rows, adapters, "adapters", stride, capacity, count) }?;
        Ok(CAIRN_OK)
    })
}

/// Lists what a device of that kind needs and what was found, so that a player can be shown why a feature is unavailable.
///
/// kind: CAIRN_DEVICE_CPU, CAIRN_DEVICE_D3D12 or CAIRN_DEVICE_WEBGPU.
/// options: the options that the device would be created with; may be null.
/// requirements: an array of capacity elements, stride bytes apart, usually sizeof(cairn_requirement); null with capacity 0 to
/// learn the count.
/// count: gets the total number, which may be more than capacity.
///
/// Ownership: the array stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time. Searches for ONNX Runtime where options say and loads it as cairn_device_create_cpu does; for
/// CAIRN_DEVICE_D3D12 also AMD's libraries, which stay loaded. Of these, only files that AMD has signed are loaded. For CAIRN_DEVICE_WEBGPU
/// also the provider's library, which stays loaded.
/// Results: CAIRN_OK, also when something is missing; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_device_requirements(
    kind: u32,
    options: *const cairn_device_options,
    requirements: *mut cairn_requirement,
    stride: usize,
    capacity: u32,
    count: *mut u32,
) -> cairn_result {
    call("cairn_device_requirements", || {
        // SAFETY: the host's promise about `options`.
        let options = unsafe { DeviceOptions::read(options) }?;
        let rows = match kind {
            CAIRN_DEVICE_CPU => vec![
                row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_MET, "any system this library runs on", &platform()),
                onnxruntime(options.on_cpu().map(|(_, ort)| ort)),
                memory(),
            ],
            CAIRN_DEVICE_D3D12 => backend::requirements(options),
            CAIRN_DEVICE_WEBGPU => of_webgpu(options),
            other => return Err(Failure::argument("kind", format!("{other} is no kind of device"))),
        };
        // SAFETY: the host's promise about the array and the count.
        unsafe { write_array(&rows, requirements, "requirements", stride, capacity, count) }?;
        Ok(CAIRN_OK)
    })
}

/// Requirements of a device on an adapter through the WebGPU provider.
fn of_webgpu(options: DeviceOptions) -> Vec<cairn_requirement> {
    let status = |met| if met { CAIRN_REQUIREMENT_MET } else { CAIRN_REQUIREMENT_NOT_MET };
    let is_known = cfg!(any(target_os = "linux", windows));
    let mut rows = vec![row(CAIRN_REQUIREMENT_PLATFORM, status(is_known), "Linux or Windows", &platform())];
    let ort = Ort::find(&options.libraries);
    if let Ok(ort) = &ort {
        let WebGpuRequirements { library, adapter } = WebGpuRequirements::find(ort, &options.libraries);
        let is_there = library.is_ok();
        let found = library.map_or_else(|error| error.to_string(), |path| path.display().to_string());
        let needed = "the library of the PyPI package onnxruntime-ep-webgpu 0.4.0";
        rows.push(row(CAIRN_REQUIREMENT_WEBGPU, status(is_there), needed, &found));
        let is_there = adapter.is_ok();
        let found = adapter.unwrap_or_else(|error| error.to_string());
        let needed = "a graphics adapter with a Vulkan driver that the processor does not emulate";
        rows.push(row(CAIRN_REQUIREMENT_ADAPTER, status(is_there), needed, &found));
    }
    rows.insert(1, onnxruntime(ort));
    rows.push(memory());
    rows
}

/// The requirement of ONNX Runtime: its version and path, or why it could not be loaded.
pub(super) fn onnxruntime(loaded: crate::Result<Ort>) -> cairn_requirement {
    let (status, found) = match loaded {
        Ok(ort) => (CAIRN_REQUIREMENT_MET, format!("{} at {}", ort.version(), ort.path().display())),
        Err(error) => (CAIRN_REQUIREMENT_NOT_MET, error.to_string()),
    };
    row(CAIRN_REQUIREMENT_ONNXRUNTIME, status, "ONNX Runtime 1.24 or newer (tested: 1.24.4 and 1.32.0)", &found)
}

/// The requirement of system memory.
pub(super) fn memory() -> cairn_requirement {
    let found = available_memory().map_or("unknown".into(), |bytes| format!("{} MiB available", bytes >> 20));
    let needed = "what cairn_world_get_memory says of the world";
    row(CAIRN_REQUIREMENT_MEMORY, CAIRN_REQUIREMENT_UNKNOWN, needed, &found)
}

pub(super) fn row(what: u32, status: u32, needed: &str, found: &str) -> cairn_requirement {
    let (needed, found) = (fixed_text(needed), fixed_text(found));
    cairn_requirement { struct_size: 0, what, status, reserved: 0, needed, found }
}

pub(super) fn platform() -> String {
    format!("{} on {}", std::env::consts::OS, std::env::consts::ARCH)
}

fn total_memory() -> Option<u64> {
    let mut system = sysinfo::System::new().ok()?;
    system.refresh_memory_specifics(sysinfo::MemoryRefreshKind::nothing().with_ram());
    Some(system.total_memory()).filter(|bytes| *bytes > 0)
}

fn processor_name() -> String {
    let found = sysinfo::System::new().ok().and_then(|mut system| {
        system.refresh_cpu_list(sysinfo::CpuRefreshKind::nothing());
        system.cpus().first().map(|cpu| cpu.brand().trim().to_owned())
    });
    found.filter(|name| !name.is_empty()).unwrap_or_else(|| format!("{} processor", std::env::consts::ARCH))
}
