//! Letterbox and pillarbox bars.

use std::ops::Range;

/// Levels within which a line of a bar is even, and the same in both anchors.
const EVEN: u8 = 3;

/// What lies between the bars of a pair of pictures. A bar is made of whole rows or columns from an edge on that are
/// even and the same in both. It stands still and in front, whatever its vectors say.
#[derive(Debug)]
pub(super) struct Inside {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Inside {
    /// Finds the bars in two luma planes of one size.
    pub(super) fn find(previous: &[u8], current: &[u8], width: usize) -> Self {
        let height = current.len() / width;
        let row = |y: usize| y * width..(y + 1) * width;
        let column = |x: usize| (x..current.len()).step_by(width);
        let rows = between(height, |y| is_even(row(y), previous, current));
        let columns = between(width, |x| is_even(column(x), previous, current));
        Self { columns, rows }
    }

    pub(super) fn contains(&self, x: usize, y: usize) -> bool {
        self.columns.contains(&x) && self.rows.contains(&y)
    }
}

/// What remains of `0..len` without the lines at both ends that are bars.
fn between(len: usize, is_bar: impl Fn(usize) -> bool) -> Range<usize> {
    let start = (0..len).find(|&i| !is_bar(i)).unwrap_or(len);
    let end = (start..len).rev().find(|&i| !is_bar(i)).map_or(start, |i| i + 1);
    start..end
}

fn is_even(line: impl Iterator<Item = usize>, previous: &[u8], current: &[u8]) -> bool {
    let (mut low, mut high) = (u8::MAX, u8::MIN);
    for i in line {
        low = low.min(previous[i]).min(current[i]);
        high = high.max(previous[i]).max(current[i]);
        if high - low > EVEN {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inside(previous: &[u8], current: &[u8], width: usize) -> (Range<usize>, Range<usize>) {
        let Inside { columns, rows } = Inside::find(previous, current, width);
        (columns, rows)
    }

    #[test]
    fn bars_end_where_something_is_to_be_seen_in_either_anchor() {
        let mut before = vec![16; 8 * 6];
        let mut after = before.clone();
        before[2 * 8 + 3] = 90;
        after[3 * 8 + 5] = 90;
        assert_eq!(inside(&before, &after, 8), (3..6, 2..4));
    }

    #[test]
    fn a_line_that_changes_is_no_bar() {
        let before = vec![10; 4 * 4];
        let after = vec![20; 4 * 4];
        assert_eq!(inside(&before, &after, 4), (0..4, 0..4));
    }

    #[test]
    fn an_even_picture_is_all_bar() {
        let inside = Inside::find(&[7; 12], &[8; 12], 4);
        assert!((0..4).all(|x| (0..3).all(|y| !inside.contains(x, y))));
    }
}
