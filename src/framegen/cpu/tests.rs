//! What every generator must do, on scenes whose in-between pictures are known.

mod bounds;
mod oracle;
mod reference;
mod scenes;
pub(super) mod world;

use super::CpuGenerator as Generator;

/// Pixels of a box without depth whose colours fit another place by chance.
const BY_CHANCE: usize = 0;
/// Mean difference of a rotated picture, in levels.
const ROTATED: f64 = 0.75;
