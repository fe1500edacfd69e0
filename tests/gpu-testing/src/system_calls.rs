//! The system calls of a Cairn device, without Cairn: memory that they leak is the system's.

use std::ffi::c_void;

use cairn::gpu::windows::Win32::AI::MachineLearning::DirectML::{
    DML_CREATE_DEVICE_FLAG_NONE, DML_CREATE_DEVICE_FLAGS, DML_FEATURE_LEVEL, DML_FEATURE_LEVEL_5_0, IDMLDevice,
};
use cairn::gpu::windows::Win32::Foundation::CloseHandle;
use cairn::gpu::windows::Win32::Graphics::Direct3D::ID3DBlob;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::{
    CreateDXGIFactory2, DXGI_CREATE_FACTORY_FLAGS, IDXGIDevice, IDXGIFactory4,
};
use cairn::gpu::windows::Win32::System::LibraryLoader::{GetModuleHandleW, GetProcAddress};
use cairn::gpu::windows::Win32::System::Threading::{CreateEventW, INFINITE, WaitForSingleObject};
use cairn::gpu::windows::core::{GUID, HRESULT, Interface, s, w};

use crate::engine::Engine;

/// Shaders of a device, with the numbers of their root constants, of their input buffers and of their output buffers.
const SHADERS: [(&[u8], u32, u32, u32); 2] = [
    (include_bytes!("../../../src/gpu/shaders/compiled/finite.dxbc"), 4, 1, 1),
    (include_bytes!("../../../src/gpu/shaders/compiled/equal.dxbc"), 2, 2, 1),
];

/// A part of a Cairn device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part {
    /// The adapter's name.
    Adapter,
    /// DirectML's device.
    DirectMl,
    /// Shaders.
    Shaders,
    /// A fence for each queue, and a wait for one.
    Fences,
}

/// All parts.
pub const ALL: [Part; 4] = [Part::Adapter, Part::DirectMl, Part::Shaders, Part::Fences];

impl Part {
    /// Creates this part on an engine's device, and releases it.
    pub fn create_and_release(self, engine: &Engine) {
        match self {
            Self::Adapter => adapter(),
            Self::DirectMl => drop(directml(engine)),
            Self::Shaders => SHADERS.iter().for_each(|shader| drop(pipeline(engine, shader))),
            Self::Fences => fences(engine),
        }
    }
}

fn adapter() {
    // SAFETY: the call takes flags only.
    let factory: IDXGIFactory4 = unsafe { CreateDXGIFactory2(DXGI_CREATE_FACTORY_FLAGS(0)) }.expect("DXGI");
    // SAFETY: a live factory.
    let adapter = unsafe { factory.EnumAdapters1(0) }.expect("an adapter");
    // SAFETY: a live adapter.
    unsafe { adapter.GetDesc1() }.expect("a description");
    // SAFETY: a live adapter and a static identifier; the driver may not know the answer.
    _ = unsafe { adapter.CheckInterfaceSupport(&IDXGIDevice::IID) };
}

fn directml(engine: &Engine) -> IDMLDevice {
    type Create = unsafe extern "system" fn(
        *mut c_void,
        DML_CREATE_DEVICE_FLAGS,
        DML_FEATURE_LEVEL,
        *const GUID,
        *mut *mut c_void,
    ) -> HRESULT;
    // SAFETY: a static name.
    let module = unsafe { GetModuleHandleW(w!("DirectML.dll")) }.expect("a Cairn device has loaded it");
    // SAFETY: a loaded module, which is never unloaded, and a static name.
    let create = unsafe { GetProcAddress(module, s!("DMLCreateDevice1")) }.expect("its function");
    // SAFETY: the function has this type in every release.
    let create: Create = unsafe { std::mem::transmute(create) };
    let mut device = std::ptr::null_mut();
    let (on, flags, level) = (engine.device.as_raw(), DML_CREATE_DEVICE_FLAG_NONE, DML_FEATURE_LEVEL_5_0);
    // SAFETY: a live device, and a variable that lives during the call.
    unsafe { create(on, flags, level, &IDMLDevice::IID, &mut device) }.ok().expect("DirectML's device");
    // SAFETY: the call gave a reference of this type, used once.
    unsafe { IDMLDevice::from_raw(device) }
}

