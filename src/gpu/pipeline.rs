//! A compute shader over raw buffers, without descriptors.

use windows::Win32::Graphics::Direct3D12::*;

use super::{Gpu, shader};
use crate::Result;

/// A compute shader whose parameters are root constants in `b0`, read-only buffers from `t0` and writable buffers from `u0`, all
/// byte-addressed root descriptors. It must live until the lists that it was recorded into have run.
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
    /// Creates the pipeline of `code`, DXBC, with this number of 32-bit constants, read-only buffers and writable buffers.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`, `Device`.
    pub(crate) fn new(gpu: &Gpu, code: &[u8], constants: usize, reads: usize, writes: usize) -> Result<Self> {
        let root = root_signature(gpu, constants, reads, writes)?;
        let state = shader::pipeline_state(gpu, &root, code, None)?;
        Ok(Self { state, root, constants, reads, writes })
    }

    /// Records one dispatch of `groups` thread groups into an open list. Read buffers must be in the state NON_PIXEL_SHADER_RESOURCE, written
    /// buffers in UNORDERED_ACCESS. Changes the list's pipeline and root signature.
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

/// Root constants first, then the buffers, each as a root descriptor.
fn root_signature(gpu: &Gpu, constants: usize, reads: usize, writes: usize) -> Result<ID3D12RootSignature> {
    let buffers = |kind, count: usize| {
        (0..count as u32).map(move |register| D3D12_ROOT_PARAMETER {
            ParameterType: kind,
            Anonymous: D3D12_ROOT_PARAMETER_0 {
                Descriptor: D3D12_ROOT_DESCRIPTOR { ShaderRegister: register, RegisterSpace: 0 },
            },
            ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
        })
    };
    let parameters: Vec<_> = std::iter::once(shader::constants(constants as u32))
        .chain(buffers(D3D12_ROOT_PARAMETER_TYPE_SRV, reads))
        .chain(buffers(D3D12_ROOT_PARAMETER_TYPE_UAV, writes))
        .collect();
    shader::root_signature(gpu, &parameters)
}
