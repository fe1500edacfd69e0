//! Every instruction set against the scalar versions, and the scalar versions against their documentation.

mod candidates;
mod ranges;
mod sampling;
mod tile_keys;

use super::*;

/// Pseudo-random numbers, the same in every run: SplitMix64.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number from 0 to `end` - 1.
    fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }
}

#[test]
fn the_best_instruction_set_is_available() {
    let levels: Vec<SimdLevel> = SimdLevel::available().collect();
    assert_eq!(levels[..2], [SimdLevel::SCALAR, SimdLevel::PORTABLE]);
    assert!(levels.is_sorted());
    assert_eq!(levels.last(), Some(&SimdLevel::detect()));
}
