//! A compute shader with a descriptor table.

use windows::Win32::Graphics::Direct3D12::*;

use crate::Result;
use crate::gpu::{Gpu, shader};

/// The bindings of a shader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Shape {
    /// 32-bit root constants, in `b0`.
    pub(crate) constants: u32,
    /// Shader resource views, from `t0` on.
    pub(crate) inputs: u32,
    /// Unordered access views, from `u0` on.
    pub(crate) outputs: u32,
}

/// A compute shader with its root signature and pipeline. A dispatch creates nothing.
pub(crate) struct Kernel {
    pub(super) root: ID3D12RootSignature,
    pub(super) pipeline: ID3D12PipelineState,
    pub(super) shape: Shape,
}

/// Size limit of a root signature, in 32-bit words.
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

/// Parameter 0: root constants. Parameter 1: one descriptor table, inputs first.
fn root_signature(gpu: &Gpu, shape: Shape) -> Result<ID3D12RootSignature> {
    // A range for each descriptor: Vulkan's synchronisation validation below Direct3D ignores ranges of several.
    let range = |kind, register| D3D12_DESCRIPTOR_RANGE {
        RangeType: kind,
        NumDescriptors: 1,
        BaseShaderRegister: register,
        OffsetInDescriptorsFromTableStart: D3D12_DESCRIPTOR_RANGE_OFFSET_APPEND,
        ..Default::default()
    };
    let inputs = (0..shape.inputs).map(|register| range(D3D12_DESCRIPTOR_RANGE_TYPE_SRV, register));
    let outputs = (0..shape.outputs).map(|register| range(D3D12_DESCRIPTOR_RANGE_TYPE_UAV, register));
    let ranges: Vec<_> = inputs.chain(outputs).collect();
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
