//! Reading pictures between their pixels.

use crate::Picture;

/// The luma of a pixel in 8 bits.
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
        let ((column, fx), (row, fy)) = (split(x), split(y));
        let rows = taps(row, self.height);
        let across = weights(fx);
        if fy == 0.0 {
            let line = self.line(rows[1], column);
            return if fx == 0.0 { line[1].map(f32::from) } else { weighted(line.map(|p| p.map(f32::from)), across) };
        }
        let lines = rows.map(|row| weighted(self.line(row, column).map(|p| p.map(f32::from)), across));
        weighted(lines, weights(fy))
    }

    /// The four pixels of a row around `column` and the one after it.
    fn line(&self, row: usize, column: i32) -> [[u8; 4]; 4] {
        let line = &self.pixels[row * self.width..(row + 1) * self.width];
        let inside = usize::try_from(column - 1).ok().and_then(|first| line.get(first..)?.first_chunk());
        inside.copied().unwrap_or_else(|| taps(column, self.width).map(|column| line[column]))
    }
}

/// The four positions around `first` and `first + 1`, kept on an axis of `len`.
fn taps(first: i32, len: usize) -> [usize; 4] {
    [-1, 0, 1, 2].map(|offset| (first + offset).clamp(0, len as i32 - 1) as usize)
}

/// The whole number at or below `x`, and what remains, in [0, 1). Far beyond every picture, where nothing but the side
/// matters, it stops. (`f32::floor` is a call into a library on processors without SSE 4.1.)
pub(super) fn split(x: f32) -> (i32, f32) {
    let x = x.clamp(-FAR, FAR);
    let toward_zero = x as i32;
    let whole = toward_zero - i32::from(x < toward_zero as f32);
    (whole, x - whole as f32)
}

/// More than any position the largest picture and its longest vector lead to.
const FAR: f32 = 1_048_576.0;

fn weighted(values: [[f32; 4]; 4], weights: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|c| {
        let [a, b, e, f] = values;
        a[c] * weights[0] + b[c] * weights[1] + e[c] * weights[2] + f[c] * weights[3]
    })
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
    fn positions_are_split_at_the_whole_number_below() {
        for (x, whole) in [(0.0, 0), (0.75, 0), (1.0, 1), (-0.25, -1), (-1.0, -1), (-1.5, -2), (16384.25, 16384)] {
            assert_eq!(split(x), (whole, x - whole as f32));
        }
        assert_eq!((split(1e30), split(-1e30)), ((1 << 20, 0.0), (-(1 << 20), 0.0)));
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
