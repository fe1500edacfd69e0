//! Converts the YCbCr of video to display colour: the inverse of [`Yuv420`](super::Yuv420), for every layout that foreign videos may have.

use cairn::{Error, ErrorKind, Picture, Result};

/// Fractional bits of the matrix.
const BITS: u32 = 14;
/// Additional fractional bits, for luma as well: chroma is interpolated by quarters in both directions.
const TAP_BITS: u32 = 4;

/// Number and siting of chroma samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chroma {
    /// Luma alone.
    Mono,
    /// Half the columns and half the rows, in the middle of four luma samples: JPEG and MPEG-1.
    Half420Centre,
    /// Half the columns and half the rows, on every second column and midway between two rows: MPEG-2 and later.
    Half420Left,
    /// Half the columns and half the rows, on every second column; Cr on even rows and Cb on odd ones: DV of PAL.
    Half420PalDv,
    /// Half the columns, on every second one.
    Half422,
    /// One per luma sample.
    Full444,
}

/// Luma coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Matrix {
    /// Standard definition.
    Bt601,
    /// High definition.
    Bt709,
}

impl Matrix {
    /// The matrix that players assume for a video of this size without a colour tag.
    pub fn by_size((width, height): (u32, u32)) -> Self {
        if width >= 1280 || height > 576 { Self::Bt709 } else { Self::Bt601 }
    }
}

/// Layout of a frame's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// `(width, height)` in pixels.
    pub size: (u32, u32),
    /// Number and siting of chroma samples.
    pub chroma: Chroma,
    /// Luma coefficients.
    pub matrix: Matrix,
    /// Luma from 0 to 255 and chroma from 1 to 255, instead of 16 to 235 and 16 to 240.
    pub full_range: bool,
}

impl Layout {
    /// `(width, height)` of a chroma plane; zeros where there is none.
    fn chroma_size(&self) -> (usize, usize) {
        let (width, height) = (self.size.0 as usize, self.size.1 as usize);
        match self.chroma {
            Chroma::Mono => (0, 0),
            Chroma::Half420Centre | Chroma::Half420Left | Chroma::Half420PalDv => {
                (width.div_ceil(2), height.div_ceil(2))
            }
            Chroma::Half422 => (width.div_ceil(2), height),
            Chroma::Full444 => (width, height),
        }
    }

    /// Bytes of a frame: luma, Cb, Cr, one plane after the other without padding.
    pub fn frame_bytes(&self) -> usize {
        let (width, height) = self.chroma_size();
        self.size.0 as usize * self.size.1 as usize + 2 * width * height
    }
}

/// Positions of chroma samples along one axis, relative to luma samples.
#[derive(Debug, Clone, Copy)]
enum Siting {
    /// At every luma sample.
    Every,
    /// At luma samples 0, 2, 4, ...
    Even,
    /// At luma samples 1, 3, 5, ...
    Odd,
    /// Midway between luma samples 0 and 1, 2 and 3, ...
    Between,
}

/// Two chroma samples and the weight of the second, in quarters.
#[derive(Debug, Clone, Copy)]
struct Tap {
    first: usize,
    second: usize,
    weight: u16,
}

impl Siting {
    /// The chroma samples around luma sample `at`, out of `len`.
    fn tap(self, at: usize, len: usize) -> Tap {
        let (k, last) = (at / 2, len - 1);
        let (first, second, weight) = match (self, at % 2) {
            (Self::Every, _) => (at, at, 0),
            (Self::Even, 0) | (Self::Odd, 1) => (k, k, 0),
            (Self::Even, _) => (k, k + 1, 2),
            (Self::Odd, _) => (k.saturating_sub(1), k, 2),
            (Self::Between, 0) => (k.saturating_sub(1), k, 3),
            (Self::Between, _) => (k, k + 1, 1),
        };
        Tap { first: first.min(last), second: second.min(last), weight }
    }
}

