//! Converts display colour to the YCbCr of video: limited range, 4:2:0 with left-sited chroma.

use cairn::{Error, ErrorKind, Picture, Result};

use super::Matrix;

/// Fractional bits of the matrix.
const BITS: u32 = 16;

/// The rows of a matrix from red, green and blue.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Rows {
    /// The luma coefficients, times 219/255.
    y: [i32; 3],
    /// (B - Y) / (2 - 2 kb) * 224/255. Chroma rows sum to zero, so that grey is exactly 128.
    cb: [i32; 3],
    /// (R - Y) / (2 - 2 kr) * 224/255.
    cr: [i32; 3],
}

impl Rows {
    /// ITU-R BT.601 and BT.709: kr, kg and kb are 0.299, 0.587 and 0.114, or 0.2126, 0.7152 and 0.0722.
    fn of(matrix: Matrix) -> Self {
        match matrix {
            Matrix::Bt601 => {
                Self { y: [16_829, 33_039, 6_416], cb: [-9_714, -19_071, 28_785], cr: [28_784, -24_103, -4_681] }
            }
            Matrix::Bt709 => {
                Self { y: [11_966, 40_254, 4_064], cb: [-6_596, -22_189, 28_785], cr: [28_784, -26_145, -2_639] }
            }
        }
    }
}

/// One picture as three planes of bytes without padding: luma at full size, chroma at half of it, rounded up.
///
/// Chroma samples lie on every second luma column and midway between two rows, which is what MPEG-2 and later
/// assume and what AV1 calls `vertical`. Integer arithmetic makes the same bytes on every machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Yuv420 {
    width: usize,
    height: usize,
    rows: Rows,
    planes: [Vec<u8>; 3],
}

impl Yuv420 {
    /// Room for a picture of `width` x `height` pixels, by the matrix of BT.709.
    ///
    /// # Errors
    /// `InvalidArgument` for an empty picture, `OutOfMemory`.
    pub fn new(width: u32, height: u32) -> Result<Self> {
        Self::with_matrix(width, height, Matrix::Bt709)
    }

    /// The same by another matrix.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_matrix(width: u32, height: u32, matrix: Matrix) -> Result<Self> {
        if width == 0 || height == 0 {
            return Err(Error::new(ErrorKind::InvalidArgument, "an empty picture has no planes").field("size"));
        }
        let (width, height) = (width as usize, height as usize);
        let chroma = width.div_ceil(2) * height.div_ceil(2);
        let plane = |len: usize| -> Result<Vec<u8>> {
            let mut plane = Vec::new();
            plane.try_reserve_exact(len).map_err(|_| {
                Error::new(ErrorKind::OutOfMemory, format!("a video frame of {width} x {height} needs {len} bytes"))
            })?;
            plane.resize(len, 0);
            Ok(plane)
        };
        Ok(Self {
            width,
            height,
            rows: Rows::of(matrix),
            planes: [plane(width * height)?, plane(chroma)?, plane(chroma)?],
        })
    }

    /// `(width, height)` of plane `i`: 0 luma, 1 Cb, 2 Cr.
    pub fn plane_size(&self, i: usize) -> (usize, usize) {
        if i == 0 { (self.width, self.height) } else { (self.width.div_ceil(2), self.height.div_ceil(2)) }
    }

    /// Rows of plane `i`, top to bottom without padding.
    pub fn plane(&self, i: usize) -> &[u8] {
        &self.planes[i]
    }

    /// Converts `picture`. Alpha is ignored.
    ///
    /// # Errors
    /// `InvalidArgument` for a picture of another size.
    pub fn convert(&mut self, picture: &Picture) -> Result<()> {
        let (width, height) = (self.width, self.height);
        if (picture.width() as usize, picture.height() as usize) != (width, height) {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("the video is {width} x {height}, the frame {} x {}", picture.width(), picture.height()),
            )
            .field("frame"));
        }
        let pixels = picture.pixels();
        let rgb_to = &self.rows;
        let [luma, cb, cr] = &mut self.planes;
        for (y, px) in luma.iter_mut().zip(pixels) {
            *y = quantise(dot(rgb_to.y, [px[0].into(), px[1].into(), px[2].into()]), BITS, 16);
        }
        let chroma_width = width.div_ceil(2);
        let rows = cb.chunks_exact_mut(chroma_width).zip(cr.chunks_exact_mut(chroma_width));
        for (row, (cb, cr)) in rows.enumerate() {
            let upper = &pixels[2 * row * width..][..width];
            let lower = &pixels[(2 * row + 1).min(height - 1) * width..][..width];
            for (column, (cb, cr)) in cb.iter_mut().zip(cr).enumerate() {
                let centre = 2 * column;
                let taps = [centre.saturating_sub(1), centre, (centre + 1).min(width - 1)];
                let mut sum = [0i32; 3];
                for (tap, weight) in taps.into_iter().zip([1, 2, 1]) {
                    for c in 0..3 {
                        sum[c] += weight * (i32::from(upper[tap][c]) + i32::from(lower[tap][c]));
                    }
                }
                // The weights sum to 8: three more fractional bits.
                *cb = quantise(dot(rgb_to.cb, sum), BITS + 3, 128);
                *cr = quantise(dot(rgb_to.cr, sum), BITS + 3, 128);
            }
        }
        Ok(())
    }
}

