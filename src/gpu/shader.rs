//! Creates root signatures and pipeline states of compute shaders.

use std::mem::ManuallyDrop;

use windows::Win32::Graphics::Direct3D::ID3DBlob;
use windows::Win32::Graphics::Direct3D12::*;

use super::{Gpu, failed_on};
use crate::object_count::count_object;
use crate::{Error, ErrorKind, Result};

/// Root parameter for `count` 32-bit constants in `b0`, visible to all stages.
pub(super) fn constants(count: u32) -> D3D12_ROOT_PARAMETER {
    D3D12_ROOT_PARAMETER {
        ParameterType: D3D12_ROOT_PARAMETER_TYPE_32BIT_CONSTANTS,
        Anonymous: D3D12_ROOT_PARAMETER_0 {
            Constants: D3D12_ROOT_CONSTANTS { Num32BitValues: count, ..Default::default() },
        },
        ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
    }
}

/// Creates a root signature. The pointers in `parameters` must be valid during the call.
pub(super) fn root_signature(gpu: &Gpu, parameters: &[D3D12_ROOT_PARAMETER]) -> Result<ID3D12RootSignature> {
    let wanted = D3D12_ROOT_SIGNATURE_DESC {
        NumParameters: parameters.len() as u32,
        pParameters: parameters.as_ptr(),
        ..Default::default()
    };
    let mut blob: Option<ID3DBlob> = None;
    // SAFETY: the description, the memory it points to and the output pointer live during the call.
    unsafe { D3D12SerializeRootSignature(&wanted, D3D_ROOT_SIGNATURE_VERSION_1, &mut blob, None) }
        .map_err(|e| failed_on(gpu.device(), "D3D12SerializeRootSignature", &e))?;
    let blob = blob.ok_or_else(|| Error::new(ErrorKind::Device, "D3D12SerializeRootSignature gave nothing"))?;
    count_object();
    // SAFETY: a live device and bytes that live during the call.
    unsafe { gpu.device().CreateRootSignature(0, bytes(&blob)) }
        .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateRootSignature", &e))
}

/// A blob's memory.
pub(super) fn bytes(blob: &ID3DBlob) -> &[u8] {
    // SAFETY: a live blob.
    let (address, length) = unsafe { (blob.GetBufferPointer(), blob.GetBufferSize()) };
    if address.is_null() || length == 0 {
        return &[];
    }
    // SAFETY: the blob's own memory, which lives as long as the blob and is never written.
    unsafe { std::slice::from_raw_parts(address.cast::<u8>(), length) }
}

/// Creates the pipeline state of `code`, DXBC of profile cs_5_x; from the driver's `compiled` result of an earlier run, if it is given.
///
/// # Errors
/// `DeviceRemoved`, `OutOfMemory`, or `Device` when the driver cannot take it.
pub(super) fn pipeline_state(
    gpu: &Gpu,
    root: &ID3D12RootSignature,
    code: &[u8],
    compiled: Option<&[u8]>,
) -> Result<ID3D12PipelineState> {
    let cached = compiled.map_or_else(D3D12_CACHED_PIPELINE_STATE::default, |compiled| D3D12_CACHED_PIPELINE_STATE {
        pCachedBlob: compiled.as_ptr().cast(),
        CachedBlobSizeInBytes: compiled.len(),
    });
    let wanted = D3D12_COMPUTE_PIPELINE_STATE_DESC {
        pRootSignature: ManuallyDrop::new(Some(root.clone())),
        CS: D3D12_SHADER_BYTECODE { pShaderBytecode: code.as_ptr().cast(), BytecodeLength: code.len() },
        CachedPSO: cached,
        ..Default::default()
    };
    count_object();
    // SAFETY: a live device; the description and the code live during the call.
    let state = unsafe { gpu.device().CreateComputePipelineState(&wanted) };
    // The description's own reference.
    drop(ManuallyDrop::into_inner(wanted.pRootSignature));
    state.map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateComputePipelineState", &e))
}
