//! Resizes pictures: separable resampling by Lanczos or Catmull-Rom.
//!
//! The filters work on the stored sRGB values, not on linear light, as video scalers commonly do: edges ring less visibly in the dark, but a
//! fine bright pattern darkens a little when it is reduced. Outside the picture, edge pixels are repeated. All four channels are treated
//! alike.

use crate::allocate::zeroed;
use crate::tasks::{self, Parallel, ParallelSliceMut, PoolLease};
use crate::{Error, ErrorKind, MAX_SIDE, Picture, Result};

/// Resampling kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Filter {
    /// sinc(x) sinc(x / 3) within 3 source pixels: the sharpest, rings slightly.
    Lanczos3,
    /// The cubic of Catmull and Rom within 2 source pixels: softer, reproduces linear ramps exactly.
    CatmullRom,
}

impl Filter {
    /// Half the kernel's width, in source pixels at a scale of 1.
    fn radius(self) -> f64 {
        match self {
            Self::Lanczos3 => 3.0,
            Self::CatmullRom => 2.0,
        }
    }

    /// The kernel at distance `x` from its centre.
    fn weight(self, x: f64) -> f64 {
        let x = x.abs();
        match self {
            _ if x >= self.radius() => 0.0,
            Self::Lanczos3 => sinc(x) * sinc(x / 3.0),
            Self::CatmullRom if x < 1.0 => (1.5 * x - 2.5) * x * x + 1.0,
            Self::CatmullRom => ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0,
        }
    }
}

fn sinc(x: f64) -> f64 {
    let angle = std::f64::consts::PI * x;
    // libm, so that every platform computes the same table.
    if angle == 0.0 { 1.0 } else { libm::sin(angle) / angle }
}

/// Resamples pictures of one size to another. If the new size is smaller, the kernel is widened by the ratio, so that detail too fine for it is
/// averaged instead of aliased. The result does not depend on the number of threads.
#[derive(Debug)]
pub struct Upscaler {
    from: (u32, u32),
    to: (u32, u32),
    columns: Table,
    rows: Table,
    /// One vertically resampled row, in floats, per band of output rows.
    scratch: Vec<f32>,
    _threads: PoolLease,
}

impl Upscaler {
    /// Creates a resampler from the size `from` to the size `to`, both `(width, height)` in pixels.
    ///
    /// # Errors
    /// `InvalidArgument` for a side outside 1 to [`MAX_SIDE`]; `OutOfMemory`.
    pub fn new(from: (u32, u32), to: (u32, u32), filter: Filter) -> Result<Self> {
        for ((width, height), field) in [(from, "from"), (to, "to")] {
            let sides = 1..=MAX_SIDE;
            if !sides.contains(&width) || !sides.contains(&height) {
                return Err(Error::new(
                    ErrorKind::InvalidArgument,
                    format!("pictures of {width} x {height} pixels cannot be resampled"),
                )
                .field(field)
                .remedy(format!("Use a width and a height from 1 to {MAX_SIDE}")));
            }
        }
        let threads = PoolLease::new();
        let bands = tasks::concurrency().saturating_mul(BANDS_PER_THREAD).min(to.1 as usize);
        Ok(Self {
            from,
            to,
            columns: Table::new(from.0, to.0, filter)?,
            rows: Table::new(from.1, to.1, filter)?,
            scratch: zeroed(from.0 as usize * 4 * bands)?,
            _threads: threads,
        })
    }

    /// `(width, height)` of the source pictures.
    pub fn from_size(&self) -> (u32, u32) {
        self.from
    }

    /// `(width, height)` of the resampled pictures.
    pub fn to_size(&self) -> (u32, u32) {
        self.to
    }