/// Converts frames of one layout to pictures. Integer arithmetic gives the same bytes on every machine.
#[derive(Debug)]
pub struct FromYuv {
    layout: Layout,
    /// Per column.
    across: Vec<Tap>,
    /// A chroma row interpolated vertically. It is then interpolated horizontally.
    mixed: Vec<u16>,
    rows: [Vec<u16>; 2],
    /// Coefficients: luma; Cr to red; Cb and Cr to green; Cb to blue.
    weights: [i32; 5],
}

impl FromYuv {
    /// For frames of `layout`.
    ///
    /// # Errors
    /// As [`Picture::new`].
    pub fn new(layout: Layout) -> Result<Self> {
        // Rejects impossible sizes before allocating.
        Picture::new(layout.size.0, 1)?;
        Picture::new(1, layout.size.1)?;
        let width = layout.size.0 as usize;
        let (chroma_width, _) = layout.chroma_size();
        let siting = match layout.chroma {
            Chroma::Mono | Chroma::Full444 => Siting::Every,
            Chroma::Half420Centre => Siting::Between,
            Chroma::Half420Left | Chroma::Half420PalDv | Chroma::Half422 => Siting::Even,
        };
        let across =
            if chroma_width == 0 { Vec::new() } else { (0..width).map(|x| siting.tap(x, chroma_width)).collect() };
        // Mono frames keep these rows of neutral chroma.
        let grey = vec![128 << TAP_BITS; width];
        Ok(Self { layout, across, mixed: vec![0; chroma_width], rows: [grey.clone(), grey], weights: weights(&layout) })
    }

    /// Converts one frame of [`Layout::frame_bytes`] bytes into `out`. Alpha becomes opaque.
    ///
    /// # Errors
    /// `InvalidArgument` when the bytes or the picture have another size.
    pub fn convert(&mut self, frame: &[u8], out: &mut Picture) -> Result<()> {
        if out.size() != self.layout.size || frame.len() != self.layout.frame_bytes() {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("{} bytes do not make {out:?} of {:?}", frame.len(), self.layout),
            )
            .field("frame"));
        }
        let (width, height) = (self.layout.size.0 as usize, self.layout.size.1 as usize);
        let (luma, chroma) = frame.split_at(width * height);
        let planes = chroma.split_at(chroma.len() / 2);
        for (y, pixels) in out.pixels_mut().chunks_exact_mut(width).enumerate() {
            if self.layout.chroma != Chroma::Mono {
                self.interpolate(0, planes.0, y);
                self.interpolate(1, planes.1, y);
            }
            let luma = &luma[y * width..][..width];
            let [cb, cr] = &self.rows;
            let colours = luma.iter().zip(cb).zip(cr);
            for (px, ((&y, &cb), &cr)) in pixels.iter_mut().zip(colours) {
                *px = self.colour(y, cb, cr);
            }
        }
        debug_assert_eq!(height, out.height() as usize);
        Ok(())
    }

    /// Interpolates row `y` of chroma plane `which` (0: Cb, 1: Cr) at the luma positions.
    fn interpolate(&mut self, which: usize, plane: &[u8], y: usize) {
        let (width, height) = self.layout.chroma_size();
        let siting = match (self.layout.chroma, which) {
            (Chroma::Half420Centre | Chroma::Half420Left, _) => Siting::Between,
            (Chroma::Half420PalDv, 0) => Siting::Odd,
            (Chroma::Half420PalDv, _) => Siting::Even,
            _ => Siting::Every,
        };
        let Tap { first, second, weight } = siting.tap(y, height);
        let (upper, lower) = (&plane[first * width..][..width], &plane[second * width..][..width]);
        for (mixed, (&a, &b)) in self.mixed.iter_mut().zip(upper.iter().zip(lower)) {
            *mixed = (4 - weight) * u16::from(a) + weight * u16::from(b);
        }
        for (out, tap) in self.rows[which].iter_mut().zip(&self.across) {
            *out = (4 - tap.weight) * self.mixed[tap.first] + tap.weight * self.mixed[tap.second];
        }
    }

    /// One pixel; chroma with [`TAP_BITS`] fractional bits.
    fn colour(&self, y: u8, cb: u16, cr: u16) -> [u8; 4] {
        let black = if self.layout.full_range { 0 } else { 16 };
        let [luma, red, green_b, green_r, blue] = self.weights;
        let y = luma * ((i32::from(y) - black) << TAP_BITS);
        let (cb, cr) = (i32::from(cb) - (128 << TAP_BITS), i32::from(cr) - (128 << TAP_BITS));
        let channel = |value: i32| {
            let rounded = (value + (1 << (BITS + TAP_BITS - 1))) >> (BITS + TAP_BITS);
            rounded.clamp(0, 255) as u8
        };
        [channel(y + red * cr), channel(y + green_b * cb + green_r * cr), channel(y + blue * cb), 255]
    }
}

