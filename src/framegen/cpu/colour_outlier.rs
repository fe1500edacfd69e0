//! Telling what only the previous anchor knows of: a surface in front that is no longer there in the current one.
//!
//! The motion of the current anchor cannot say that something passed in front of what it shows, and has left the picture
//! since. Where the previous anchor shows a colour that the current one does not have anywhere around the same place,
//! that is what it shows.

use super::colour::Colour;
use super::kernels::Source;
use super::key_buffer::Grid;
use crate::tasks;

/// Colours around a place are those of a square that reaches this many pixels to every side: as far as the rim of a
/// surface is mixed with what is behind it.
const RADIUS: usize = 2;
/// Levels by which a colour may lie outside those around the place, for light that changes with the view.
const MARGIN: f32 = 24.0;
/// Where the pictures as a whole differ, as in a fade, this many times that is added: bright pixels change most.
const BRIGHTNESS_FACTOR: f32 = 4.0;
/// One pixel of so many in one row of so many tells how bright a picture is.
const SAMPLE_STEP: usize = 8;

/// The levels by which a colour may lie outside those around its place, for two anchors.
pub(super) fn margin<P: Colour>(previous: Source<'_, P>, current: Source<'_, P>) -> f32 {
    let mean = |source: Source<'_, P>| {
        let rows = source.pixels.chunks(source.width).step_by(SAMPLE_STEP);
        let (mut sum, mut count) = ([0.0; 4], 0.0_f32);
        for pixel in rows.flat_map(|row| row.iter().step_by(SAMPLE_STEP)) {
            let levels = pixel.in_levels();
            sum = std::array::from_fn(|c| sum[c] + levels[c]);
            count += 1.0;
        }
        sum.map(|sum: f32| sum / count.max(1.0))
    };
    let (before, after) = tasks::join(|| mean(previous), || mean(current));
    MARGIN + BRIGHTNESS_FACTOR * (0..4).fold(0.0, |most: f32, c| most.max((after[c] - before[c]).abs()))
}

/// Whether `colour`, seen where the same thing should be as at `at` (1/64 px) in `current`, is none of the colours
/// there: some channel lies outside all of those around the place by more than `margin` levels. What is outside the
/// picture has no colours.
pub(super) fn is_colour_outlier<P: Colour>(colour: P, current: Source<'_, P>, at: [i32; 2], margin: f32) -> bool {
    let grid = Grid { width: current.width, height: current.height, ..Grid::default() };
    let Some([x, y]) = grid.nearest_pixel(at) else { return false };
    let levels = colour.in_levels();
    let here = current.pixels[y * grid.width + x].in_levels();
    if (0..4).all(|c| (levels[c] - here[c]).abs() <= margin) {
        return false;
    }
    let (mut low, mut high) = ([f32::INFINITY; 4], [f32::NEG_INFINITY; 4]);
    for v in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(grid.height) {
        let row = &current.pixels[v * grid.width..][x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(grid.width)];
        for pixel in row {
            let levels = pixel.in_levels();
            for c in 0..4 {
                (low[c], high[c]) = (low[c].min(levels[c]), high[c].max(levels[c]));
            }
        }
    }
    (0..4).any(|c| levels[c] < low[c] - margin || levels[c] > high[c] + margin)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: [[u8; 4]; 6] =
        [[10, 20, 30, 255], [40, 20, 30, 255], [10, 90, 30, 255], [10, 20, 200, 255], [0, 20, 30, 255], [9, 9, 9, 255]];

    fn is_outlier_at(colour: [u8; 4], x: i32) -> bool {
        is_colour_outlier(colour, Source { pixels: &PIXELS, width: 6, height: 1 }, [64 * x, 0], MARGIN)
    }

    #[test]
    fn colours_between_those_around_belong_there() {
        assert!(!is_outlier_at([25, 50, 100, 255], 2));
        assert!(!is_outlier_at([40 + MARGIN as u8, 90, 200, 255], 2));
        assert!(is_outlier_at([41 + MARGIN as u8, 90, 200, 255], 2));
        assert!(is_outlier_at([25, 50, 100, 200], 2));
    }

    #[test]
    fn only_what_is_near_counts() {
        assert!(!is_outlier_at([10, 20, 200, 255], 1));
        assert!(is_outlier_at([10, 20, 200, 255], 0));
        assert!(!is_outlier_at([255, 255, 255, 255], -1));
        assert!(!is_outlier_at([255, 255, 255, 255], 6));
    }

    #[test]
    fn light_that_changes_everywhere_makes_nothing_foreign() {
        let bright = [[100, 200, 30, 255]; 20];
        let dark = bright.map(|[r, g, b, a]| [r / 2, g / 2, b / 2, a]);
        let [bright, dark] = [&bright, &dark].map(|pixels| Source { pixels, width: 20, height: 1 });
        assert_eq!(margin(bright, bright), MARGIN);
        for (previous, current) in [(bright, dark), (dark, bright)] {
            assert!(!is_colour_outlier(previous.pixels[0], current, [0, 0], margin(previous, current)));
        }
    }
}
