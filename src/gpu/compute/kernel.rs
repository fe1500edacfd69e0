//! A compute shader, ready to run.

use std::mem::ManuallyDrop;

use windows::Win32::Graphics::Direct3D::ID3DBlob;
use windows::Win32::Graphics::Direct3D12::*;

use crate::gpu::{Gpu, failed_on};
use crate::{Error, ErrorKind, Result};

/// What a shader takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shape {
    /// Words of constants, in `b0`.
    pub(crate) constants: u32,
    /// What it reads, `t0` and on.
    pub(crate) inputs: u32,
    /// What it writes, `u0` and on.
    pub(crate) outputs: u32,
}

/// A compute shader with its pipeline. Made once; running it makes nothing.
pub(crate) struct Kernel {
    pub(super) root: ID3D12RootSignature,
    pub(super) pipeline: ID3D12PipelineState,
    pub(super) shape: Shape,
}

/// Words that a root signature has room for.
const ROOT_WORDS: u32 = 64;

impl Kernel {
    /// The shader `code`, DXBC of profile cs_5_x.
    ///
    /// # Errors
    /// `DeviceRemoved`, `OutOfMemory`, or `Device` when the driver cannot take it.
    pub(crate) fn new(gpu: &Gpu, code: &[u8], shape: Shape) -> Result<Self> {
        assert!(shape.constants + 1 < ROOT_WORDS, "the constants and a table fit into a root signature");
        let root = root_signature(gpu, shape)?;
        // SAFETY: the root signature is borrowed, not released by this copy.
        let borrowed: ManuallyDrop<Option<ID3D12RootSignature>> = unsafe { std::mem::transmute_copy(&root) };
        let wanted = D3D12_COMPUTE_PIPELINE_STATE_DESC {
            pRootSignature: borrowed,
            CS: D3D12_SHADER_BYTECODE { pShaderBytecode: code.as_ptr().cast(), BytecodeLength: code.len() },
            ..Default::default()
        };
        // SAFETY: a live device; the description and what it points to live during the call.
        let pipeline = unsafe { gpu.device().CreateComputePipelineState(&wanted) }
            .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateComputePipelineState", &e))?;
        Ok(Self { root, pipeline, shape })
    }
}

/// Constants in the first parameter; in the second one table of everything else, inputs first.
fn root_signature(gpu: &Gpu, shape: Shape) -> Result<ID3D12RootSignature> {
    let range = |kind, count| D3D12_DESCRIPTOR_RANGE {
        RangeType: kind,
        NumDescriptors: count,
        OffsetInDescriptorsFromTableStart: D3D12_DESCRIPTOR_RANGE_OFFSET_APPEND,
        ..Default::default()
    };
    let ranges =
        [range(D3D12_DESCRIPTOR_RANGE_TYPE_SRV, shape.inputs), range(D3D12_DESCRIPTOR_RANGE_TYPE_UAV, shape.outputs)];
    // A range must not be empty.
    let ranges = &ranges[usize::from(shape.inputs == 0)..];
    let constants = D3D12_ROOT_CONSTANTS { Num32BitValues: shape.constants, ..Default::default() };
    let table =
        D3D12_ROOT_DESCRIPTOR_TABLE { NumDescriptorRanges: ranges.len() as u32, pDescriptorRanges: ranges.as_ptr() };
    let parameters = [
        D3D12_ROOT_PARAMETER {
            ParameterType: D3D12_ROOT_PARAMETER_TYPE_32BIT_CONSTANTS,
            Anonymous: D3D12_ROOT_PARAMETER_0 { Constants: constants },
            ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
        },
        D3D12_ROOT_PARAMETER {
            ParameterType: D3D12_ROOT_PARAMETER_TYPE_DESCRIPTOR_TABLE,
            Anonymous: D3D12_ROOT_PARAMETER_0 { DescriptorTable: table },
            ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
        },
    ];
    let wanted = D3D12_ROOT_SIGNATURE_DESC {
        NumParameters: parameters.len() as u32,
        pParameters: parameters.as_ptr(),
        ..Default::default()
    };
    let mut blob: Option<ID3DBlob> = None;
    // SAFETY: the description and what it points to live during the call, and so does the place.
    unsafe { D3D12SerializeRootSignature(&wanted, D3D_ROOT_SIGNATURE_VERSION_1, &mut blob, None) }
        .map_err(|e| failed_on(gpu.device(), "D3D12SerializeRootSignature", &e))?;
    let blob = blob.ok_or_else(|| Error::new(ErrorKind::Device, "D3D12SerializeRootSignature gave nothing"))?;
    // SAFETY: a blob's own bytes, which live as long as it.
    let bytes = unsafe { std::slice::from_raw_parts(blob.GetBufferPointer().cast::<u8>(), blob.GetBufferSize()) };
    // SAFETY: a live device and bytes that live during the call.
    unsafe { gpu.device().CreateRootSignature(0, bytes) }
        .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CreateRootSignature", &e))
}
