//! Seeded changes of a fuzz target's inputs, for tests that run on every change.

/// Pseudo-random mutations (SplitMix64).
pub struct Mutator(pub u64);

impl Mutator {
    /// A number below `below`.
    fn next(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) % below.max(1) as u64) as usize
    }

    /// A seed with one to three changes, some of them parts of other seeds.
    pub fn mutate(&mut self, seed: &[u8], others: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = seed.to_vec();
        for _ in 0..=self.next(3) {
            let (a, b) = (self.next(bytes.len() + 1), self.next(bytes.len() + 1));
            let (low, high) = (a.min(b), a.max(b));
            match self.next(6) {
                0 if low < bytes.len() => bytes[low] = self.next(256) as u8,
                1 => drop(bytes.drain(low..high.min(low + 16))),
                2 => bytes.truncate(high),
                3 => bytes.insert(low, self.next(256) as u8),
                4 => {
                    let part = bytes[low..high.min(low + 64)].to_vec();
                    bytes.splice(low..low, part);
                }
                _ => {
                    let other = &others[self.next(others.len())];
                    let from = self.next(other.len());
                    let part = other[from..other.len().min(from + 40)].to_vec();
                    bytes.splice(low..low, part);
                }
            }
        }
        bytes
    }
}