fn dot(row: [i32; 3], rgb: [i32; 3]) -> i32 {
    row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2]
}

/// Rounds to the nearest integer and adds the code value of zero. The result is within 16 to 240.
fn quantise(value: i32, bits: u32, zero: i32) -> u8 {
    (((value + (1 << (bits - 1))) >> bits) + zero) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uniform(rgb: [u8; 3], width: u32, height: u32) -> Yuv420 {
        uniform_by(Matrix::Bt709, rgb, width, height)
    }

    fn uniform_by(matrix: Matrix, rgb: [u8; 3], width: u32, height: u32) -> Yuv420 {
        let mut picture = Picture::new(width, height).unwrap();
        picture.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&rgb));
        let mut yuv = Yuv420::with_matrix(width, height, matrix).unwrap();
        yuv.convert(&picture).unwrap();
        yuv
    }

    /// The standards' formula in floating point.
    fn wanted(matrix: Matrix, rgb: [u8; 3]) -> [f64; 3] {
        let (kr, kb) = if matrix == Matrix::Bt601 { (0.299, 0.114) } else { (0.2126, 0.0722) };
        let [r, g, b] = rgb.map(|v| f64::from(v) / 255.0);
        let y = kr * r + (1.0 - kr - kb) * g + kb * b;
        [16.0 + 219.0 * y, 128.0 + 112.0 * (b - y) / (1.0 - kb), 128.0 + 112.0 * (r - y) / (1.0 - kr)]
    }

    #[test]
    fn uniform_colours_agree_with_the_standards_to_half_a_code_value() {
        for step in 0..512u32 {
            let rgb = [(step * 37 % 256) as u8, (step * 91 % 256) as u8, (step * 5 % 256) as u8];
            for matrix in [Matrix::Bt601, Matrix::Bt709] {
                let yuv = uniform_by(matrix, rgb, 5, 3);
                for (plane, want) in wanted(matrix, rgb).into_iter().enumerate() {
                    for &got in yuv.plane(plane) {
                        assert!((f64::from(got) - want).abs() < 0.51, "{rgb:?} plane {plane}: {got}, want {want}");
                    }
                }
            }
        }
    }

    #[test]
    fn black_white_and_grey_have_their_exact_codes() {
        for (rgb, y) in [([0; 3], 16), ([255; 3], 235), ([128; 3], 126)] {
            let yuv = uniform(rgb, 4, 4);
            assert!(yuv.plane(0).iter().all(|&v| v == y));
            assert!(yuv.plane(1).iter().chain(yuv.plane(2)).all(|&v| v == 128));
        }
    }

    #[test]
    fn chroma_is_sited_on_even_columns() {
        // A blue column at x = 4 affects chroma column 2 only; one at x = 3 affects columns 1 and 2.
        for (blue, expected) in [(4usize, [0, 0, 2, 0]), (3, [0, 1, 1, 0])] {
            let mut picture = Picture::new(8, 2).unwrap();
            for row in picture.pixels_mut().chunks_exact_mut(8) {
                row[blue][2] = 255;
            }
            let mut yuv = Yuv420::new(8, 2).unwrap();
            yuv.convert(&picture).unwrap();
            let weight: Vec<i32> = yuv.plane(1).iter().map(|&v| (i32::from(v) - 128) / 28).collect();
            assert_eq!(weight, expected, "blue at {blue}: {:?}", yuv.plane(1));
        }
    }

    #[test]
    fn odd_sizes_round_chroma_up() {
        let yuv = uniform([9, 200, 30], 7, 5);
        assert_eq!(yuv.plane_size(1), (4, 3));
        assert_eq!((yuv.plane(0).len(), yuv.plane(2).len()), (35, 12));
        assert!(yuv.plane(1).windows(2).all(|w| w[0] == w[1]));
    }

    #[test]
    fn a_frame_of_another_size_is_refused() {
        let error = Yuv420::new(8, 8).unwrap().convert(&Picture::new(8, 4).unwrap()).unwrap_err();
        assert!(error.to_string().contains("8 x 4"), "{error}");
    }
}
