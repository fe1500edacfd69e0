//! The steps of a frame as dispatches.

use super::kernels::Kernels;
use super::layout::{Constants, Layout};
use crate::gpu::compute::{CommandRecorder, Kernel, Table};

/// Threads per group over splat pixels.
const SPLAT_PIXELS: u32 = 1024;
/// Side of the square of tiles whose colours one group computes, in tiles.
const SQUARE: u32 = 16;
/// Side of a thread group over a reduced picture, in threads.
const GROUP: u32 = 8;
/// Columns that one group reads.
const COLUMNS: u32 = 8;

/// A frame with all resources bound.
pub(super) struct Steps<'f, 'g> {
    pub(super) frame: &'f mut CommandRecorder<'g>,
    pub(super) table: &'f Table,
    pub(super) kernels: &'f Kernels,
    pub(super) layout: &'f Layout,
}

impl Steps<'_, '_> {
    /// Dispatches a shader with the bindings of the frame.
    fn dispatch(&mut self, kernel: &Kernel, constants: Constants, groups: [u32; 3]) {
        self.frame.dispatch(self.table, kernel, &constants.words(), groups);
    }

    /// Dispatches one group per tile.
    pub(super) fn per_tile(&mut self, kernel: &Kernel, constants: Constants) {
        let [across, down] = constants.tiles;
        self.dispatch(kernel, constants, [across, down, 1]);
    }

    /// Dispatches one group per row, and one per eight columns.
    pub(super) fn per_line(&mut self, kernel: &Kernel, constants: Constants) {
        let [width, height] = constants.size;
        self.dispatch(kernel, constants, [height + width.div_ceil(COLUMNS), 1, 1]);
    }

    /// Dispatches one group.
    pub(super) fn once(&mut self, kernel: &Kernel, constants: Constants) {
        self.dispatch(kernel, constants, [1, 1, 1]);
    }

    /// Clears the state of the frame before.
    pub(super) fn begin(&mut self, constants: Constants) {
        self.clear(Constants { run: 0, ..constants });
    }

    /// Clears splat keys and coverage; in run 0 also the results of the frame before.
    fn clear(&mut self, constants: Constants) {
        let groups = self.layout.splat_pixels.div_ceil(u64::from(SPLAT_PIXELS)) as u32;
        self.dispatch(&self.kernels.clear, constants, [groups, 1, 1]);
    }

    /// Detects a cut between the anchors. The second half does its work only if the first half found a possible cut.
    pub(super) fn find_cut(&mut self, constants: Constants) {
        let Layout { blocks, tiny, shifts, .. } = *self.layout;
        let kernels = self.kernels;
        let of_both = |size: [u32; 2]| [size[0].div_ceil(GROUP), size[1].div_ceil(GROUP), 2];
        let run = |run| Constants { run, ..constants };
        self.dispatch(&kernels.reduce, constants, of_both(constants.reduced));
        self.dispatch(&kernels.detail, constants, of_both(constants.reduced));
        self.dispatch(&kernels.match_blocks, run(0), [blocks[0], blocks[1], 1]);
        self.once(&kernels.decide_cut, run(0));
        self.dispatch(&kernels.tiny, constants, of_both(tiny));
        self.dispatch(&kernels.correlate, constants, [shifts[0], shifts[1], 1]);
        self.once(&kernels.global_shift, constants);
        self.dispatch(&kernels.match_blocks, run(1), [blocks[0], blocks[1], 1]);
        self.once(&kernels.decide_cut, run(1));
    }

    /// Splats (forward-warps) pixels, keeps the nearest one at each destination pixel, and closes cracks.
    pub(super) fn splat(&mut self, constants: Constants) {
        let run = |run| Constants { run, ..constants };
        self.clear(run(1));
        self.per_tile(&self.kernels.splat, run(0));
        self.per_tile(&self.kernels.splat, run(1));
        self.per_tile(&self.kernels.resolve, constants);
    }

    /// Fills holes: uncovered pixels inherit motion.
    pub(super) fn fill_holes(&mut self, constants: Constants) {
        self.once(&self.kernels.pyramid, constants);
        self.per_tile(&self.kernels.fill_holes, constants);
    }

    /// Fills pixels that neither anchor shows with surrounding colours.
    pub(super) fn inpaint(&mut self, constants: Constants) {
        let [across, down] = constants.tiles.map(|len| len.div_ceil(SQUARE));
        self.dispatch(&self.kernels.tile_colours, constants, [across, down, 1]);
        self.once(&self.kernels.mean_colour, constants);
        self.per_tile(&self.kernels.inpaint, constants);
    }
}
