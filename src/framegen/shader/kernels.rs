//! The shaders of a frame.

use super::layout::WORDS;
use crate::Result;
use crate::gpu::Gpu;
use crate::gpu::compute::{Kernel, Shape};

/// What each of them reads and writes, in the order of `frame.hlsli`.
const SHAPE: Shape = Shape { constants: WORDS as u32, inputs: 6, outputs: 6 };

macro_rules! kernels {
    ($($name:ident),* $(,)?) => {
        /// One of each, named as its text in `src/gpu/shaders` is after `frame_`.
        pub(super) struct Kernels {
            $(pub(super) $name: Kernel,)*
        }

        impl Kernels {
            pub(super) fn new(gpu: &Gpu) -> Result<Self> {
                Ok(Self {
                    $($name: Kernel::new(
                        gpu,
                        include_bytes!(concat!("../../gpu/shaders/frame_", stringify!($name), ".dxbc")),
                        SHAPE,
                    )?,)*
                })
            }
        }
    };
}

kernels! {
    begin, lines, reduce, detail, block, verdict, tiny, shift, whole, seen, given, field, claim, settle,
    leave, join, free, pyramid, fill, render, beyond, squares, mean, paint,
}
