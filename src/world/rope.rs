//! The angles of rotary position embedding: `docs/bundle.md`, section 5.

use std::f64::consts::PI;

use crate::bundle::Geometry;
use crate::{Error, ErrorKind, Result};

/// Cosines and sines of every token of a latent at any RoPE time.
///
/// Angles are made in f64 with the pure-Rust `libm` and rounded to f32: the same bits on every system. The part that
/// depends on the token's place is kept; the part that depends on time is made anew for each latent, so time is
/// unbounded.
#[derive(Debug, Clone)]
pub struct RopeTable {
    tokens: usize,
    /// P, rotation pairs of a head.
    pairs: usize,
    /// `[tokens, P / 2]`: the columns' part, then the rows' part.
    place_cos: Vec<f32>,
    place_sin: Vec<f32>,
    /// `[P / 2]`.
    f_t: Vec<f64>,
}

impl RopeTable {
    /// The table of a world of this geometry.
    ///
    /// # Errors
    /// `InvalidBundle` for a geometry that contradicts itself, `OutOfMemory` when the table does not fit.
    pub fn new(geometry: &Geometry) -> Result<Self> {
        let wrong = |field: &str, cause: String| Error::new(ErrorKind::InvalidBundle, cause).field(field);
        if geometry.head_width == 0 || !geometry.head_width.is_multiple_of(8) {
            return Err(wrong("geometry.head_width", format!("{} is no multiple of 8", geometry.head_width)));
        }
        if geometry.patch.contains(&0) {
            return Err(wrong("geometry.patch", "a patch has no cells".into()));
        }
        let (rows, columns) = geometry.token_grid();
        let tokens = u64::from(rows) * u64::from(columns);
        if tokens == 0 || tokens != u64::from(geometry.tokens) {
            return Err(wrong(
                "geometry.tokens",
                format!("{} tokens do not fill a grid of {rows} x {columns}", geometry.tokens),
            ));
        }
        let rope = geometry.rope;
        if !(rope.nyquist_fraction.is_finite() && rope.time_base.is_finite() && rope.time_base > 0.0) {
            return Err(wrong("geometry.rope", "the constants are not finite and positive".into()));
        }

        let (tokens, pairs) = (geometry.tokens as usize, geometry.head_width as usize / 2);
        let f_xy = spatial_frequencies(pairs / 4, f64::from(rows.min(columns)) * rope.nyquist_fraction);
        assert_eq!(f_xy.len(), pairs / 4);
        let f_t: Vec<f64> =
            (0..pairs / 2).map(|j| libm::pow(rope.time_base, -((2 * (j / 2)) as f64 / (pairs / 2) as f64))).collect();

        let too_large =
            |_| Error::new(ErrorKind::OutOfMemory, "the table of RoPE angles does not fit").field("geometry.tokens");
        let len = tokens.saturating_mul(pairs / 2);
        let (mut place_cos, mut place_sin) = (Vec::new(), Vec::new());
        place_cos.try_reserve_exact(len).map_err(too_large)?;
        place_sin.try_reserve_exact(len).map_err(too_large)?;
        let centre = |index: u32, count: u32| (2.0 * f64::from(index) + 1.0) / f64::from(count) - 1.0;
        for row in 0..rows {
            for column in 0..columns {
                for place in [centre(column, columns), centre(row, rows)] {
                    place_cos.extend(f_xy.iter().map(|f| libm::cos(place * f) as f32));
                    place_sin.extend(f_xy.iter().map(|f| libm::sin(place * f) as f32));
                }
            }
        }
        assert_eq!(place_cos.len(), len);
        Ok(Self { tokens, pairs, place_cos, place_sin, f_t })
    }

    /// Numbers in each of the two outputs of [`RopeTable::fill`]: `tokens * head_width / 2`.
    pub fn len(&self) -> usize {
        self.tokens * self.pairs
    }

    /// Whether there are none; never so.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Writes `rope_cos` and `rope_sin`, each `[tokens, head_width / 2]`, for a latent at RoPE time `time`.
    ///
    /// # Errors
    /// `InvalidArgument` when an output has another length than [`RopeTable::len`].
    pub fn fill(&self, time: u64, cos: &mut [f32], sin: &mut [f32]) -> Result<()> {
        if cos.len() != self.len() || sin.len() != self.len() {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("RoPE angles need {} numbers, the outputs have {} and {}", self.len(), cos.len(), sin.len()),
            )
            .field("rope"));
        }
        let half = self.pairs / 2;
        for (out, place, function) in
            [(cos, &self.place_cos, libm::cos as fn(f64) -> f64), (sin, &self.place_sin, libm::sin as fn(f64) -> f64)]
        {
            let (first, others) = out.split_at_mut(self.pairs);
            for (o, f) in first[half..].iter_mut().zip(&self.f_t) {
                *o = function(time as f64 * f) as f32;
            }
            for (token, row) in others.chunks_exact_mut(self.pairs).enumerate() {
                row[..half].copy_from_slice(&place[(token + 1) * half..][..half]);
                row[half..].copy_from_slice(&first[half..]);
            }
            first[..half].copy_from_slice(&place[..half]);
        }
        Ok(())
    }
}

/// `linspace(1, max_freq / 2, n) * pi`, each value twice, cut to `count`; `n = (count + 1) / 2`.
fn spatial_frequencies(count: usize, max_freq: f64) -> Vec<f64> {
    let n = count.div_ceil(2);
    let step = if n > 1 { (max_freq / 2.0 - 1.0) / (n - 1) as f64 } else { 0.0 };
    (0..count).map(|j| (1.0 + (j / 2) as f64 * step) * PI).collect()
}
