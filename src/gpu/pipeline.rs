//! Compute shaders over raw buffers.

use std::mem::ManuallyDrop;

use windows::Win32::Graphics::Direct3D::ID3DBlob;
use windows::Win32::Graphics::Direct3D12::*;

use super::Gpu;
use super::failure::failed_on;
use crate::{Error, ErrorKind, Result};

/// A compute shader and what it is bound to: constants in `b0`, buffers it reads in `t0` and on, buffers it writes in `u0` and
/// on, all as bytes. It must live until the lists that it was recorded into have run.
///
/// Threads: may be used from any thread at any time.
pub(crate) struct Pipeline {
    state: ID3D12PipelineState,
    root: ID3D12RootSignature,
    constants: usize,
    reads: usize,
    writes: usize,
}

impl Pipeline {
    /// Compiles `code`, DXBC, for the device's driver; it takes so many words of constants, buffers to read and buffers to write.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`, `Device`.
    pub(crate) fn new(gpu: &Gpu, code: &[u8], constants: usize, reads: usize, writes: usize) -> Result<Self> {
        let device = gpu.device();
        let root = root_signature(device, constants, reads, writes)?;
        let wanted = D3D12_COMPUTE_PIPELINE_STATE_DESC {
            pRootSignature: ManuallyDrop::new(Some(root.clone())),
            CS: D3D12_SHADER_BYTECODE { pShaderBytecode: code.as_ptr().cast(), BytecodeLength: code.len() },
            ..Default::default()
        };
        // SAFETY: a live device; the description and the code live during the call.
        let state = unsafe { device.CreateComputePipelineState(&wanted) };
        // The description's own reference.
        drop(ManuallyDrop::into_inner(wanted.pRootSignature));
        let state = state.map_err(|e| failed_on(device, "ID3D12Device::CreateComputePipelineState", &e))?;
        Ok(Self { state, root, constants, reads, writes })
    }

    /// Records one dispatch of `groups` groups into an open list. What it reads must be in the state NON_PIXEL_SHADER_RESOURCE,
    /// what it writes in UNORDERED_ACCESS; pipeline and root signature of the list are changed.
    pub(crate) fn record(
        &self,
        list: &ID3D12GraphicsCommandList,
        constants: &[u32],
        reads: &[&ID3D12Resource],
        writes: &[&ID3D12Resource],
        groups: u32,
    ) {
        let given = (constants.len(), reads.len(), writes.len());
        assert_eq!(given, (self.constants, self.reads, self.writes), "what the shader takes");
        // SAFETY: an open list, and objects of its device.
        unsafe { list.SetComputeRootSignature(&self.root) };
        // SAFETY: as above.
        unsafe { list.SetPipelineState(&self.state) };
        // SAFETY: as above; the constants live during the call.
        unsafe { list.SetComputeRoot32BitConstants(0, constants.len() as u32, constants.as_ptr().cast(), 0) };
        for (i, buffer) in (1..).zip(reads) {
            // SAFETY: a live buffer.
            let address = unsafe { buffer.GetGPUVirtualAddress() };
            // SAFETY: an open list whose root signature has a buffer to read there.
            unsafe { list.SetComputeRootShaderResourceView(i, address) };
        }
        for (i, buffer) in (1 + reads.len() as u32..).zip(writes) {
            // SAFETY: a live buffer.
            let address = unsafe { buffer.GetGPUVirtualAddress() };
            // SAFETY: an open list whose root signature has a buffer to write there.
            unsafe { list.SetComputeRootUnorderedAccessView(i, address) };
        }
        // SAFETY: an open list with everything bound.
        unsafe { list.Dispatch(groups, 1, 1) };
    }
}

/// Constants first, then the buffers, each a parameter of its own.
fn root_signature(device: &ID3D12Device, constants: usize, reads: usize, writes: usize) -> Result<ID3D12RootSignature> {
    let visible = D3D12_SHADER_VISIBILITY_ALL;
    let words = D3D12_ROOT_PARAMETER {
        ParameterType: D3D12_ROOT_PARAMETER_TYPE_32BIT_CONSTANTS,
        Anonymous: D3D12_ROOT_PARAMETER_0 {
            Constants: D3D12_ROOT_CONSTANTS { ShaderRegister: 0, RegisterSpace: 0, Num32BitValues: constants as u32 },
        },
        ShaderVisibility: visible,
    };
    let buffers = |kind, count: usize| {
        (0..count as u32).map(move |register| D3D12_ROOT_PARAMETER {
            ParameterType: kind,
            Anonymous: D3D12_ROOT_PARAMETER_0 {
                Descriptor: D3D12_ROOT_DESCRIPTOR { ShaderRegister: register, RegisterSpace: 0 },
            },
            ShaderVisibility: visible,
        })
    };
    let parameters: Vec<_> = std::iter::once(words)
        .chain(buffers(D3D12_ROOT_PARAMETER_TYPE_SRV, reads))
        .chain(buffers(D3D12_ROOT_PARAMETER_TYPE_UAV, writes))
        .collect();
    let wanted = D3D12_ROOT_SIGNATURE_DESC {
        NumParameters: parameters.len() as u32,
        pParameters: parameters.as_ptr(),
        ..Default::default()
    };
    let mut blob: Option<ID3DBlob> = None;
    // SAFETY: the description and the place live during the call.
    unsafe { D3D12SerializeRootSignature(&wanted, D3D_ROOT_SIGNATURE_VERSION_1, &mut blob, None) }
        .map_err(|e| failed_on(device, "D3D12SerializeRootSignature", &e))?;
    let blob = blob.ok_or_else(|| Error::new(ErrorKind::Device, "D3D12SerializeRootSignature gave nothing"))?;
    // SAFETY: a live blob.
    let (address, length) = unsafe { (blob.GetBufferPointer(), blob.GetBufferSize()) };
    // SAFETY: the blob's own memory, which lives as long as it does and which nobody writes.
    let bytes = unsafe { std::slice::from_raw_parts(address.cast::<u8>(), length) };
    // SAFETY: a live device.
    unsafe { device.CreateRootSignature(0, bytes) }
        .map_err(|e| failed_on(device, "ID3D12Device::CreateRootSignature", &e))
}