/// The inverse of `Y = Kr R + (1 - Kr - Kb) G + Kb B`, `Cb = (B - Y) / (2 - 2 Kb)`, `Cr = (R - Y) / (2 - 2 Kr)`: ITU-R
/// BT.601 section 2.5, BT.709 section 3.
fn weights(layout: &Layout) -> [i32; 5] {
    let (kr, kb) = match layout.matrix {
        Matrix::Bt601 => (0.299, 0.114),
        Matrix::Bt709 => (0.2126, 0.0722),
    };
    let (luma, chroma) = if layout.full_range { (1.0, 1.0) } else { (255.0 / 219.0, 255.0 / 224.0) };
    let (red, blue) = (chroma * (2.0 - 2.0 * kr), chroma * (2.0 - 2.0 * kb));
    let kg: f64 = 1.0 - kr - kb;
    let fixed = |value: f64| (value * f64::from(1 << BITS)).round() as i32;
    [fixed(luma), fixed(red), fixed(-blue * kb / kg), fixed(-red * kr / kg), fixed(blue)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Yuv420;

    const ALL: [Chroma; 6] = [
        Chroma::Mono,
        Chroma::Half420Centre,
        Chroma::Half420Left,
        Chroma::Half420PalDv,
        Chroma::Half422,
        Chroma::Full444,
    ];

    fn read(layout: Layout, frame: &[u8]) -> Picture {
        let mut out = Picture::new(layout.size.0, layout.size.1).unwrap();
        FromYuv::new(layout).unwrap().convert(frame, &mut out).unwrap();
        out
    }

    fn uniform(layout: Layout, [y, cb, cr]: [u8; 3]) -> Vec<u8> {
        let luma = (layout.size.0 * layout.size.1) as usize;
        let chroma = (layout.frame_bytes() - luma) / 2;
        [vec![y; luma], vec![cb; chroma], vec![cr; chroma]].concat()
    }

    /// The standards' formulas in floating point.
    fn wanted(matrix: Matrix, full_range: bool, code: [u8; 3]) -> [f64; 3] {
        let (kr, kb) = if matrix == Matrix::Bt601 { (0.299, 0.114) } else { (0.2126, 0.0722) };
        let (low, luma, chroma) = if full_range { (0.0, 255.0, 255.0) } else { (16.0, 219.0, 224.0) };
        let y = (f64::from(code[0]) - low) / luma;
        let [pb, pr] = [code[1], code[2]].map(|v| (f64::from(v) - 128.0) / chroma);
        let (r, b) = (y + 2.0 * (1.0 - kr) * pr, y + 2.0 * (1.0 - kb) * pb);
        [r, (y - kr * r - kb * b) / (1.0 - kr - kb), b].map(|v| (v * 255.0).clamp(0.0, 255.0))
    }

    #[test]
    fn uniform_colours_agree_with_the_standards_to_half_a_code_value() {
        for (matrix, full_range) in
            [(Matrix::Bt601, false), (Matrix::Bt601, true), (Matrix::Bt709, false), (Matrix::Bt709, true)]
        {
            for step in 0..200u32 {
                let code = [(step * 37 % 256) as u8, (step * 91 % 256) as u8, (step * 53 % 256) as u8];
                for chroma in ALL {
                    let layout = Layout { size: (5, 3), chroma, matrix, full_range };
                    let code = if chroma == Chroma::Mono { [code[0], 128, 128] } else { code };
                    let want = wanted(matrix, full_range, code);
                    for px in read(layout, &uniform(layout, code)).pixels() {
                        for c in 0..3 {
                            assert!((f64::from(px[c]) - want[c]).abs() < 0.52, "{layout:?} {code:?}: {px:?}, {want:?}");
                        }
                        assert_eq!(px[3], 255);
                    }
                }
            }
        }
    }

    #[test]
    fn there_and_back_is_the_same_colour() {
        let layout = Layout { size: (7, 5), chroma: Chroma::Half420Left, matrix: Matrix::Bt709, full_range: false };
        for rgb in [[0; 3], [255; 3], [200, 30, 90], [12, 240, 66], [90, 90, 250]] {
            let mut picture = Picture::new(7, 5).unwrap();
            picture.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&rgb));
            let mut planes = Yuv420::new(7, 5).unwrap();
            planes.convert(&picture).unwrap();
            let frame: Vec<u8> = (0..3).flat_map(|i| planes.plane(i).to_vec()).collect();
            for px in read(layout, &frame).pixels() {
                for c in 0..3 {
                    assert!(px[c].abs_diff(rgb[c]) <= 2, "{rgb:?} came back as {px:?}");
                }
            }
        }
    }

    /// Chroma that rises by a constant from sample to sample must rise evenly over the luma samples, and have each
    /// sample's own value where it is sited.
    #[test]
    fn chroma_lies_where_it_is_sited() {
        // Luma column (or row) of chroma sample k: 2 k + offset.
        let cases = [
            (Chroma::Half420Left, [0.0, 0.5, 0.5]),
            (Chroma::Half420Centre, [0.5, 0.5, 0.5]),
            (Chroma::Half420PalDv, [0.0, 1.0, 0.0]),
        ];
        for (chroma, [across, down_b, down_r]) in cases {
            let layout = Layout { size: (16, 16), chroma, matrix: Matrix::Bt709, full_range: true };
            let mut converter = FromYuv::new(layout).unwrap();
            let plane: Vec<u8> = (0..64).map(|i| (40 + 8 * (i % 8) + 4 * (i / 8)) as u8).collect();
            for y in 2..14 {
                for (which, down) in [(0, down_b), (1, down_r)] {
                    converter.interpolate(which, &plane, y);
                    for x in 2..14 {
                        let want = 40.0 + 8.0 * (x as f64 - across) / 2.0 + 4.0 * (y as f64 - down) / 2.0;
                        let got = f64::from(converter.rows[which][x]) / 16.0;
                        assert!((got - want).abs() < 1e-9, "{chroma:?} plane {which} at {x}, {y}: {got}, not {want}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_smallest_pictures_have_all_their_chroma() {
        for chroma in ALL {
            for size in [(1, 1), (2, 1), (1, 2), (3, 3)] {
                let layout = Layout { size, chroma, matrix: Matrix::Bt601, full_range: false };
                let out = read(layout, &uniform(layout, [235, 128, 128]));
                assert!(out.pixels().iter().all(|px| *px == [255; 4]), "{layout:?}");
            }
        }
    }

    #[test]
    fn another_number_of_bytes_is_refused() {
        let layout = Layout { size: (4, 4), chroma: Chroma::Half422, matrix: Matrix::Bt601, full_range: false };
        let mut out = Picture::new(4, 4).unwrap();
        let mut converter = FromYuv::new(layout).unwrap();
        assert!(converter.convert(&[0; 31], &mut out).is_err());
        assert!(converter.convert(&[0; 32], &mut Picture::new(4, 5).unwrap()).is_err());
        assert!(FromYuv::new(Layout { size: (0, 4), ..layout }).is_err());
    }
}
