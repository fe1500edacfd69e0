//! Detection of foreground that leaves the picture.
//!
//! A near object that a border of the previous anchor cuts off may be outside the current one, which then has no motion
//! for it: the background that it covered seems visible all the time. Its colours in the previous anchor are outliers
//! (see [`is_colour_outlier`]), and since it is gone, it moved at least by its extent in the picture.

use super::colour::Colour;
use super::colour_outlier::is_colour_outlier;
use super::kernels::Source;
use super::key_buffer::KeyBuffer;
use super::resize;
use super::splat_key::{self, EMPTY, Key, MAX_COMPONENT, PREVIOUS_ONLY};
use crate::Result;
use crate::tasks::{Parallel, ParallelSliceMut};

/// Largest number of consecutive pixels of the object that are no colour outliers.
const MAX_GAP: usize = 6;
/// At least one in this many of its pixels is an outlier.
const PIXELS_PER_OUTLIER: usize = 3;
/// Largest luma difference between a hole and the object's last pixel if both belong to it.
const SIMILAR_LUMA: f32 = 16.0;
/// Smallest extent of an object, in pixels of its longest line.
const MIN_LENGTH: usize = 3;
/// Lines without outliers are bridged if position are fewer than this.
const MAX_LINE_GAP: usize = 8;
/// Objects are searched in this fraction (1/n) of a line from each end.
const LENGTH_DIVISOR: usize = 8;
/// Depth keys by which the object is in front of its background: half the distance.
const DEPTH_KEY_STEP: u16 = 2048;

/// Pixels at one end of a row or column that foreground covers.
#[derive(Debug, Clone, Copy)]
struct BorderRun {
    len: usize,
    key: Key,
}

const NONE: BorderRun = BorderRun { len: 0, key: EMPTY };

/// Foreground at the borders; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct BorderForeground {
    size: [usize; 2],
    /// At the left and right end of each row, then at the top and bottom end of each column.
    runs: Vec<[BorderRun; 2]>,
}

impl BorderForeground {
    /// Allocates for a picture size.
    pub(super) fn reserve(&mut self, size: [usize; 2]) -> Result<()> {
        self.size = size;
        resize(&mut self.runs, size[0] + size[1], [NONE; 2])
    }

