//! The paper's hand-made extractor: motion from the difference of two latents.
//!
//! Section 5.1 of "Fewer, Better Frames" (arXiv:2606.02586), with a choice for each point it leaves open:
//!
//! ```text
//! dz    = mean over channels of (z1 - z0)                        a scalar on the latent grid
//! d     = (d dz/dx, d dz/dy)                                     as numpy.gradient, unit spacing, x along columns
//! m     = -U(8 d), clamped to [-width, width] x [-height, height]    U: bilinear, half-pixel centres, edge clamp
//! depth = U((c - min c) / (max c - min c)), c = channel 0 of z1
//! ```
//!
//! The 8 is the compression factor the paper's project recorded. It stays although a cell of a Waypoint-1.5 latent covers 16 pixels of
//! the autoencoder's picture: this extractor reproduces the paper and does not improve on it. The gradient along an axis of one cell
//! is 0, a constant channel has depth 0, and non-finite values give 0 in their cell. The pseudo-depth is used unchanged as device
//! depth of [`PROJECTION`].

#[cfg(windows)]
mod gpu;

use half::f16;

use super::interpolation::{Tap, bilinear};
use super::{Guidance, LatentView, MotionOrigin, Projection, check_shapes};
use crate::Result;
use crate::allocate;
use crate::tasks::{Parallel, ParallelSliceMut, PoolLease};

#[cfg(windows)]
pub use gpu::{GpuExtractor, LatentBuffer};

/// Autoencoder pixels per latent cell, as the paper recorded it.
pub const COMPRESSION: f32 = 8.0;

#[cfg(test)]
crate::shader_constants::shader_constants!("PAPER_": float COMPRESSION);

/// The camera stated for the pseudo-depth: near 0.1, far 100, and, as the paper names none, 60 degrees vertically.
pub const PROJECTION: Projection = Projection::constant(0.1, 100.0, std::f32::consts::FRAC_PI_3);

/// Writes the guidance for the step from `z0` (previous) to `z1` (current) at the `render` size `(width, height)` to `out`.
///
/// One extraction; an [`Extractor`] keeps its working memory from one to the next.
///
/// # Errors
/// As [`Extractor::extract`].
pub fn extract(z0: LatentView<'_>, z1: LatentView<'_>, render: (u32, u32), out: &mut Guidance) -> Result<()> {
    Extractor::new().extract(z0, z1, render, out)
}

/// The extractor with its working memory. It allocates nothing once it has seen the largest latent and render size.
#[derive(Debug)]
pub struct Extractor {
    scale: f32,
    delta: Vec<f64>,
    displacement: Vec<[f32; 2]>,
    pseudo_depth: Vec<f32>,
    columns: Vec<Tap>,
    _threads: PoolLease,
}

impl Default for Extractor {
    fn default() -> Self {
        Self::new()
    }
}

impl Extractor {
    /// An extractor without working memory yet.
    pub fn new() -> Self {
        Self::scaled(COMPRESSION)
    }

    /// An extractor with motion `-U(scale d)`: the paper's with a factor other than [`COMPRESSION`], which its authors did not calibrate.
    /// Non-finite motion becomes 0.
    pub fn scaled(scale: f32) -> Self {
        Self {
            scale,
            delta: Vec::new(),
            displacement: Vec::new(),
            pseudo_depth: Vec::new(),
            columns: Vec::new(),
            _threads: PoolLease::new(),
        }
    }

    /// Fills `out` for the step from `z0` (previous) to `z1` (current) at the `render` size `(width, height)`;
    /// `out` becomes one of that size, per pixel, if it is another.
    ///
    /// # Errors
    /// `InvalidArgument` when the latents differ in shape or the render size is outside 1 to
    /// [`MAX_SIDE`](crate::MAX_SIDE); `OutOfMemory` when `out` cannot grow.
    pub fn extract(
        &mut self,
        z0: LatentView<'_>,
        z1: LatentView<'_>,
        render: (u32, u32),
        out: &mut Guidance,
    ) -> Result<()> {
        check_shapes(z0, z1)?;
        out.make_per_pixel(render, PROJECTION, MotionOrigin::LatentGradient)?;
        let [_, height, width] = z1.shape();
        allocate::reserve(&mut self.delta, height * width)?;
        allocate::reserve(&mut self.displacement, height * width)?;
        allocate::reserve(&mut self.pseudo_depth, height * width)?;
        allocate::reserve(&mut self.columns, out.size().0 as usize)?;

        self.difference(z0, z1);
        self.gradient(z1.shape());
        self.normalise(z1.channel(0));
        self.upsample(z1.shape(), out);
        Ok(())
    }

