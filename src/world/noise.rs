//! The noise a latent starts from: a pure function of seed, latent number and place, the same bits everywhere.
//!
//! SplitMix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", 2014) as a counter: no state is
//! carried from one latent to the next, so a restored rollout continues with the noise it would have had. Normal
//! numbers by Box and Muller (1958), in f64 by the pure-Rust `libm`, rounded once to f32.

use std::f64::consts::TAU;

/// Names the noise of one latent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct NoiseKey {
    /// The rollout's seed.
    pub seed: u64,
    /// The latent's number.
    pub latent: u64,
}

impl NoiseKey {
    /// See [`fill_noise`].
    pub fn fill(self, out: &mut [f32]) {
        fill_noise(self.seed, self.latent, out);
    }
}

/// The odd increment of SplitMix64: 2^64 over the golden ratio.
const GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// The output function of SplitMix64; a bijection.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Where a latent's sequence starts. Seed and latent are mixed one after the other, so that seed k + 1 at latent q and
/// seed k at latent q + 1 have nothing in common, and latents of one seed never share a start.
fn origin(seed: u64, latent: u64) -> u64 {
    mix(mix(seed.wrapping_add(GAMMA)).wrapping_add(latent.wrapping_add(1).wrapping_mul(GAMMA)))
}

/// Fills `out` with independent standard normal numbers for latent number `latent` of a rollout with `seed`.
///
/// Element i depends on seed, latent and i alone: a shorter `out` gets a prefix of a longer one. No thread rule.
pub fn fill_noise(seed: u64, latent: u64, out: &mut [f32]) {
    let origin = origin(seed, latent);
    for (pair, elements) in (0u64..).zip(out.chunks_mut(2)) {
        let draw = |n: u64| mix(origin.wrapping_add(pair.wrapping_mul(2).wrapping_add(n).wrapping_mul(GAMMA)));
        let normal = box_muller(draw(1), draw(2));
        elements.copy_from_slice(&normal[..elements.len()]);
    }
}

/// Two standard normal numbers from two words: the upper 53 bits of each, as (0, 1] and [0, 1).
fn box_muller(a: u64, b: u64) -> [f32; 2] {
    const STEP: f64 = 1.0 / (1u64 << 53) as f64;
    let radius = libm::sqrt(-2.0 * libm::log(((a >> 11) + 1) as f64 * STEP));
    let angle = TAU * ((b >> 11) as f64 * STEP);
    [(radius * libm::cos(angle)) as f32, (radius * libm::sin(angle)) as f32]
}
