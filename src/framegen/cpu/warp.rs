//! Warps along motion vectors, from an anchor to a time between or after the anchors.
//!
//! A point that moves uniformly in space does not move uniformly on the screen: it gets faster as it comes nearer. With
//! distances `w0` and `w1` from the camera plane in the two anchors, at phase t it is where linear interpolation of its
//! screen position is at phase `t w1 / ((1 - t) w0 + t w1)`.

use super::kernels::TILE;
use super::splat_key::{Key, PHASE_ONE, key_inverse_depth};

/// Phases end three intervals after the previous anchor, so that products with motion vectors fit 32 bits.
const MAX_PHASE: f32 = (3 * PHASE_ONE - 2) as f32;

/// Relative change of distance, `w0 / w1 - 1`, as a linear function of inverse depth and pixel position.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct DepthChange {
    /// Factor of the inverse depth.
    pub(super) inverse_depth: f32,
    /// Gradient along x and y, per pixel.
    pub(super) slope: [f32; 2],
    /// Value at pixel (0, 0) and inverse depth 0.
    pub(super) origin: f32,
    /// Lower bound of the change, at most 0.
    pub(super) min: f32,
    /// Upper bound of the change, at least 0.
    pub(super) max: f32,
}

/// A time between or after the anchors, from which the phase of each pixel of the current anchor follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WarpTime {
    phase: f32,
    /// Rest of the interval, 1 - phase.
    left: f32,
    depth_change: DepthChange,
}

/// A warp from one of the anchors to a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Warp {
    from: i32,
    to: WarpTime,
}

impl DepthChange {
    /// `w0 / w1 - 1` of pixel (x, y).
    #[inline(always)]
    pub(super) fn change(&self, key: Key, [x, y]: [i32; 2]) -> f32 {
        let Self { inverse_depth: per_inverse_depth, slope, origin, min, max } = *self;
        let change =
            per_inverse_depth * key_inverse_depth(key) + (slope[0] * x as f32 + (slope[1] * y as f32 + origin));
        let change = if change < max { change } else { max };
        if change > min { change } else { min }
    }
}

impl WarpTime {
    /// `phase` is relative to the previous anchor, in units of 1 / [`PHASE_ONE`] and at most two intervals.
    pub(super) fn new(phase: i32, depth_change: DepthChange) -> Self {
        Self { phase: phase as f32, left: (PHASE_ONE - phase) as f32 / PHASE_ONE as f32, depth_change }
    }

    /// The time of the previous anchor.
    pub(super) fn previous_anchor() -> Self {
        Self::new(0, DepthChange::default())
    }

    /// Phase at which linear motion reaches the position of pixel (x, y) at this time.
    #[inline(always)]
    pub(super) fn phase(&self, key: Key, at: [i32; 2]) -> i32 {
        // Uniform motion.
        if self.phase == 0.0 || self.depth_change.min >= self.depth_change.max {
            return self.phase as i32;
        }
        self.phase_at(self.depth_change.change(key, at))
    }

    /// Phases of eight adjacent pixels, the first at (x, y).
    #[inline(always)]
    pub(super) fn phases(&self, keys: &[Key; TILE], [x, y]: [i32; 2]) -> [i32; TILE] {
        let mut phases = [0; TILE];
        for i in 0..TILE {
            phases[i] = self.phase(keys[i], [x + i as i32, y]);
        }
        phases
    }

    /// Phase of a uniform tile, taken at its centre.
    #[inline(always)]
    pub(super) fn phase_of_tile(&self, key: Key, corner: [usize; 2]) -> i32 {
        self.phase(key, corner.map(|at| (at + TILE / 2) as i32))
    }

    #[inline(always)]
    fn phase_at(&self, change: f32) -> i32 {
        // Adding 1.5 * 2^23 rounds to the nearest integer, which is then in the low bits.
        const ROUNDING: f32 = 12_582_912.0;
        let phase = self.phase / (1.0 + self.left * change);
        let phase = if phase < MAX_PHASE { phase } else { MAX_PHASE };
        (phase + ROUNDING).to_bits() as i32 - ROUNDING.to_bits() as i32
    }
}

impl Warp {
    pub(super) fn from_current(to: WarpTime) -> Self {
        Self { from: PHASE_ONE, to }
    }

    pub(super) fn from_previous(to: WarpTime) -> Self {
        Self { from: 0, to }
    }

    /// Fraction of its motion vector by which the pixel (x, y) is moved.
    #[inline(always)]
    pub(super) fn fraction(&self, key: Key, at: [i32; 2]) -> i32 {
        self.from - self.to.phase(key, at)
    }

    /// Fractions of eight adjacent pixels, the first at (x, y).
    #[inline(always)]
    pub(super) fn fractions(&self, keys: &[Key; TILE], at: [i32; 2]) -> [i32; TILE] {
        let mut fractions = self.to.phases(keys, at);
        for fraction in &mut fractions {
            *fraction = self.from - *fraction;
        }
        fractions
    }

    /// Fraction of a uniform tile.
    #[inline(always)]
    pub(super) fn fraction_of_tile(&self, key: Key, corner: [usize; 2]) -> i32 {
        self.from - self.to.phase_of_tile(key, corner)
    }

    /// Minimum and maximum fraction of any pixel.
    pub(super) fn fraction_bounds(&self) -> [i32; 2] {
        let ends =
            [self.to.depth_change.min, self.to.depth_change.max].map(|change| self.from - self.to.phase_at(change));
        [ends[0].min(ends[1]), ends[0].max(ends[1])]
    }
}