    /// `delta` = mean over channels of `z1 - z0`.
    fn difference(&mut self, z0: LatentView<'_>, z1: LatentView<'_>) {
        let [channels, height, width] = z1.shape();
        self.delta.clear();
        self.delta.resize(height * width, 0.0);
        for c in 0..channels {
            for ((sum, &a), &b) in self.delta.iter_mut().zip(z0.channel(c)).zip(z1.channel(c)) {
                *sum += f64::from(b) - f64::from(a);
            }
        }
        self.delta.iter_mut().for_each(|sum| *sum /= channels as f64);
    }

    /// `displacement` = gradient of `delta`.
    fn gradient(&mut self, [_, height, width]: [usize; 3]) {
        let delta = &self.delta;
        // numpy.gradient: central inside, one-sided at the ends; `len` cells that lie `stride` apart.
        let slope = |first: usize, i: usize, len: usize, stride: usize| {
            let (low, high) = (i.saturating_sub(1), (i + 1).min(len - 1));
            if low == high {
                return 0.0;
            }
            let slope = (delta[first + high * stride] - delta[first + low * stride]) / (high - low) as f64;
            if slope.is_finite() { slope as f32 } else { 0.0 }
        };
        self.displacement.clear();
        self.displacement.extend(
            (0..height)
                .flat_map(|y| (0..width).map(move |x| [slope(y * width, x, width, 1), slope(x, y, height, width)])),
        );
    }

    /// `pseudo_depth` = `channel` with its finite values scaled to [0, 1].
    fn normalise(&mut self, channel: &[f32]) {
        let finite = channel.iter().copied().filter(|v| v.is_finite());
        let (low, high) = finite.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let span = f64::from(high) - f64::from(low);
        self.pseudo_depth.clear();
        self.pseudo_depth.extend(
            channel.iter().map(|&v| {
                if v.is_finite() && span > 0.0 { ((f64::from(v) - f64::from(low)) / span) as f32 } else { 0.0 }
            }),
        );
    }

    /// Upsamples both latent-grid fields to render size.
    fn upsample(&mut self, [_, height, width]: [usize; 3], out: &mut Guidance) {
        let (render_width, render_height) = (out.size().0 as usize, out.size().1 as usize);
        self.columns.clear();
        self.columns.extend((0..render_width).map(|x| Tap::new(x, render_width, width)));
        let (scale, columns) = (self.scale, &self.columns);
        let (displacement, pseudo_depth) = (&self.displacement, &self.pseudo_depth);
        let limit = [render_width as f32, render_height as f32];

        let Guidance { motion, depth, .. } = out;
        let motion_rows = motion.vectors_mut().par_chunks_mut(render_width);
        let depth_rows = depth.depth_mut().par_chunks_mut(render_width);
        motion_rows.zip(depth_rows).enumerate().for_each(|(y, (motion_row, depth_row))| {
            let row = Tap::new(y, render_height, height);
            for ((vector, depth), column) in motion_row.iter_mut().zip(depth_row).zip(columns) {
                let cells = Tap::cells(row, *column, width);
                let weights = [column.weight, row.weight];
                *vector = [0, 1].map(|axis| {
                    // Subtracting from 0 gives +0 for no motion, where negating would give -0.
                    let m = 0.0 - scale * bilinear(cells, weights, |cell| displacement[cell][axis]);
                    let m = if m.is_finite() { m.clamp(-limit[axis], limit[axis]) } else { 0.0 };
                    f16::from_f32(m)
                });
                *depth = bilinear(cells, weights, |cell| pseudo_depth[cell]).clamp(0.0, 1.0);
            }
        });
    }
}

#[cfg(test)]
mod tests;
