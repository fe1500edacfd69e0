//! Colours at a time after the current anchor. In: that anchor, its segments and those of the time. Out: the picture, and the pixels that the anchor
//! does not show.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::super::colour::Colour;
use super::super::kernels::{BLOCK, Level, Source, TILE};
use super::super::layer::{HOLE, alike, is_nearer, part};
use super::super::perspective::Way;
use super::render::{Rendered, select};
use super::tiles::{Segment, Segments, inside};
use crate::Raster;
use crate::tasks::{Parallel, ParallelSliceMut};

/// What a picture is made of.
pub(super) struct After<'a, P> {
    pub(super) level: Level,
    pub(super) current: Source<'a, P>,
    /// Segments of the picture.
    pub(super) shown: &'a Segments,
    /// Segments of the current anchor.
    pub(super) field: &'a Segments,
    /// From the current anchor to the picture.
    pub(super) way: Way,
}

impl<P: Colour> After<'_, P> {
    /// Writes the picture, and in `hidden`, a mask for each tile, the pixels that the anchor does not show.
    pub(super) fn render(&self, out: &mut Raster<P>, hidden: &mut [u64]) -> Rendered {
        let grid = self.shown.grid;
        let (uncovered, unseen) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let rows = out.pixels_mut().par_chunks_mut(grid.width * TILE);
        rows.zip(hidden.par_chunks_mut(grid.columns)).enumerate().for_each(|(row, (pixels, hidden))| {
            let black = [P::OPAQUE_BLACK; BLOCK];
            let (mut samples, mut result) = (black, black);
            let (mut loose, mut lost) = (0, 0);
            for (column, hidden) in hidden.iter_mut().enumerate() {
                let (tile, corner) = (row * grid.columns + column, [column * TILE, row * TILE]);
                let [across, down] = grid.extent(column, row);
                let inside = inside([across, down]);
                let pixels = &mut pixels[column * TILE..];
                *hidden = 0;
                if self.shown.is_whole(tile) && self.shown.first(tile).mark != HOLE && inside == u64::MAX {
                    P::tile_of_one(
                        self.level,
                        self.current,
                        self.place(self.shown.first(tile), corner),
                        pixels,
                        grid.width,
                    );
                    continue;
                }
                for segment in self.shown.of(tile) {
                    let mask = segment.mask & inside;
                    if mask == 0 {
                        continue;
                    }
                    let at = self.place(segment, corner);
                    P::tile_of_one(self.level, self.current, at, &mut samples, TILE);
                    select(self.level, mask, &samples, &mut result);
                    if segment.mark == HOLE {
                        loose += mask.count_ones() as usize;
                        *hidden |= mask & self.covered(segment, at);
                    }
                }
                lost += hidden.count_ones() as usize;
                for j in 0..down {
                    pixels[j * grid.width..][..across].copy_from_slice(&result[j * TILE..][..across]);
                }
            }
            uncovered.fetch_add(loose, Ordering::Relaxed);
            unseen.fetch_add(lost, Ordering::Relaxed);
        });
        Rendered { uncovered: uncovered.into_inner(), hidden: unseen.into_inner() }
    }

    /// Where the anchor shows the first pixel of a tile that moves like `segment`, in 1/64 px.
    fn place(&self, segment: &Segment, corner: [usize; 2]) -> [i32; 2] {
        let reach = self.way.reach_of_tile(segment.key(), corner);
        std::array::from_fn(|c| 64 * corner[c] as i32 + part(segment.vector[c], -reach))
    }

    /// Pixels of a tile where the anchor has something in front of `segment`, which would be seen twice.
    fn covered(&self, segment: &Segment, at: [i32; 2]) -> u64 {
        let key = segment.key();
        self.field.matching(at.map(|v| (v + 32) >> 6), |shown| !alike(shown.key(), key) && is_nearer(shown.key(), key))
    }
}