    /// Scans the borders of the previous anchor and removes the keys of pixels that such foreground covers. `margin` as
    /// of [`colour_outlier::margin`](super::colour_outlier::margin). Objects are extended by `edge_width` pixels, whose
    /// colours are mixed with the background's.
    pub(super) fn detect<P: Colour>(
        &mut self,
        previous_keys: &mut KeyBuffer,
        previous: Source<'_, P>,
        current: Source<'_, P>,
        margin: f32,
        edge_width: usize,
    ) -> Result<()> {
        let size = [previous.width, previous.height];
        self.reserve(size)?;
        let scan = BorderScan { previous_keys, previous, current, margin };
        let (rows, columns) = self.runs.split_at_mut(size[1]);
        for (axis, lines) in [&mut *rows, &mut *columns].into_iter().enumerate() {
            lines.par_iter_mut().with_min_len(64).enumerate().for_each(|(line, runs)| {
                *runs = [false, true].map(|is_far| scan.run(line, axis, is_far));
            });
        }
        for (axis, lines) in [rows, columns].into_iter().enumerate() {
            for end in 0..2 {
                join_runs(lines, end, axis, edge_width);
                for (line, runs) in lines.iter().enumerate() {
                    for step in 0..runs[end].len {
                        let [x, y] = pixel_at(size, line, axis, end == 1, step);
                        previous_keys.clear_pixel(x, y);
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether a tile may contain such pixels.
    pub(super) fn may_touch(&self, [x, y]: [usize; 2], [across, down]: [usize; 2]) -> bool {
        let [width, height] = self.size;
        let is_near = |runs: &[[BorderRun; 2]], first: usize, rest: usize| {
            runs.iter().any(|[near, far]| first < near.len || rest < far.len)
        };
        is_near(&self.runs[y..y + down], x, width - x - across)
            || is_near(&self.runs[height + x..height + x + across], y, height - y - down)
    }

    /// Key of the foreground at a pixel, if position is any.
    pub(super) fn key_at(&self, x: usize, y: usize) -> Option<Key> {
        let [width, height] = self.size;
        let ends = [(&self.runs[y], [x, width - 1 - x]), (&self.runs[height + x], [y, height - 1 - y])];
        ends.into_iter().find_map(|(runs, steps)| (0..2).find(|&i| steps[i] < runs[i].len).map(|i| runs[i].key))
    }
}

/// Pixel number `step` from an end of a row (axis 0) or column (axis 1).
fn pixel_at(size: [usize; 2], line: usize, axis: usize, is_far: bool, step: usize) -> [usize; 2] {
    let along = if is_far { size[axis] - 1 - step } else { step };
    if axis == 0 { [along, line] } else { [line, along] }
}

/// Joins the runs of adjacent lines into objects. An object moves by its longest run.
fn join_runs(lines: &mut [[BorderRun; 2]], end: usize, axis: usize, edge_width: usize) {
    let mut start = 0;
    while start < lines.len() {
        let mut longest = lines[start][end].len;
        if longest == 0 {
            start += 1;
            continue;
        }
        let mut until = start + 1;
        let mut line = until;
        while line < lines.len() && line - until < MAX_LINE_GAP {
            let after = lines[line][end];
            if after.len > 0 {
                let before = lines[until - 1][end];
                let between = if before.len < after.len { before } else { after };
                lines[until..line].iter_mut().for_each(|ends| ends[end] = between);
                until = line + 1;
                longest = longest.max(after.len);
            }
            line += 1;
        }
        let distance = 64 * (longest + edge_width) as i32;
        for run in lines[start..until].iter_mut().map(|ends| &mut ends[end]) {
            let mut vector = splat_key::vector(run.key);
            vector[axis] = if end == 1 { vector[axis].min(-distance) } else { vector[axis].max(distance) };
            let key = splat_key::pack(splat_key::depth_key(run.key), PREVIOUS_ONLY, vector);
            *run = if longest < MIN_LENGTH { NONE } else { BorderRun { key, ..*run } };
        }
        start = until;
    }
}

/// A scan along the borders of the previous anchor.
struct BorderScan<'a, P> {
    previous_keys: &'a KeyBuffer,
    previous: Source<'a, P>,
    current: Source<'a, P>,
    margin: f32,
}

impl<P: Colour> BorderScan<'_, P> {
    /// The run at one end of a line, with the background's motion.
    fn run(&self, line: usize, axis: usize, is_far: bool) -> BorderRun {
        let size = [self.previous.width, self.previous.height];
        let (mut len, mut outliers, mut gap, mut last, mut background) = (0, 0, 0, 0.0, EMPTY);
        for step in 0..(size[axis] / LENGTH_DIVISOR).min(MAX_COMPONENT as usize / 64) {
            let [x, y] = pixel_at(size, line, axis, is_far, step);
            let (own, colour) = (self.previous_keys.own_key(x, y), self.previous.pixels[y * size[0] + x]);
            if own == EMPTY {
                if len == step && step > 0 && (colour.luma() - last).abs() <= SIMILAR_LUMA {
                    (len, last) = (step + 1, colour.luma());
                }
                continue;
            }
            let vector = splat_key::vector(own);
            // Background that enters the picture here was not covered before.
            let outward = if is_far { -vector[axis] } else { vector[axis] };
            if outward < -32 {
                break;
            }
            let position = [64 * x as i32 - vector[0], 64 * y as i32 - vector[1]];
            if is_colour_outlier(colour, self.current, position, self.margin) {
                (len, gap, last, background) = (step + 1, 0, colour.luma(), own);
                outliers += 1;
            } else {
                gap += 1;
                if gap > MAX_GAP {
                    break;
                }
            }
        }
        if outliers * PIXELS_PER_OUTLIER < len || len == 0 {
            return NONE;
        }
        BorderRun {
            len,
            key: splat_key::pack(
                splat_key::depth_key(background).saturating_sub(DEPTH_KEY_STEP),
                PREVIOUS_ONLY,
                splat_key::vector(background),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::key_buffer::Grid;
    use super::super::splat_key::{self, is_in_front};
    use super::*;

    const SIZE: [usize; 2] = [64, 24];
    const GROUND: [u8; 4] = [90, 100, 110, 255];
    const FRONT: [u8; 4] = [220, 40, 200, 255];

    /// Border foreground and remaining keys of a static ground that `is_covered` in the previous anchor only.
    fn found(edge_width: usize, is_covered: impl Fn(usize, usize) -> bool) -> (BorderForeground, KeyBuffer) {
        let [width, height] = SIZE;
        let pixel = |i: usize| if is_covered(i % width, i / width) { FRONT } else { GROUND };
        let previous: Vec<_> = (0..width * height).map(pixel).collect();
        let current = vec![GROUND; width * height];
        let mut previous_keys = KeyBuffer::default();
        previous_keys.reserve(Grid::new((width as u32, height as u32))).unwrap();
        previous_keys.tiles.iter_mut().for_each(|tile| tile.key = splat_key::pack(5000, 0, [0; 2]));
        let mut border = BorderForeground::default();
        let [previous, current] = [&previous, &current].map(|pixels| Source { pixels, width, height });
        border.detect(&mut previous_keys, previous, current, 24.0, edge_width).unwrap();
        (border, previous_keys)
    }

    #[test]
    fn foreground_moves_out_of_the_picture_completely() {
        // Five pixels wide; three in one line and none in another.
        let (border, previous_keys) = found(0, |x, y| match y {
            4..8 | 10..16 => x >= 59,
            8 => x >= 61,
            _ => false,
        });
        for y in 0..24 {
            let len = match y {
                4..8 | 10..16 => 5,
                8 | 9 => 3,
                _ => 0,
            };
            for x in 0..64 {
                let key = border.key_at(x, y);
                assert_eq!(key.is_some(), x >= 64 - len, "({x}, {y})");
                assert_eq!(previous_keys.own_key(x, y) == EMPTY, key.is_some(), "({x}, {y})");
                if let Some(key) = key {
                    assert_eq!((splat_key::vector(key), splat_key::tag(key)), ([-5 * 64, 0], PREVIOUS_ONLY));
                    assert!(is_in_front(key, splat_key::pack(5000, 0, [0; 2])));
                }
            }
        }
        let holes: usize = previous_keys.tiles.iter().map(|tile| usize::from(tile.holes)).sum();
        assert_eq!(holes, 10 * 5 + 2 * 3);
    }

    #[test]
    fn foreground_leaves_over_the_border_that_cuts_it_off() {
        let (border, _) = found(1, |x, y| y < 3 && (20..30).contains(&x));
        assert_eq!(border.key_at(25, 1).map(splat_key::vector), Some([0, 4 * 64]));
        let (border, _) = found(1, |x, y| y >= 21 && (20..30).contains(&x));
        assert_eq!(border.key_at(25, 22).map(splat_key::vector), Some([0, -4 * 64]));
        let (border, _) = found(1, |x, y| x < 4 && (5..9).contains(&y));
        assert_eq!(border.key_at(3, 7).map(splat_key::vector), Some([5 * 64, 0]));
    }

    #[test]
    fn foreground_inside_or_too_narrow_is_ignored() {
        for previous_keys in
            [found(1, |x, y| (40..50).contains(&x) && (6..12).contains(&y)).1, found(1, |x, y| x >= 62 && y == 7).1]
        {
            assert!((0..24).all(|y| (0..64).all(|x| previous_keys.own_key(x, y) != EMPTY)));
        }
    }
}
