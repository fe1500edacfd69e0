//! Detection of colours in the previous anchor that the current one does not contain.
//!
//! The current anchor's motion does not include foreground that has left the picture. A colour of the previous anchor
//! that is outside the range of the current one's colours around the corresponding position belongs to such foreground.
//! This is the neighbourhood test of temporal anti-aliasing.

use super::colour::Colour;
use super::kernels::Source;
use super::key_buffer::Grid;
use crate::tasks;

/// Radius of the neighbourhood, in pixels: as far as an edge is mixed with its background.
const RADIUS: usize = 2;
/// Levels by which a colour may exceed the neighbourhood's range, for view-dependent shading.
const MARGIN: f32 = 24.0;
/// Factor for the difference of the pictures' mean colours, which is added to the margin: in a fade, bright pixels
/// change most.
const BRIGHTNESS_FACTOR: f32 = 4.0;
/// Step between pixels, across and down, over which the mean is computed.
const SAMPLE_STEP: usize = 8;

/// The margin for a pair of anchors, in levels.
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

/// Whether any channel of `colour` exceeds the range of the current anchor's colours around `at` (1/64 px) by more than
/// `margin` levels. Never outside the picture.
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
    fn colours_within_the_range_of_the_neighbourhood_are_no_outliers() {
        assert!(!is_outlier_at([25, 50, 100, 255], 2));
        assert!(!is_outlier_at([40 + MARGIN as u8, 90, 200, 255], 2));
        assert!(is_outlier_at([41 + MARGIN as u8, 90, 200, 255], 2));
        assert!(is_outlier_at([25, 50, 100, 200], 2));
    }

    #[test]
    fn only_the_neighbourhood_counts() {
        assert!(!is_outlier_at([10, 20, 200, 255], 1));
        assert!(is_outlier_at([10, 20, 200, 255], 0));
        assert!(!is_outlier_at([255, 255, 255, 255], -1));
        assert!(!is_outlier_at([255, 255, 255, 255], 6));
    }

    #[test]
    fn a_change_of_brightness_makes_no_outliers() {
        let bright = [[100, 200, 30, 255]; 20];
        let dark = bright.map(|[r, g, b, a]| [r / 2, g / 2, b / 2, a]);
        let [bright, dark] = [&bright, &dark].map(|pixels| Source { pixels, width: 20, height: 1 });
        assert_eq!(margin(bright, bright), MARGIN);
        for (previous, current) in [(bright, dark), (dark, bright)] {
            assert!(!is_colour_outlier(previous.pixels[0], current, [0, 0], margin(previous, current)));
        }
    }
}
