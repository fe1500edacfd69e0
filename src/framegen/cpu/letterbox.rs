//! Detection of letterbox and pillarbox bars.

use std::ops::Range;

use super::kernels::{Sampled, SimdLevel, Source};
use crate::tasks;

/// Largest luma range of a bar's row or column over both anchors, in levels.
const MAX_RANGE: u8 = 3;

#[cfg(test)]
crate::shader_constants::shader_constants!("LETTERBOX_": uint MAX_RANGE);

/// Pixels whose luma is computed at a time.
const RUN: usize = 64;
/// Columns that are scanned together, and the number of rows after which a scan may end early.
const COLUMNS: usize = 16;
const CHECK_ROWS: usize = 8;

/// The picture between the bars of two anchors. Bars are rows or columns at a border, each uniform and equal in both
/// anchors. They are static foreground, whatever their motion vectors.
#[derive(Debug)]
pub(super) struct ActiveArea {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl ActiveArea {
    /// Finds the bars of two pictures of one size. Reads only as far as the first row or column that is not part of a
    /// bar.
    pub(super) fn find<P: Sampled>(level: SimdLevel, previous: Source<'_, P>, current: Source<'_, P>) -> Self {
        let pair = Pair { level, previous, current };
        let (width, height) = (current.width, current.height);
        let (top, bottom) = tasks::join(
            || (0..height).take_while(|&y| pair.is_bar_row(y)).count(),
            || (0..height).rev().take_while(|&y| pair.is_bar_row(y)).count(),
        );
        let (left, right) = tasks::join(
            || pair.bar_columns((0..width).step_by(COLUMNS).map(|x| x..width.min(x + COLUMNS)), |x| x),
            || {
                let from_right = (1..=width).rev().step_by(COLUMNS).map(|x| x.saturating_sub(COLUMNS)..x);
                pair.bar_columns(from_right, |x| width - 1 - x)
            },
        );
        // In a uniform picture the bars from both sides overlap.
        Self { columns: left..(width - right).max(left), rows: top..(height - bottom).max(top) }
    }

    pub(super) fn contains(&self, x: usize, y: usize) -> bool {
        self.columns.contains(&x) && self.rows.contains(&y)
    }

    /// Whether a rectangle is completely inside.
    pub(super) fn contains_rectangle(&self, [x, y]: [usize; 2], [width, height]: [usize; 2]) -> bool {
        self.contains(x, y) && self.contains(x + width - 1, y + height - 1)
    }
}

/// Range of lumas.
#[derive(Clone, Copy)]
struct LumaRange {
    low: u8,
    high: u8,
}

impl LumaRange {
    const NONE: Self = Self { low: u8::MAX, high: u8::MIN };

    fn with(self, value: u8) -> Self {
        Self { low: self.low.min(value), high: self.high.max(value) }
    }

    fn is_uniform(self) -> bool {
        self.high.saturating_sub(self.low) <= MAX_RANGE
    }
}

/// The two anchors.
struct Pair<'a, P> {
    level: SimdLevel,
    previous: Source<'a, P>,
    current: Source<'a, P>,
}