    /// Resamples `source` into `out`. Allocates nothing.
    ///
    /// # Errors
    /// `InvalidArgument` if `source` or `out` has another size than the resampler.
    pub fn upscale(&mut self, source: &Picture, out: &mut Picture) -> Result<()> {
        for (have, want, field) in [(source.size(), self.from, "source"), (out.size(), self.to, "out")] {
            if have != want {
                return Err(Error::new(
                    ErrorKind::InvalidArgument,
                    format!("a picture of {} x {} pixels where {} x {} are due", have.0, have.1, want.0, want.1),
                )
                .field(field));
            }
        }
        let source_row = self.from.0 as usize * 4;
        let out_row = self.to.0 as usize * 4;
        let bands = self.scratch.len() / source_row;
        let band_rows = (self.to.1 as usize).div_ceil(bands);
        let (rows, columns) = (&self.rows, &self.columns);

        let out_bands = out.rgba_mut().par_chunks_mut(band_rows * out_row);
        let scratch_rows = self.scratch.par_chunks_mut(source_row);
        out_bands.zip(scratch_rows).enumerate().for_each(|(band, (out_band, row))| {
            for (i, out) in out_band.chunks_exact_mut(out_row).enumerate() {
                mix_rows(source.rgba(), rows.taps(band * band_rows + i), row);
                mix_columns(row.as_chunks::<4>().0, columns, out.as_chunks_mut::<4>().0);
            }
        });
        Ok(())
    }
}

/// Bands of output rows per thread: enough to balance the load, few enough to keep the scratch rows in cache.
const BANDS_PER_THREAD: usize = 8;

/// Sets `row` to the weighted sum of the source rows from `first` on.
fn mix_rows(source: &[u8], (first, weights): (usize, &[f32]), row: &mut [f32]) {
    row.fill(0.0);
    let rows = source[first * row.len()..].chunks_exact(row.len());
    for (&weight, source) in weights.iter().zip(rows) {
        for (sum, &value) in row.iter_mut().zip(source) {
            *sum += weight * f32::from(value);
        }
    }
}

/// Sets each pixel of `out` to its weighted sum of pixels of `row`, rounded to 8 bits.
fn mix_columns(row: &[[f32; 4]], columns: &Table, out: &mut [[u8; 4]]) {
    for (x, pixel) in out.iter_mut().enumerate() {
        let (first, weights) = columns.taps(x);
        let mut sum = [0.5_f32; 4];
        for (&weight, source) in weights.iter().zip(&row[first..]) {
            for (sum, &value) in sum.iter_mut().zip(source) {
                *sum += weight * value;
            }
        }
        // The cast saturates: it clamps the overshoot at edges.
        *pixel = sum.map(|v| v as u8);
    }
}

/// Filter weights of every output position along one axis.
#[derive(Debug)]
pub(super) struct Table {
    /// Weights per position.
    pub(super) width: usize,
    first: Vec<u32>,
    weights: Vec<f32>,
}

impl Table {
    pub(super) fn new(from: u32, to: u32, filter: Filter) -> Result<Self> {
        if from == to {
            // Every kernel is 0 at whole distances.
            let mut first = zeroed(to as usize)?;
            first.iter_mut().zip(0..).for_each(|(first, i)| *first = i);
            let mut weights = zeroed(to as usize)?;
            weights.fill(1.0);
            return Ok(Self { width: 1, first, weights });
        }
        let ratio = f64::from(from) / f64::from(to);
        let stretch = ratio.max(1.0);
        let reach = filter.radius() * stretch;
        // At most the whole axis: weights outside it are added to the edge pixel.
        let width = ((2.0 * reach).ceil() as usize + 1).min(from as usize);
        let mut table = Self { width, first: zeroed(to as usize)?, weights: zeroed(to as usize * width)? };

        for (i, (first, weights)) in table.first.iter_mut().zip(table.weights.chunks_exact_mut(width)).enumerate() {
            let centre = (i as f64 + 0.5) * ratio - 0.5;
            let (low, high) = ((centre - reach).ceil() as i64, (centre + reach).floor() as i64);
            let start = low.clamp(0, i64::from(from) - width as i64);
            *first = start as u32;

            let kernel = |at: i64| filter.weight((at as f64 - centre) / stretch);
            let total: f64 = (low..=high).map(kernel).sum();
            for at in low..=high {
                let tap = at.clamp(0, i64::from(from) - 1) - start;
                weights[tap as usize] += (kernel(at) / total) as f32;
            }
        }
        Ok(table)
    }

    /// The first source position of output position `i`, and the weights from there on.
    pub(super) fn taps(&self, i: usize) -> (usize, &[f32]) {
        (self.first[i] as usize, &self.weights[i * self.width..(i + 1) * self.width])
    }
}

#[cfg(test)]
mod tests;
