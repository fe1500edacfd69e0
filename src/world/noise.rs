//! The noise that a latent starts from: a pure function of seed, latent number and element index, with the same bits on all
//! platforms.
//!
//! SplitMix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", 2014) as a counter: no state is carried from
//! one latent to the next, so a restored rollout continues with the same noise. Normal numbers by Box and Muller (1958), in f64
//! with the pure-Rust `libm`, rounded once to f32.

use std::f64::consts::TAU;

/// Selects the noise of one latent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct NoiseKey {
    /// The rollout's seed.
    pub seed: u64,
    /// The latent's number.
    pub latent: u64,
}

impl NoiseKey {
    /// As [`fill_noise`].
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

/// The counter's start for a latent. Seed and latent are mixed one after the other, so that seed k + 1 at latent q and seed k at
/// latent q + 1 have nothing in common, and latents of one seed never share a start.
fn origin(seed: u64, latent: u64) -> u64 {
    mix(mix(seed.wrapping_add(GAMMA)).wrapping_add(latent.wrapping_add(1).wrapping_mul(GAMMA)))
}

/// Fills `out` with independent standard normal numbers for latent number `latent` of a rollout with `seed`.
///
/// Element i depends only on seed, latent and i: a shorter `out` gets a prefix of a longer one. May be called from any thread.
pub fn fill_noise(seed: u64, latent: u64, out: &mut [f32]) {
    let origin = origin(seed, latent);
    for (pair, elements) in (0u64..).zip(out.chunks_mut(2)) {
        let word = |n: u64| mix(origin.wrapping_add(pair.wrapping_mul(2).wrapping_add(n).wrapping_mul(GAMMA)));
        let normal = box_muller(word(1), word(2));
        elements.copy_from_slice(&normal[..elements.len()]);
    }
}

/// Two standard normal numbers from two words, whose upper 53 bits become a number in (0, 1] and one in [0, 1).
fn box_muller(a: u64, b: u64) -> [f32; 2] {
    const STEP: f64 = 1.0 / (1u64 << 53) as f64;
    let radius = libm::sqrt(-2.0 * libm::log(((a >> 11) + 1) as f64 * STEP));
    let angle = TAU * ((b >> 11) as f64 * STEP);
    [(radius * libm::cos(angle)) as f32, (radius * libm::sin(angle)) as f32]
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    fn noise(seed: u64, latent: u64, len: usize) -> Vec<f32> {
        let mut out = vec![0.0; len];
        fill_noise(seed, latent, &mut out);
        out
    }

    /// The values come from a second implementation (Python integers and the C library's functions).
    #[test]
    fn noise_has_the_golden_bits() {
        let golden: [(u64, u64, [u32; 6]); 5] = [
            (0, 0, [0x3ffa_3c9a, 0xbeb7_c44f, 0x3fa7_ae11, 0xbf6b_6081, 0xbeba_5d1e, 0x3f56_ff09]),
            (0, 1, [0xbfa6_7bc6, 0xbfa6_adfd, 0x3fa0_41f7, 0xbd98_7e22, 0xbf90_23bb, 0x3f6d_923e]),
            (1, 0, [0x3f57_95b2, 0xbe1a_9958, 0x3ee7_2835, 0xbf9c_c62f, 0x3f4e_a8eb, 0xbf97_4bb3]),
            (2026, 225, [0xbec9_69d3, 0x3f0d_2dd4, 0x3f68_4e06, 0xbe95_42a6, 0xbf67_535b, 0x3e7d_2faa]),
            (u64::MAX, u64::MAX, [0x3f1e_9389, 0x3f97_0f3f, 0xbee0_3013, 0x4005_43fa, 0x3e7e_dc7a, 0xc01b_eae2]),
        ];
        for (seed, latent, bits) in golden {
            assert_eq!(noise(seed, latent, 6).iter().map(|x| x.to_bits()).collect::<Vec<_>>(), bits);
        }
    }

    /// The checksum of a whole 720p latent: every bit of 65,536 numbers.
    #[test]
    fn a_whole_latent_has_the_golden_checksum() {
        let sum = noise(7, 42, 32 * 32 * 64).iter().fold(0u64, |sum, x| mix(sum ^ u64::from(x.to_bits())));
        assert_eq!(sum, 2_238_420_718_459_186_604);
    }

    #[test]
    fn moments_are_those_of_a_normal_distribution() {
        for (seed, latent) in [(0, 0), (0, 1), (1, 0), (12_345, 678)] {
            let x = noise(seed, latent, 65_536);
            let moment = |power: i32| x.iter().map(|v| f64::from(*v).powi(power)).sum::<f64>() / x.len() as f64;
            // Five standard errors each: 1/256, sqrt(2)/256, sqrt(15)/256, sqrt(96)/256.
            assert!(moment(1).abs() < 0.02, "{}", moment(1));
            assert!((moment(2) - 1.0).abs() < 0.028, "{}", moment(2));
            assert!(moment(3).abs() < 0.076, "{}", moment(3));
            assert!((moment(4) - 3.0).abs() < 0.192, "{}", moment(4));
            let outside = x.iter().filter(|v| v.abs() > 1.959_964).count() as f64 / x.len() as f64;
            assert!((outside - 0.05).abs() < 0.0043, "{outside}");
            assert!(x.iter().all(|v| v.is_finite()));
        }
    }

    fn correlation(a: &[f32], b: &[f32]) -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>() / a.len().min(b.len()) as f64
    }

