//! The dispatches of an extraction, in the same order as on the CPU.

use super::super::{ROUNDS, SMALL_LEVEL, grid};
use super::kernels::Kernels;
use super::layout::{Constants, Layout};
use crate::gpu::compute::{CommandRecorder, Kernel, Table};

/// Thread group side for shaders over pixels.
const GROUP: u32 = 8;
/// Patches searched per thread group.
const PATCHES: u32 = 8;
/// Thread group side for shaders over cells.
const SIDE: u32 = 32;
/// Smoothing iterations per pass where the grid does not fit into one group; also the width of the halo that such a group computes.
const PASS: u32 = 4;
/// Number of directions, and of pictures.
const BOTH: u32 = 2;

/// An extraction with all resources bound.
pub(super) struct Steps<'f, 'g> {
    pub(super) frame: &'f mut CommandRecorder<'g>,
    pub(super) table: &'f Table,
    pub(super) kernels: &'f Kernels,
    pub(super) layout: &'f Layout,
    /// Constants that are equal on all levels.
    pub(super) common: Constants,
}

impl Steps<'_, '_> {
    /// Records the whole extraction.
    pub(super) fn run(&mut self) {
        let Layout { first, finest, checked, ref levels, .. } = *self.layout;
        self.dispatch(&self.kernels.luma, self.of(first), levels[first].size, GROUP, BOTH);
        for (number, level) in levels.iter().enumerate().skip(first + 1) {
            self.dispatch(&self.kernels.halve, self.of(number), level.size, GROUP, BOTH);
        }
        for level in (finest..levels.len()).rev() {
            let directions = if level < checked { 1 } else { BOTH };
            self.search(level, 0, directions);
            let [width, height] = levels[level].size;
            let is_small = width as usize * height as usize <= SMALL_LEVEL;
            if is_small {
                self.dispatch(&self.kernels.wide, self.of(level), levels[level].cells, 1, directions);
            }
            self.smooth(level, directions);
            if level == finest {
                continue;
            }
            // The finest level of a direction is searched once.
            let directions = if level > checked { BOTH } else { 1 };
            let rounds = if is_small { ROUNDS } else { 1 };
            for _ in 0..rounds {
                self.fit(level, directions);
                self.search(level, 1, directions);
                self.smooth(level, directions);
            }
            self.fit(level, directions);
        }
        let blocks = |level: usize| levels[level].size;
        if finest == checked {
            self.dispatch(&self.kernels.densify, self.of(finest), blocks(finest), GROUP, BOTH);
        } else {
            self.dispatch(&self.kernels.densify, self.of(finest), blocks(finest), GROUP, 1);
            let forth = Constants { direction: 1, ..self.of(checked) };
            self.dispatch(&self.kernels.densify, forth, blocks(checked), GROUP, 1);
        }
        self.dispatch(&self.kernels.check, self.of(finest), levels[finest].size, GROUP, 1);
        self.dispatch(&self.kernels.fill, self.of(finest), levels[finest].size, GROUP, 1);
        self.dispatch(&self.kernels.write, self.of(finest), self.common.size, GROUP, 1);
    }

    /// Constants of level `number`.
    fn of(&self, number: usize) -> Constants {
        let Layout { first, finest, checked, ref levels, .. } = *self.layout;
        let (level, finer) = (levels[number], levels[number.saturating_sub(1)]);
        let coarser = levels.get(number + 1).copied().unwrap_or_default();
        Constants {
            level: level.size,
            finer_level: finer.size,
            checked_level: levels[checked].size,
            cells: level.cells,
            coarse_cells: coarser.cells,
            at_luma: level.at_luma,
            at_finer_luma: finer.at_luma,
            at_found: level.at_found,
            at_flow: level.at_flow,
            at_coarse_flow: coarser.at_flow,
            stride: level.stride,
            coarse_stride: coarser.stride,
            halvings: number as u32,
            checked_halvings: (checked - finest) as u32,
            is_halved: u32::from(number == first && first > 0),
            step: level.step,
            ..self.common
        }
    }

    fn search(&mut self, level: usize, is_again: u32, directions: u32) {
        let [across, down] = self.layout.levels[level].cells;
        let constants = Constants { is_again, ..self.of(level) };
        self.dispatch(&self.kernels.search, constants, [(across * down).div_ceil(PATCHES), 1], 1, directions);
    }

    fn smooth(&mut self, level: usize, directions: u32) {
        let cells = self.layout.levels[level].cells;
        let all =
            Constants { rounds: grid::ROUNDS as u32, at_target: self.layout.levels[level].at_flow, ..self.of(level) };
        if cells.iter().all(|&len| len <= SIDE) {
            self.dispatch(&self.kernels.smooth, all, cells, SIDE, directions);
            return;
        }
        // An odd number of passes, so that the last writes to `at_flow`.
        let (flow, next) = (all.at_flow, self.layout.at_next);
        for (is_source, at_source, at_target) in [(0, next, flow), (1, flow, next), (1, next, flow)] {
            let pass = Constants { rounds: PASS, halo: PASS, is_source, at_source, at_target, ..all };
            self.dispatch(&self.kernels.smooth, pass, cells, SIDE - 2 * PASS, directions);
        }
    }

    fn fit(&mut self, level: usize, directions: u32) {
        self.dispatch(&self.kernels.fit, self.of(level), [1, 1], 1, directions);
    }

    /// Dispatches enough groups to cover `size`, where each covers `side` x `side`, and `deep` groups in z.
    fn dispatch(&mut self, kernel: &Kernel, constants: Constants, size: [u32; 2], side: u32, deep: u32) {
        let groups = [size[0].div_ceil(side), size[1].div_ceil(side), deep];
        self.frame.dispatch(self.table, kernel, &constants.words(), groups);
    }
}

const _: () = assert!(grid::ROUNDS as u32 == 3 * PASS, "three passes make all rounds");
