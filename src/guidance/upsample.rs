//! Resamples motion and depth to another picture size.

use half::f16;

use super::{DepthMap, Guidance, MotionField};
use crate::Result;

/// Vectors are interpolated only if they differ by less than this, in pixels of the source picture. Vectors farther apart belong to
/// different objects, and their mean would be the motion of neither.
const NEARLY: f32 = 1.0;

impl Guidance {
    /// Motion and depth resampled for the picture at `size`, one value per pixel; vectors in pixels of that size.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE), `OutOfMemory` when it cannot be allocated.
    pub fn enlarged(&self, size: (u32, u32)) -> Result<Self> {
        let (from, mut motion) = (self.size(), MotionField::new(size.0, size.1)?);
        let scale = [size.0 as f32 / from.0 as f32, size.1 as f32 / from.1 as f32];
        let rows = motion.vectors_mut().chunks_exact_mut(size.0 as usize);
        for (y, row) in (0..).zip(rows) {
            for (x, vector) in (0..).zip(row) {
                let [vx, vy] = vector_at(&self.motion, place([x, y], scale));
                *vector = [f16::from_f32(vx * scale[0]), f16::from_f32(vy * scale[1])];
            }
        }
        let mut depth = DepthMap::new(size.0, size.1, self.depth.projection())?;
        if let Some(even) = self.depth.even() {
            depth.fill(even);
        } else {
            let (tile, columns) = (self.depth.tile(), self.depth.columns());
            let rows = depth.depth_mut().chunks_exact_mut(size.0 as usize);
            for (y, row) in (0..).zip(rows) {
                for (x, depth) in (0..).zip(row) {
                    let [px, py] = pixel(place([x, y], scale), from);
                    *depth = self.depth.depth()[((py / tile) * columns + px / tile) as usize];
                }
            }
        }
        Self::from_parts(motion, depth)
    }
}

/// Position of the centre of a destination pixel in the source picture, in pixels from its edge.
fn place(at: [u32; 2], scale: [f32; 2]) -> [f32; 2] {
    [(at[0] as f32 + 0.5) / scale[0], (at[1] as f32 + 0.5) / scale[1]]
}

fn pixel(place: [f32; 2], from: (u32, u32)) -> [u32; 2] {
    [(place[0] as u32).min(from.0 - 1), (place[1] as u32).min(from.1 - 1)]
}

/// Vector at a source position: bilinear between the four around it if they are close to each other, else the nearest.
fn vector_at(motion: &MotionField, place: [f32; 2]) -> [f32; 2] {
    let tile = motion.tile() as f32;
    let last = [motion.columns() - 1, motion.rows() - 1];
    let cell = place.map(|p| p / tile - 0.5);
    let first = cell.map(f32::floor);
    let part = [cell[0] - first[0], cell[1] - first[1]];
    let at = |dx: f32, dy: f32| {
        let [x, y] =
            [(first[0] + dx, last[0]), (first[1] + dy, last[1])].map(|(p, last)| (p.max(0.0) as u32).min(last));
        motion.vectors()[(y * motion.columns() + x) as usize].map(f16::to_f32)
    };
    let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
    let apart = |axis: usize| {
        let values = corners.map(|corner| corner[axis]);
        values.into_iter().fold(f32::MIN, f32::max) - values.into_iter().fold(f32::MAX, f32::min)
    };
    if apart(0) <= NEARLY && apart(1) <= NEARLY {
        return [0, 1].map(|axis| {
            let [a, b, c, d] = corners.map(|corner| corner[axis]);
            let (top, bottom) = (a + (b - a) * part[0], c + (d - c) * part[0]);
            top + (bottom - top) * part[1]
        });
    }
    let [x, y] = pixel(place, motion.size());
    motion.at(x, y).map(f16::to_f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::paper;

    #[test]
    fn vectors_are_longer_and_things_keep_their_own() {
        for tile in [1, 8] {
            let mut motion = MotionField::tiled(32, 16, tile).unwrap();
            let columns = motion.columns();
            for (vector, place) in motion.vectors_mut().iter_mut().zip(0..) {
                let x = if place % columns < columns / 2 { -6.0 } else { 2.0 };
                *vector = [x, 1.0].map(f16::from_f32);
            }
            let mut depth = DepthMap::new(32, 16, paper::PROJECTION).unwrap();
            depth.depth_mut().iter_mut().zip(0..).for_each(|(d, i)| *d = if i % 32 < 16 { 0.25 } else { 0.75 });
            let large = Guidance::from_parts(motion, depth).unwrap().enlarged((96, 32)).unwrap();
            for (vector, place) in large.motion().vectors().iter().zip(0..) {
                let x = if place % 96 < 48 { -18.0 } else { 6.0 };
                assert_eq!(vector.map(f16::to_f32), [x, 2.0], "{tile}: pixel {place}");
                assert_eq!(large.depth().depth()[place as usize], if place % 96 < 48 { 0.25 } else { 0.75 });
            }
        }
    }

    #[test]
    fn motion_that_grows_evenly_does_so_in_the_larger_picture() {
        let mut motion = MotionField::new(64, 4).unwrap();
        for (vector, place) in motion.vectors_mut().iter_mut().zip(0..) {
            *vector = [f16::from_f32((place % 64) as f32 / 16.0), f16::ZERO];
        }
        let mut depth = DepthMap::new(64, 4, paper::PROJECTION).unwrap();
        depth.fill(0.5);
        let large = Guidance::from_parts(motion, depth).unwrap().enlarged((192, 12)).unwrap();
        assert_eq!(large.depth().even(), Some(0.5));
        for x in 3..189 {
            let wanted = 3.0 * ((x as f32 + 0.5) / 3.0 - 0.5) / 16.0;
            let found = large.motion().at(x, 5)[0].to_f32();
            assert!((found - wanted).abs() < 0.01, "{x}: {found}, not {wanted}");
        }
    }

    #[test]
    fn the_same_size_is_the_same() {
        let mut motion = MotionField::new(9, 7).unwrap();
        motion.vectors_mut().iter_mut().zip(0_u16..).for_each(|(v, i)| *v = [f16::from_bits(i * 400), f16::ONE]);
        let mut depth = DepthMap::new(9, 7, paper::PROJECTION).unwrap();
        depth.depth_mut().iter_mut().zip(0_u16..).for_each(|(d, i)| *d = f32::from(i) / 63.0);
        let guidance = Guidance::from_parts(motion, depth).unwrap();
        assert_eq!(guidance.enlarged((9, 7)).unwrap(), guidance);
    }
}
