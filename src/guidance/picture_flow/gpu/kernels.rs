//! The shaders of an extraction.

use super::layout::WORDS;
use crate::Result;
use crate::gpu::Gpu;
use crate::gpu::compute::{Kernel, Shape};

/// Root constants, inputs and outputs of every shader, in the order of `flow.hlsli`.
const SHAPE: Shape = Shape { constants: WORDS as u32, inputs: 2, outputs: 3 };

macro_rules! kernels {
    ($($name:ident),* $(,)?) => {
        /// One kernel for each shader `src/gpu/shaders/flow_<name>.hlsl`.
        pub(super) struct Kernels {
            $(pub(super) $name: Kernel,)*
        }

        impl Kernels {
            pub(super) fn new(gpu: &Gpu) -> Result<Self> {
                Ok(Self {
                    $($name: Kernel::new(
                        gpu,
                        include_bytes!(concat!("../../../gpu/shaders/compiled/flow_", stringify!($name), ".dxbc")),
                        SHAPE,
                    )?,)*
                })
            }
        }
    };
}

kernels! { luma, halve, search, wide, smooth, fit, densify, check, fill, write }
