//! Conversion of values between the host's f32 and a graph's element type.

use half::f16;
use half::slice::HalfFloatSliceExt;

use crate::bundle::Precision;
use crate::runtime::{BufferId, ExecutionContext};
use crate::{Result, allocate};

/// Writes f32 values into buffers of one precision, without allocating.
pub(super) struct Uploader {
    precision: Precision,
    staging: Vec<f16>,
}

impl Uploader {
    /// For buffers of `precision`, at most `len` values at a time.
    pub(super) fn new(precision: Precision, len: usize) -> Result<Self> {
        let staging = allocate::zeroed(if precision == Precision::F16 { len } else { 0 })?;
        Ok(Self { precision, staging })
    }

    /// Writes `values` to the start of `to`.
    pub(super) fn upload(&mut self, context: &mut dyn ExecutionContext, to: BufferId, values: &[f32]) -> Result<()> {
        match self.precision {
            Precision::F32 => context.upload(to, 0, bytemuck::cast_slice(values)),
            Precision::F16 => {
                let staging = &mut self.staging[..values.len()];
                staging.convert_from_f32_slice(values);
                context.upload(to, 0, bytemuck::cast_slice(staging))
            }
        }
    }
}

/// Fills `values` from a buffer of `precision`, from element `at` on; waits for the device.
pub(super) fn read(
    context: &dyn ExecutionContext,
    precision: Precision,
    from: BufferId,
    at: usize,
    values: &mut [f32],
) -> Result<()> {
    match precision {
        Precision::F32 => context.read(from, at * 4, bytemuck::cast_slice_mut(values)),
        Precision::F16 => {
            // The f16 values are read into the rear half of `values` and widened in place: value i is read from byte 2n + 2i before
            // bytes 4i to 4i + 3 are written, and these hold no later value.
            let n = values.len();
            let halves: &mut [f16] = bytemuck::cast_slice_mut(values);
            context.read(from, at * 2, bytemuck::cast_slice_mut(&mut halves[n..]))?;
            for i in 0..n {
                let wide = halves[n + i].to_f32().to_bits();
                halves[2 * i..2 * i + 2].copy_from_slice(bytemuck::cast_slice::<u32, f16>(&[wide]));
            }
            Ok(())
        }
    }
}