impl<P: Sampled> Pair<'_, P> {
    fn is_bar_row(&self, y: usize) -> bool {
        let mut range = LumaRange::NONE;
        let [previous, current] = [self.previous, self.current].map(|source| {
            let row = &source.pixels[y * source.width..][..source.width];
            row.chunks(RUN)
        });
        for (previous, current) in previous.zip(current) {
            for run in [previous, current] {
                let mut lumas = [0; RUN];
                P::lumas(self.level, run, &mut lumas);
                range = lumas[..run.len()].iter().fold(range, |range, &luma| range.with(luma));
            }
            if !range.is_uniform() {
                return false;
            }
        }
        true
    }

    /// Number of uniform columns from a border, which is scanned in `groups`; `distance` is a column's distance from
    /// the border.
    fn bar_columns(&self, groups: impl Iterator<Item = Range<usize>>, distance: impl Fn(usize) -> usize) -> usize {
        let mut bars = 0;
        for columns in groups {
            let ranges = self.ranges_of_columns(columns.clone());
            let other = columns.clone().zip(ranges).filter(|(_, range)| !range.is_uniform());
            match other.map(|(x, _)| distance(x)).min() {
                Some(first) => return first,
                None => bars += columns.len(),
            }
        }
        bars
    }

    /// Luma ranges of up to sixteen columns; incomplete if all of them already exceed the limit.
    fn ranges_of_columns(&self, columns: Range<usize>) -> [LumaRange; COLUMNS] {
        let mut ranges = [LumaRange::NONE; COLUMNS];
        for y in 0..self.current.height {
            for source in [self.previous, self.current] {
                let run = &source.pixels[y * source.width..][..source.width][columns.clone()];
                let mut lumas = [0; COLUMNS];
                P::lumas(self.level, run, &mut lumas);
                for (range, luma) in ranges.iter_mut().zip(lumas) {
                    *range = range.with(luma);
                }
            }
            if y % CHECK_ROWS == CHECK_ROWS - 1 && ranges[..columns.len()].iter().all(|range| !range.is_uniform()) {
                break;
            }
        }
        ranges
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The active area of two pictures with these lumas, the same for all instruction sets.
    fn active_area(previous: &[u8], current: &[u8], width: usize) -> (Range<usize>, Range<usize>) {
        let [previous, current] = [previous, current].map(|lumas| lumas.iter().map(|&v| [v; 4]).collect::<Vec<_>>());
        let source = |pixels| Source { pixels, width, height: previous.len() / width };
        let found: Vec<_> = SimdLevel::available()
            .map(|level| {
                let ActiveArea { columns, rows } = ActiveArea::find(level, source(&previous), source(&current));
                (columns, rows)
            })
            .collect();
        assert!(found.iter().all(|ranges| *ranges == found[0]));
        found[0].clone()
    }

    #[test]
    fn bars_end_at_content_in_either_anchor() {
        let mut before = vec![16; 8 * 6];
        let mut after = before.clone();
        before[2 * 8 + 3] = 90;
        after[3 * 8 + 5] = 90;
        assert_eq!(active_area(&before, &after, 8), (3..6, 2..4));
    }

    #[test]
    fn bars_may_be_of_any_width() {
        let (width, height) = (150, 40);
        for (left, right) in
            (0..60).zip((0..60).rev()).chain([(15, 16), (16, 17), (17, 47), (0, 0), (149, 0), (0, 149)])
        {
            for (top, bottom) in [(0, 0), (7, 3), (20, 19)] {
                let mut before = vec![16; width * height];
                let mut after = before.clone();
                // One pixel at two opposite corners of the active area, each in one of the pictures.
                before[top * width + left] = 20;
                after[(height - 1 - bottom) * width + width - 1 - right] = 12;
                assert_eq!(active_area(&before, &after, width), (left..width - right, top..height - bottom));
            }
        }
    }

    #[test]
    fn a_line_that_changes_is_no_bar() {
        let before = vec![10; 4 * 4];
        let after = vec![20; 4 * 4];
        assert_eq!(active_area(&before, &after, 4), (0..4, 0..4));
    }

    #[test]
    fn bars_may_vary_between_lines_but_not_within_one() {
        // Rows of lumas 0, 10, 20, ...: every row is uniform, no column is.
        let slope: Vec<u8> = (0..12 * 20).map(|i| (i / 20 * 10) as u8).collect();
        assert_eq!(active_area(&slope, &slope, 20), (0..20, 12..12));
    }

    #[test]
    fn a_uniform_picture_is_all_bar() {
        for (width, height) in [(1, 1), (4, 3), (16, 2), (33, 70)] {
            let (before, after) = (vec![7; width * height], vec![8; width * height]);
            assert_eq!(active_area(&before, &after, width), (width..width, height..height));
        }
    }
}
