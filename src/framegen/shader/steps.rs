//! The steps of a frame as dispatches, in the order that they are called in.

use super::kernels::Kernels;
use super::layout::{Constants, Layout};
use crate::gpu::compute::{CommandRecorder, Kernel, Table};

/// Threads of a group that goes over places, and over the ends of lines.
const PLACES: u32 = 1024;
const ENDS: u32 = 64;
/// Tiles to a side of a square whose colours one group finds.
const SQUARE: u32 = 16;
/// Sides of a group of threads that goes over a small picture.
const GROUP: u32 = 8;
/// Columns that one group looks at.
const COLUMNS: u32 = 8;

/// A frame with everything bound.
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

    /// A group to a tile.
    pub(super) fn by_tiles(&mut self, kernel: &Kernel, constants: Constants) {
        let [across, down] = constants.tiles;
        self.run(kernel, constants, [across, down, 1]);
    }

    /// A group to a row, and to eight columns.
    pub(super) fn by_lines(&mut self, kernel: &Kernel, constants: Constants) {
        let [width, height] = constants.size;
        self.run(kernel, constants, [height + width.div_ceil(COLUMNS), 1, 1]);
    }

    /// A thread to each end of a row or column.
    pub(super) fn by_ends(&mut self, kernel: &Kernel, constants: Constants) {
        let [width, height] = constants.size;
        self.run(kernel, constants, [(2 * (width + height)).div_ceil(ENDS), 1, 1]);
    }

    /// One group.
    pub(super) fn by_one(&mut self, kernel: &Kernel, constants: Constants) {
        self.run(kernel, constants, [1, 1, 1]);
    }

    /// Forgets the frame before.
    pub(super) fn begin(&mut self, constants: Constants) {
        self.clear(Constants { turn: 0, ..constants });
    }

    fn clear(&mut self, constants: Constants) {
        let groups = self.layout.places.div_ceil(u64::from(PLACES)) as u32;
        self.run(&self.kernels.begin, constants, [groups, 1, 1]);
    }

    /// Looks whether a cut lies between the anchors; the second half only where there may be one.
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

    /// Carries claims, lets the nearest have each place, and closes cracks.
    pub(super) fn land(&mut self, constants: Constants) {
        let turn = |turn| Constants { turn, ..constants };
        self.clear(turn(1));
        self.by_tiles(&self.kernels.claim, turn(0));
        self.by_tiles(&self.kernels.claim, turn(1));
        self.by_tiles(&self.kernels.settle, constants);
    }

    /// Lets places that nothing claims borrow.
    pub(super) fn fill(&mut self, constants: Constants) {
        self.by_one(&self.kernels.pyramid, constants);
        self.by_tiles(&self.kernels.fill, constants);
    }

    /// Gives what nothing shows the colours around it.
    pub(super) fn paint(&mut self, constants: Constants) {
        let [across, down] = constants.tiles.map(|len| len.div_ceil(SQUARE));
        self.run(&self.kernels.squares, constants, [across, down, 1]);
        self.by_one(&self.kernels.mean, constants);
        self.by_tiles(&self.kernels.paint, constants);
    }
}