    #[test]
    fn elements_are_independent_of_their_neighbours() {
        let x = noise(3, 4, 65_537);
        let squares: Vec<f32> = x.iter().map(|v| (v * v - 1.0) / std::f32::consts::SQRT_2).collect();
        for lag in [1, 2, 3, 64, 2048] {
            assert!(correlation(&x[lag..], &x).abs() < 0.02, "lag {lag}");
            assert!(correlation(&squares[lag..], &squares).abs() < 0.02, "lag {lag}");
        }
    }

    #[test]
    fn neighbouring_seeds_and_latents_are_uncorrelated() {
        let keys: Vec<(u64, u64)> = (0..6).flat_map(|seed| (0..6).map(move |latent| (seed, latent))).collect();
        let all: Vec<Vec<f32>> = keys.iter().map(|(seed, latent)| noise(*seed, *latent, 16_384)).collect();
        for i in 0..all.len() {
            for j in 0..i {
                let c = correlation(&all[i], &all[j]);
                assert!(c.abs() < 5.0 / 128.0, "{:?} and {:?}: {c}", keys[i], keys[j]);
                // Nor is one sequence the other shifted by a few pairs.
                for lag in [1, 2, 4] {
                    assert!(correlation(&all[i][lag..], &all[j]).abs() < 5.0 / 128.0);
                    assert!(correlation(&all[j][lag..], &all[i]).abs() < 5.0 / 128.0);
                }
            }
        }
    }

    #[test]
    fn latents_have_different_counter_starts() {
        let mut seen = HashSet::new();
        for seed in (0..300).chain([2026, u64::MAX]) {
            for latent in 0..300 {
                assert!(seen.insert(origin(seed, latent)), "seed {seed}, latent {latent}");
            }
        }
    }

    #[test]
    fn a_shorter_buffer_gets_a_prefix() {
        let long = noise(5, 6, 33);
        for len in 0..33 {
            assert_eq!(noise(5, 6, len), long[..len]);
        }
        let mut out = [0.0; 3];
        NoiseKey { seed: 5, latent: 6 }.fill(&mut out);
        assert_eq!(out, long[..3]);
    }

    #[test]
    fn the_extreme_words_give_finite_numbers() {
        for a in [0, 1, u64::MAX] {
            for b in [0, 1, u64::MAX] {
                assert!(box_muller(a, b).iter().all(|x| x.is_finite() && x.abs() < 8.6));
            }
        }
    }
}
