//! The compute shaders of a frame.

use super::layout::WORDS;
use crate::Result;
use crate::gpu::Gpu;
use crate::gpu::compute::{Kernel, Shape};

/// Bindings of all shaders, in the order of `frame.hlsli`.
const SHAPE: Shape = Shape { constants: WORDS as u32, inputs: 6, outputs: 6 };

macro_rules! kernels {
    ($($name:ident),* $(,)?) => {
        /// All shaders; each has the name of its source in `src/gpu/shaders` after `frame_`.
        pub(super) struct Kernels {
            $(pub(super) $name: Kernel,)*
        }

        impl Kernels {
            pub(super) fn new(gpu: &Gpu) -> Result<Self> {
                Ok(Self {
                    $($name: Kernel::new(
                        gpu,
                        include_bytes!(concat!("../../gpu/shaders/compiled/frame_", stringify!($name), ".dxbc")),
                        SHAPE,
                    )?,)*
                })
            }
        }
    };
}

kernels! {
    clear, letterbox, reduce, detail, match_blocks, decide_cut, tiny, correlate, global_shift, camera_fit, guidance_tiles, field, splat, resolve, pyramid, fill_holes, interpolate, extrapolate, tile_colours, mean_colour, inpaint,
}
