//! A compute shader, ready to run.

use windows::Win32::Graphics::Direct3D12::*;

use crate::Result;
use crate::gpu::{Gpu, shader};

/// What a shader takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Shape {
    /// Words of constants, in `b0`.
    pub(crate) constants: u32,
    /// What it reads, `t0` and on.
    pub(crate) inputs: u32,
    /// What it writes, `u0` and on.
    pub(crate) outputs: u32,
}

/// A compute shader with its pipeline. Made once for a device; running it makes nothing.
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
    pub(crate) fn new(gpu: &Gpu, code: &'static [u8], shape: Shape) -> Result<Self> {
        assert!(shape.constants + 1 < ROOT_WORDS, "the constants and a table fit into a root signature");
        let (root, pipeline) = gpu.pipelines().of(gpu, code, shape, || root_signature(gpu, shape))?;
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
    let table =
        D3D12_ROOT_DESCRIPTOR_TABLE { NumDescriptorRanges: ranges.len() as u32, pDescriptorRanges: ranges.as_ptr() };
    let parameters = [
        shader::constants(shape.constants),
        D3D12_ROOT_PARAMETER {
            ParameterType: D3D12_ROOT_PARAMETER_TYPE_DESCRIPTOR_TABLE,
            Anonymous: D3D12_ROOT_PARAMETER_0 { DescriptorTable: table },
            ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
        },
    ];
    shader::root_signature(gpu, &parameters)
}
