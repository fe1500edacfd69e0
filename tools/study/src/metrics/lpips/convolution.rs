//! Convolutions as matrix products.
//!
//! With channels-last layout, the inputs of one kernel row are contiguous in memory, so consecutive pixels give overlapping matrix rows. A
//! convolution with stride 1 is thus one product per kernel row over whole rows of the map, without copying. The border columns between two
//! rows get invalid values and are set to zero again. The first layers have three channels and larger strides; their patches are
//! copied (im2col).

use std::ops::Range;

use multiversion::multiversion;
use rayon::prelude::*;

use super::map::Map;
use super::weights::Kernel;

/// Pixels per task: enough to outweigh packing the kernel for the product.
const TASK: usize = 1024;

/// Minimum number of tasks of a map, to use several threads.
const TASKS: usize = 4;

/// A convolution with stride and zero padding, followed by a ReLU.
pub(super) struct Convolution {
    pub(super) kernel: Kernel,
    pub(super) step: usize,
    pub(super) border: usize,
}

impl Convolution {
    /// Output columns or rows for an input of `side`; `None` if the kernel does not fit.
    pub(super) fn side(&self, side: usize) -> usize {
        (side + 2 * self.border + self.step).saturating_sub(self.kernel.size) / self.step
    }

    /// Input rows needed for the given output rows.
    pub(super) fn needs(&self, rows: Range<isize>) -> Range<isize> {
        let (step, border, size) = (self.step as isize, self.border as isize, self.kernel.size as isize);
        rows.start * step - border..(rows.end - 1) * step - border + size
    }

    /// Computes `rows` of the output. `input` has the rows given by [`needs`](Self::needs) and this padding; so has `output`.
    pub(super) fn apply(&self, input: &Map, output: &mut Map, rows: Range<isize>) {
        assert!(input.border == self.border && output.border == self.border);
        assert!(input.channels == self.kernel.inputs && output.channels == self.kernel.outputs);
        let needed = self.needs(rows.clone());
        assert!(input.rows.start <= needed.start && input.rows.end >= needed.end);
        assert!(output.rows.start <= rows.start && output.rows.end >= rows.end);
        let pitch = output.pitch();
        // Independent of the thread count, so that products are split the same way and give the same bits.
        let together = TASK.div_ceil(pitch).min(rows.len().div_ceil(TASKS)).max(1);
        let (start, end) = (output.place(rows.start), output.place(rows.end - 1) + output.width * output.channels);
        let (width, channels) = (output.width, output.channels);
        let tasks = output.data_mut()[start..end].par_chunks_mut(together * pitch * channels).enumerate();
        tasks.for_each_init(Vec::new, |patches, (number, out)| {
            let first = rows.start + (number * together) as isize;
            let rows = first..(first + together as isize).min(rows.end);
            if self.step == 1 && self.kernel.inputs >= 16 {
                self.slide(input, rows, pitch, out);
            } else {
                self.gather(input, rows, [width, pitch], patches, out);
            }
            finish(out, &self.kernel.bias, width, pitch);
        });
    }

    /// Output rows as overlapping input rows times the kernel.
    fn slide(&self, input: &Map, rows: Range<isize>, pitch: usize, out: &mut [f32]) {
        let Kernel { size, inputs, outputs, kernel, .. } = &self.kernel;
        let across = size * inputs;
        let pixels = (rows.len() - 1) * pitch + input.width;
        for (ky, kernel) in kernel.chunks_exact(across * outputs).enumerate() {
            let from = input.place(rows.start + ky as isize - self.border as isize) - self.border * inputs;
            product([pixels, across, *outputs], &input.data()[from..], *inputs, kernel, ky > 0, out);
        }
    }

    /// Output rows with the kernel's input patches copied (im2col).
    fn gather(
        &self,
        input: &Map,
        rows: Range<isize>,
        [width, pitch]: [usize; 2],
        patches: &mut Vec<f32>,
        out: &mut [f32],
    ) {
        let Kernel { size, inputs, outputs, kernel, .. } = &self.kernel;
        let (across, patch) = (size * inputs, size * size * inputs);
        patches.resize(width * patch, 0.0);
        for (y, out) in rows.zip(out.chunks_mut(pitch * outputs)) {
            for ky in 0..*size {
                let line = y * self.step as isize - self.border as isize + ky as isize;
                let from = input.place(line) - self.border * inputs;
                for (x, patch) in patches.chunks_exact_mut(patch).enumerate() {
                    let from = from + x * self.step * inputs;
                    patch[ky * across..][..across].copy_from_slice(&input.data()[from..from + across]);
                }
            }
            product([width, patch, *outputs], patches, patch, kernel, false, out);
        }
    }
}

/// `out = a b`, or `out += a b`: `a` has `m` rows of `k` values, `step` apart and possibly overlapping; `b` is `k` x `n` and `out` is `m` x `n`,
/// row by row.
fn product([m, k, n]: [usize; 3], a: &[f32], step: usize, b: &[f32], adds: bool, out: &mut [f32]) {
    assert!((m - 1) * step + k <= a.len() && k * n <= b.len() && m * n <= out.len());
    let (step, n_step) = (step as isize, n as isize);
    let beta = if adds { 1.0 } else { 0.0 };
    // SAFETY: every index reached by m, k, n and the steps lies inside its slice, as asserted; `out` is borrowed exclusively.
    unsafe {
        matrixmultiply::sgemm(
            m,
            k,
            n,
            1.0,
            a.as_ptr(),
            step,
            1,
            b.as_ptr(),
            n_step,
            1,
            beta,
            out.as_mut_ptr(),
            n_step,
            1,
        );
    }
}

/// Adds the bias, applies the ReLU, and sets the border between rows to zero.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn finish(out: &mut [f32], bias: &[f32], width: usize, pitch: usize) {
    for line in out.chunks_mut(pitch * bias.len()) {
        let (line, border) = line.split_at_mut(width * bias.len());
        for pixel in line.chunks_exact_mut(bias.len()) {
            for (value, bias) in pixel.iter_mut().zip(bias) {
                let sum = *value + bias;
                *value = if sum > 0.0 { sum } else { 0.0 };
            }
        }
        border.fill(0.0);
    }
}