fn pipeline(engine: &Engine, &(code, words, reads, writes): &(&[u8], u32, u32, u32)) -> ID3D12PipelineState {
    let buffer = |kind, register| D3D12_ROOT_PARAMETER {
        ParameterType: kind,
        Anonymous: D3D12_ROOT_PARAMETER_0 {
            Descriptor: D3D12_ROOT_DESCRIPTOR { ShaderRegister: register, RegisterSpace: 0 },
        },
        ..Default::default()
    };
    let constants = D3D12_ROOT_PARAMETER {
        ParameterType: D3D12_ROOT_PARAMETER_TYPE_32BIT_CONSTANTS,
        Anonymous: D3D12_ROOT_PARAMETER_0 {
            Constants: D3D12_ROOT_CONSTANTS { Num32BitValues: words, ..Default::default() },
        },
        ..Default::default()
    };
    let parameters: Vec<_> = std::iter::once(constants)
        .chain((0..reads).map(|register| buffer(D3D12_ROOT_PARAMETER_TYPE_SRV, register)))
        .chain((0..writes).map(|register| buffer(D3D12_ROOT_PARAMETER_TYPE_UAV, register)))
        .collect();
    let wanted = D3D12_ROOT_SIGNATURE_DESC {
        NumParameters: parameters.len() as u32,
        pParameters: parameters.as_ptr(),
        ..Default::default()
    };
    let mut blob: Option<ID3DBlob> = None;
    // SAFETY: the description and what it points to live during the call, and so does the variable.
    unsafe { D3D12SerializeRootSignature(&wanted, D3D_ROOT_SIGNATURE_VERSION_1, &mut blob, None) }.expect("a blob");
    let blob = blob.expect("a blob");
    // SAFETY: a live blob.
    let (address, length) = unsafe { (blob.GetBufferPointer(), blob.GetBufferSize()) };
    // SAFETY: the blob's own memory, which lives as long as it does.
    let bytes = unsafe { std::slice::from_raw_parts(address.cast::<u8>(), length) };
    // SAFETY: a live device and bytes that live during the call.
    let root: ID3D12RootSignature = unsafe { engine.device.CreateRootSignature(0, bytes) }.expect("a root signature");
    let wanted = D3D12_COMPUTE_PIPELINE_STATE_DESC {
        // SAFETY: a copy that holds no reference and is only read during the call.
        pRootSignature: unsafe { std::mem::transmute_copy(&root) },
        CS: D3D12_SHADER_BYTECODE { pShaderBytecode: code.as_ptr().cast(), BytecodeLength: code.len() },
        ..Default::default()
    };
    // SAFETY: a live device; the description and the code live during the call.
    unsafe { engine.device.CreateComputePipelineState(&wanted) }.expect("a pipeline")
}

fn fences(engine: &Engine) {
    // SAFETY: a live device; the call takes values only.
    let fence = || unsafe { engine.device.CreateFence::<ID3D12Fence>(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    let (_frames, anchors) = (fence(), fence());
    // SAFETY: no name and no security attributes are given.
    let event = unsafe { CreateEventW(None, true, false, None) }.expect("an event");
    // SAFETY: live objects of one device.
    unsafe { engine.compute.Signal(&anchors, 1) }.expect("a signal");
    // SAFETY: a live fence and event.
    unsafe { anchors.SetEventOnCompletion(1, event) }.expect("an event for it");
    // SAFETY: an open handle.
    unsafe { WaitForSingleObject(event, INFINITE) };
    // SAFETY: an open handle that is nobody else's.
    unsafe { CloseHandle(event) }.expect("it is closed");
}
