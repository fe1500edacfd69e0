//! Bilinear resampling between 8-bit pictures and planes of floats: half-pixel centres, clamped edges, no antialiasing. Converts
//! between square pixels and the autoencoder's pictures, whose pixels are not square.

use crate::Picture;
use crate::runtime::Tap;

/// The sample positions of one resampling; make it once for each pair of sizes.
pub struct Bilinear {
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    from: (usize, usize),
}

impl Bilinear {
    /// Resamples from `(width, height)` to `(width, height)`, each at least 1.
    pub fn new(from: (u32, u32), to: (u32, u32)) -> Self {
        Self { columns: taps(from.0, to.0), rows: taps(from.1, to.1), from: (from.0 as usize, from.1 as usize) }
    }

    /// Rows and columns of the result.
    pub(crate) fn taps(&self) -> [&[Tap]; 2] {
        [&self.rows, &self.columns]
    }

    /// Resamples a picture into red, green and blue planes of `[height, width]` values in [0, 1]. Alpha is ignored.
    ///
    /// # Panics
    /// If the picture or the planes do not have the sizes given to [`new`](Self::new).
    pub fn to_planes(&self, picture: &Picture, planes: &mut [f32]) {
        let (width, height) = self.from;
        assert_eq!(picture.size(), (width as u32, height as u32), "the picture has the size the taps were made for");
        let area = self.rows.len() * self.columns.len();
        assert_eq!(planes.len(), 3 * area, "planes are [3, height, width]");
        let pixels = picture.pixels();
        for (y, row) in self.rows.iter().enumerate() {
            let (top, bottom) = (&pixels[row.low * width..][..width], &pixels[row.high * width..][..width]);
            for (x, column) in self.columns.iter().enumerate() {
                let corners = [top[column.low], top[column.high], bottom[column.low], bottom[column.high]];
                for channel in 0..3 {
                    let corners = corners.map(|pixel| f32::from(pixel[channel]) / 255.0);
                    planes[channel * area + y * self.columns.len() + x] = interpolate(corners, column.t, row.t);
                }
            }
        }
    }

    /// Resamples red, green and blue planes of `[height, width]` values into an opaque picture. Values are clamped to [0, 1] before
    /// interpolation.
    ///
    /// # Panics
    /// If the picture or the planes do not have the sizes given to [`new`](Self::new).
    pub fn to_picture(&self, planes: &[f32], picture: &mut Picture) {
        let (width, height) = self.from;
        assert_eq!(planes.len(), 3 * width * height, "planes are [3, height, width]");
        let size = (self.columns.len(), self.rows.len());
        assert_eq!(picture.size(), (size.0 as u32, size.1 as u32), "the picture has the size the taps were made for");
        for (line, row) in picture.pixels_mut().chunks_exact_mut(size.0).zip(&self.rows) {
            for (channel, plane) in planes.chunks_exact(width * height).enumerate() {
                let (top, bottom) = (&plane[row.low * width..][..width], &plane[row.high * width..][..width]);
                for (pixel, column) in line.iter_mut().zip(&self.columns) {
                    let corners = [top[column.low], top[column.high], bottom[column.low], bottom[column.high]];
                    let value = interpolate(corners.map(|c| c.clamp(0.0, 1.0)), column.t, row.t);
                    pixel[channel] = (value * 255.0 + 0.5) as u8;
                }
            }
            line.iter_mut().for_each(|pixel| pixel[3] = 255);
        }
    }
}

/// Interpolates between the values top left, top right, bottom left and bottom right.
fn interpolate([a, b, c, d]: [f32; 4], x: f32, y: f32) -> f32 {
    let top = a + (b - a) * x;
    let bottom = c + (d - c) * x;
    top + (bottom - top) * y
}

fn taps(from: u32, to: u32) -> Vec<Tap> {
    let scale = f64::from(from) / f64::from(to);
    let last = from as usize - 1;
    (0..to)
        .map(|i| {
            let position = ((f64::from(i) + 0.5) * scale - 0.5).max(0.0);
            let low = (position as usize).min(last);
            Tap { low, high: (low + 1).min(last), t: (position - low as f64) as f32 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 4]) -> Picture {
        let mut p = Picture::new(width, height).unwrap();
        for y in 0..height {
            for x in 0..width {
                p.pixels_mut()[(y * width + x) as usize] = pixel(x, y);
            }
        }
        p
    }

    #[test]
    fn resampling_to_the_same_size_changes_nothing() {
        let p = picture(7, 5, |x, y| [(x * 30) as u8, (y * 50) as u8, (x * y) as u8, 255]);
        let same = Bilinear::new((7, 5), (7, 5));
        let mut planes = vec![0.0; 3 * 35];
        same.to_planes(&p, &mut planes);
        let mut back = Picture::new(7, 5).unwrap();
        same.to_picture(&planes, &mut back);
        assert_eq!(back.rgba(), p.rgba());
    }

    #[test]
    fn doubling_samples_a_quarter_pixel_from_centres_and_clamps_edges() {
        let p = picture(2, 1, |x, _| [(x * 200) as u8; 4]);
        let mut planes = vec![0.0; 3 * 4];
        Bilinear::new((2, 1), (4, 1)).to_planes(&p, &mut planes);
        let expected = [0.0, 50.0 / 255.0, 150.0 / 255.0, 200.0 / 255.0];
        for (found, expected) in planes.chunks(4).flatten().zip(expected.iter().cycle()) {
            assert!((found - expected).abs() < 1e-6, "{planes:?}");
        }
    }

    #[test]
    fn halving_averages_pairs_of_pixels() {
        let p = picture(4, 2, |x, y| [(x * 40 + y * 100) as u8; 4]);
        let mut planes = vec![0.0; 3 * 2];
        Bilinear::new((4, 2), (2, 1)).to_planes(&p, &mut planes);
        assert!((planes[0] * 255.0 - 70.0).abs() < 1e-3 && (planes[1] * 255.0 - 150.0).abs() < 1e-3, "{planes:?}");
    }

    #[test]
    fn values_are_clamped_before_interpolation() {
        let planes: Vec<f32> = [-4.0, 4.0].repeat(3);
        let mut p = Picture::new(4, 1).unwrap();
        Bilinear::new((2, 1), (4, 1)).to_picture(&planes, &mut p);
        assert_eq!(p.pixels().iter().map(|px| px[0]).collect::<Vec<_>>(), [0, 64, 191, 255]);
    }
}
