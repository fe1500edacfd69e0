//! The steps of a frame as dispatches.

use super::kernels::Kernels;
use super::layout::{Constants, Layout};
use crate::gpu::compute::{CommandRecorder, Kernel, Table};

/// Threads of a group over splat pixels, and over the ends of rows and columns.
const PLACES: u32 = 1024;
const ENDS: u32 = 64;
/// Side of the square of tiles whose colours one group computes, in tiles.
const SQUARE: u32 = 16;
/// Side of a thread group over a reduced picture, in threads.
const GROUP: u32 = 8;
/// Columns per group.
const COLUMNS: u32 = 8;

/// A frame with all resources bound.
pub(super) struct Steps<'f, 'g> {
    pub(super) frame: &'f mut CommandRecorder<'g>,
    pub(super) table: &'f Table,
    pub(super) kernels: &'f Kernels,
    pub(super) layout: &'f Layout,
}

impl Steps<'_, '_> {
    fn run(&mut self, kernel: &Kernel, constants: Constants, groups: [u32; 3]) {
        self.frame.dispatch(self.table, kernel, &constants.words(), groups);
    }

    /// Dispatches one group per tile.
    pub(super) fn by_tiles(&mut self, kernel: &Kernel, constants: Constants) {
        let [across, down] = constants.tiles;
        self.run(kernel, constants, [across, down, 1]);
    }

    /// Dispatches one group per row, and one per eight columns.
    pub(super) fn by_lines(&mut self, kernel: &Kernel, constants: Constants) {
        let [width, height] = constants.size;
        self.run(kernel, constants, [height + width.div_ceil(COLUMNS), 1, 1]);
    }

    /// Dispatches one thread per end of a row or column.
    pub(super) fn by_ends(&mut self, kernel: &Kernel, constants: Constants) {
        let [width, height] = constants.size;
        self.run(kernel, constants, [(2 * (width + height)).div_ceil(ENDS), 1, 1]);
    }

    /// Dispatches one group.
    pub(super) fn by_one(&mut self, kernel: &Kernel, constants: Constants) {
        self.run(kernel, constants, [1, 1, 1]);
    }

    /// Clears the state of the frame before.
    pub(super) fn begin(&mut self, constants: Constants) {
        self.clear(Constants { turn: 0, ..constants });
    }

    fn clear(&mut self, constants: Constants) {
        let groups = self.layout.places.div_ceil(u64::from(PLACES)) as u32;
        self.run(&self.kernels.begin, constants, [groups, 1, 1]);
    }

    /// Detects a cut between the anchors. The second half does its work only if the first half found a possible cut.
    pub(super) fn find_cut(&mut self, constants: Constants) {
        let Layout { blocks, tiny, shifts, .. } = *self.layout;
        let kernels = self.kernels;
        let of_both = |size: [u32; 2]| [size[0].div_ceil(GROUP), size[1].div_ceil(GROUP), 2];
        let turn = |turn| Constants { turn, ..constants };
        self.run(&kernels.reduce, constants, of_both(constants.reduced));
        self.run(&kernels.detail, constants, of_both(constants.reduced));
        self.run(&kernels.block, turn(0), [blocks[0], blocks[1], 1]);
        self.by_one(&kernels.verdict, turn(0));
        self.run(&kernels.tiny, constants, of_both(tiny));
        self.run(&kernels.shift, constants, [shifts[0], shifts[1], 1]);
        self.by_one(&kernels.whole, constants);
        self.run(&kernels.block, turn(1), [blocks[0], blocks[1], 1]);
        self.by_one(&kernels.verdict, turn(1));
    }

    /// Splats: forward-warps pixels, keeps the nearest one at each destination pixel, and closes cracks.
    pub(super) fn land(&mut self, constants: Constants) {
        let turn = |turn| Constants { turn, ..constants };
        self.clear(turn(1));
        self.by_tiles(&self.kernels.claim, turn(0));
        self.by_tiles(&self.kernels.claim, turn(1));
        self.by_tiles(&self.kernels.settle, constants);
    }

    /// Hole filling: uncovered pixels inherit motion.
    pub(super) fn fill(&mut self, constants: Constants) {
        self.by_one(&self.kernels.pyramid, constants);
        self.by_tiles(&self.kernels.fill, constants);
    }

    /// Fills pixels that neither anchor shows with surrounding colours.
    pub(super) fn paint(&mut self, constants: Constants) {
        let [across, down] = constants.tiles.map(|len| len.div_ceil(SQUARE));
        self.run(&self.kernels.squares, constants, [across, down, 1]);
        self.by_one(&self.kernels.mean, constants);
        self.by_tiles(&self.kernels.paint, constants);
    }
}
