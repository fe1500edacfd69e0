//! Reading pictures between their pixels.

use crate::Picture;

/// The luma of `picture` in 8 bits, into `luma` of as many entries.
pub(super) fn luma(pixel: [u8; 4]) -> u8 {
    let [r, g, b, _] = pixel.map(u32::from);
    // The weights of BT.601 over 256; they add up to 256.
    ((77 * r + 150 * g + 29 * b) >> 8) as u8
}

/// Reads a picture by the cubic of Catmull and Rom; beyond the edges the edge pixels go on. At whole positions it gives
/// the pixels themselves, exactly. Coordinates are in pixels, (0, 0) being the centre of the first one.
#[derive(Clone, Copy)]
pub(super) struct Bicubic<'a> {
    pixels: &'a [[u8; 4]],
    width: usize,
    height: usize,
}

impl<'a> Bicubic<'a> {
    pub(super) fn new(picture: &'a Picture) -> Self {
        Self { pixels: picture.pixels(), width: picture.width() as usize, height: picture.height() as usize }
    }

    /// Whether the position lies on the picture.
    pub(super) fn contains(&self, [x, y]: [f32; 2]) -> bool {
        x >= -0.5 && y >= -0.5 && x <= self.width as f32 - 0.5 && y <= self.height as f32 - 0.5
    }

    /// The four channels at a position, not yet cut to [0, 255].
    pub(super) fn at(&self, [x, y]: [f32; 2]) -> [f32; 4] {
        let (column, row) = (x.floor(), y.floor());
        let (fx, fy) = (x - column, y - row);
        let (columns, rows) = (taps(column, self.width), taps(row, self.height));
        if fx == 0.0 && fy == 0.0 {
            return self.pixels[rows[1] * self.width + columns[1]].map(f32::from);
        }
        let (across, down) = (weights(fx), weights(fy));
        let mut sum = [0.0; 4];
        for (&row, weight) in rows.iter().zip(down) {
            let line = &self.pixels[row * self.width..(row + 1) * self.width];
            for (&column, across) in columns.iter().zip(across) {
                let weight = weight * across;
                for (sum, value) in sum.iter_mut().zip(line[column]) {
                    *sum += weight * f32::from(value);
                }
            }
        }
        sum
    }
}

/// The four positions around `first` and `first + 1`, kept on an axis of `len`.
fn taps(first: f32, len: usize) -> [usize; 4] {
    [-1.0, 0.0, 1.0, 2.0].map(|offset| (first + offset).clamp(0.0, (len - 1) as f32) as usize)
}

/// Catmull-Rom weights of those four for a position `f` in [0, 1) after the second.
fn weights(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [0.5 * (-f3 + 2.0 * f2 - f), 0.5 * (3.0 * f3 - 5.0 * f2 + 2.0), 0.5 * (-3.0 * f3 + 4.0 * f2 + f), 0.5 * (f3 - f2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Picture {
        let mut picture = Picture::new(9, 7).unwrap();
        for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
            let (x, y) = (i % 9, i / 9);
            *pixel = [(20 * x) as u8, (30 * y) as u8, (10 * x + 15 * y) as u8, 255];
        }
        picture
    }

    #[test]
    fn whole_positions_give_the_pixels_themselves() {
        let picture = ramp();
        let bicubic = Bicubic::new(&picture);
        for (i, pixel) in picture.pixels().iter().enumerate() {
            assert_eq!(bicubic.at([(i % 9) as f32, (i / 9) as f32]), pixel.map(f32::from));
        }
    }

    #[test]
    fn ramps_are_exact_between_pixels() {
        let picture = ramp();
        let [r, g, b, a] = Bicubic::new(&picture).at([3.25, 2.75]);
        for (have, want) in [(r, 65.0), (g, 82.5), (b, 73.75), (a, 255.0)] {
            assert!((have - want).abs() < 1e-3, "{have} for {want}");
        }
    }

    #[test]
    fn edges_go_on_however_far_away() {
        let picture = ramp();
        let bicubic = Bicubic::new(&picture);
        assert_eq!(bicubic.at([-1e9, -1e9]), picture.pixels()[0].map(f32::from));
        assert_eq!(bicubic.at([1e9, 1e9]), picture.pixels()[62].map(f32::from));
        assert!(bicubic.contains([-0.5, 6.5]) && !bicubic.contains([-0.51, 0.0]) && !bicubic.contains([0.0, 6.51]));
        assert!(!bicubic.contains([f32::NAN, 0.0]));
    }
}
