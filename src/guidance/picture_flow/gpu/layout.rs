//! Root constants of the extraction shaders, and the layout of their working buffer.

use super::super::grid::{SAMPLES, STRIDE, WIDE_STRIDE};
use super::super::pyramid::{LARGE, SHORT};

/// Directions: backward flow (the output) and forward flow (for the check).
const DIRECTIONS: usize = 2;
/// Bytes of a patch's search result.
const FOUND: u64 = 32;
/// Bytes of a motion vector.
const VECTOR: u64 = 8;
/// Bytes of a global motion model.
const MODEL: u64 = 48;

/// Root constants of every extraction shader; order and meaning are those of `flow.hlsli`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Constants {
    pub(super) size: [u32; 2],
    pub(super) level: [u32; 2],
    pub(super) finer_level: [u32; 2],
    pub(super) checked_level: [u32; 2],
    pub(super) cells: [u32; 2],
    pub(super) coarse_cells: [u32; 2],
    pub(super) depth_size: [u32; 2],
    pub(super) at_luma: [u32; 2],
    pub(super) at_finer_luma: [u32; 2],
    pub(super) at_found: [u32; 2],
    pub(super) at_flow: [u32; 2],
    pub(super) at_source: [u32; 2],
    pub(super) at_target: [u32; 2],
    pub(super) at_coarse_flow: [u32; 2],
    pub(super) at_model: [u32; 2],
    pub(super) at_dense: [u32; 2],
    pub(super) at_trusted: u32,
    pub(super) stride: u32,
    pub(super) coarse_stride: u32,
    pub(super) direction: u32,
    pub(super) halvings: u32,
    pub(super) checked_halvings: u32,
    pub(super) is_halved: u32,
    pub(super) is_again: u32,
    pub(super) is_source: u32,
    pub(super) rounds: u32,
    pub(super) halo: u32,
    pub(super) step: u32,
    pub(super) is_float: u32,
    pub(super) is_linear: u32,
}

/// Number of 32-bit words in [`Constants`].
pub(super) const WORDS: usize = 46;

impl Constants {
    /// The words in the shaders' order.
    pub(super) fn words(&self) -> [u32; WORDS] {
        let pairs = [
            self.size,
            self.level,
            self.finer_level,
            self.checked_level,
            self.cells,
            self.coarse_cells,
            self.depth_size,
            self.at_luma,
            self.at_finer_luma,
            self.at_found,
            self.at_flow,
            self.at_source,
            self.at_target,
            self.at_coarse_flow,
            self.at_model,
            self.at_dense,
        ];
        let singles = [
            self.at_trusted,
            self.stride,
            self.coarse_stride,
            self.direction,
            self.halvings,
            self.checked_halvings,
            self.is_halved,
            self.is_again,
            self.is_source,
            self.rounds,
            self.halo,
            self.step,
            self.is_float,
            self.is_linear,
        ];
        let mut words = [0; WORDS];
        words.iter_mut().zip(pairs.into_iter().flatten().chain(singles)).for_each(|(to, word)| *to = word);
        words
    }
}

/// One pyramid level and its patch grids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Level {
    /// In pixels.
    pub(super) size: [u32; 2],
    /// Offset of each picture's luma, on levels that have it.
    pub(super) at_luma: [u32; 2],
    /// Patch stride in pixels.
    pub(super) stride: u32,
    /// Patches across and down.
    pub(super) cells: [u32; 2],
    pub(super) at_found: [u32; 2],
    pub(super) at_flow: [u32; 2],
    /// Sampling stride of the global model, in cells.
    pub(super) step: u32,
}

/// Layout of the working buffer for one picture size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) levels: Vec<Level>,
    /// Finest level with luma; in a large picture level 0 has none.
    pub(super) first: usize,
    /// Finest level that is searched.
    pub(super) finest: usize,
    /// Finest level of the forward flow.
    pub(super) checked: usize,
    /// Offsets of the second buffer for smoothing passes.
    pub(super) at_next: [u32; 2],
    pub(super) at_model: [u32; 2],
    pub(super) at_dense: [u32; 2],
    pub(super) at_trusted: u32,
    /// Total size in bytes.
    pub(super) bytes: u64,
}

fn area([across, down]: [u32; 2]) -> u64 {
    u64::from(across) * u64::from(down)
}

impl Layout {
    /// The levels are the same as in the CPU's pyramid.
    pub(super) fn new((width, height): (u32, u32)) -> Self {
        let is_short = |size: [u32; 2]| (size[0].min(size[1]) as usize) < SHORT;
        let mut levels = vec![Level { size: [width, height], ..Level::default() }];
        while let Some(last) = levels.last().filter(|last| !is_short(last.size)) {
            levels.push(Level { size: last.size.map(|len| len.div_ceil(2)), ..Level::default() });
        }
        let fits = |level: &Level| area(level.size) <= LARGE as u64;
        let first = usize::from(!fits(&levels[0]) && levels.len() > 1);
        let finest = levels.iter().position(fits).unwrap_or(levels.len() - 1);
        let checked = if finest > 0 { (finest + 1).min(levels.len() - 1) } else { 0 };

        let mut end = 0_u64;
        let mut take = |bytes: u64| {
            let start = end;
            end += bytes.next_multiple_of(16);
            // Offsets may wrap beyond 4 GiB: the caller refuses such sizes.
            start as u32
        };
        for (number, level) in levels.iter_mut().enumerate().skip(first) {
            level.at_luma = [0; DIRECTIONS].map(|_| take(4 * area(level.size)));
            if number < finest {
                continue;
            }
            level.stride = if number > 0 && number == finest { WIDE_STRIDE as u32 } else { STRIDE as u32 };
            level.cells = level.size.map(|len| len.div_ceil(level.stride));
            let samples = |step: &u32| area(level.cells.map(|len| len.div_ceil(*step))) <= SAMPLES as u64;
            level.step = (1..).find(samples).unwrap_or(1);
            for direction in 0..if number < checked { 1 } else { DIRECTIONS } {
                level.at_found[direction] = take(FOUND * area(level.cells));
                level.at_flow[direction] = take(VECTOR * area(level.cells));
            }
        }
        // The largest grid: on the finest level or, where that has the larger stride, on the next.
        let most = levels.iter().map(|level| area(level.cells)).max().unwrap_or(0);
        Self {
            at_next: [0; DIRECTIONS].map(|_| take(VECTOR * most)),
            at_model: [0; DIRECTIONS].map(|_| take(MODEL)),
            at_dense: [finest, checked].map(|level| take(VECTOR * area(levels[level].size))),
            at_trusted: take(4 * area(levels[finest].size)),
            levels,
            first,
            finest,
            checked,
            bytes: end,
        }
    }
}
