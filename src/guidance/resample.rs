//! Resamples motion and depth to another picture size.

use half::f16;

use super::{DepthMap, Guidance, MotionField};
use crate::Result;

/// Vectors are interpolated only if they differ by at most this along each axis, in pixels of the source picture. Vectors farther apart belong to
/// different objects, and their mean would be the motion of neither.
const MAX_DIFFERENCE: f32 = 1.0;

#[cfg(test)]
crate::shader_constants::shader_constants!("RESAMPLE_": float MAX_DIFFERENCE);

impl Guidance {
    /// Motion and depth resampled to a picture of `size`, one value per pixel. Vectors are scaled to pixels of that size.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE), `OutOfMemory` when it cannot be allocated.
    pub fn resampled(&self, size: (u32, u32)) -> Result<Self> {
        let (from, mut motion) = (self.size(), MotionField::new(size.0, size.1)?);
        let scale = [size.0 as f32 / from.0 as f32, size.1 as f32 / from.1 as f32];
        let rows = motion.vectors_mut().chunks_exact_mut(size.0 as usize);
        for (y, row) in (0..).zip(rows) {
            for (x, vector) in (0..).zip(row) {
                let [vx, vy] = vector_at(&self.motion, source_position([x, y], scale));
                *vector = [f16::from_f32(vx * scale[0]), f16::from_f32(vy * scale[1])];
            }
        }
        let mut depth = DepthMap::new(size.0, size.1, self.depth.projection())?;
        if let Some(value) = self.depth.uniform_value() {
            depth.fill(value);
        } else {
            let (tile, columns) = (self.depth.tile(), self.depth.columns());
            let rows = depth.depth_mut().chunks_exact_mut(size.0 as usize);
            for (y, row) in (0..).zip(rows) {
                for (x, depth) in (0..).zip(row) {
                    let [px, py] = nearest_pixel(source_position([x, y], scale), from);
                    *depth = self.depth.depth()[((py / tile) * columns + px / tile) as usize];
                }
            }
        }
        Self::from_parts(motion, depth, self.origin)
    }
}

/// Position of the centre of a destination pixel in the source picture, in pixels from its edge.
fn source_position(at: [u32; 2], scale: [f32; 2]) -> [f32; 2] {
    [(at[0] as f32 + 0.5) / scale[0], (at[1] as f32 + 0.5) / scale[1]]
}

fn nearest_pixel(position: [f32; 2], from: (u32, u32)) -> [u32; 2] {
    [(position[0] as u32).min(from.0 - 1), (position[1] as u32).min(from.1 - 1)]
}

/// Vector at a source position: bilinear between the four around it if they are close to each other, else the nearest.
fn vector_at(motion: &MotionField, position: [f32; 2]) -> [f32; 2] {
    let tile = motion.tile() as f32;
    let last = [motion.columns() - 1, motion.rows() - 1];
    let cell = position.map(|p| p / tile - 0.5);
    let first = cell.map(f32::floor);
    let fraction = [cell[0] - first[0], cell[1] - first[1]];
    let at = |dx: f32, dy: f32| {
        let [x, y] =
            [(first[0] + dx, last[0]), (first[1] + dy, last[1])].map(|(p, last)| (p.max(0.0) as u32).min(last));
        motion.vectors()[(y * motion.columns() + x) as usize].map(f16::to_f32)
    };
    let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
    let range = |axis: usize| {
        let values = corners.map(|corner| corner[axis]);
        values.into_iter().fold(f32::MIN, f32::max) - values.into_iter().fold(f32::MAX, f32::min)
    };
    if range(0) <= MAX_DIFFERENCE && range(1) <= MAX_DIFFERENCE {
        return [0, 1].map(|axis| {
            let [a, b, c, d] = corners.map(|corner| corner[axis]);
            let (top, bottom) = (a + (b - a) * fraction[0], c + (d - c) * fraction[0]);
            top + (bottom - top) * fraction[1]
        });
    }
    let [x, y] = nearest_pixel(position, motion.size());
    motion.at(x, y).map(f16::to_f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::{MotionOrigin, paper};

    #[test]
    fn upsampling_scales_vectors_and_keeps_motion_edges_sharp() {
        for tile in [1, 8] {
            let mut motion = MotionField::tiled(32, 16, tile).unwrap();
            let columns = motion.columns();
            for (vector, position) in motion.vectors_mut().iter_mut().zip(0..) {
                let x = if position % columns < columns / 2 { -6.0 } else { 2.0 };
                *vector = [x, 1.0].map(f16::from_f32);
            }
            let mut depth = DepthMap::new(32, 16, paper::PROJECTION).unwrap();
            depth.depth_mut().iter_mut().zip(0..).for_each(|(d, i)| *d = if i % 32 < 16 { 0.25 } else { 0.75 });
            let large =
                Guidance::from_parts(motion, depth, MotionOrigin::Geometry).unwrap().resampled((96, 32)).unwrap();
            for (vector, position) in large.motion().vectors().iter().zip(0..) {
                let x = if position % 96 < 48 { -18.0 } else { 6.0 };
                assert_eq!(vector.map(f16::to_f32), [x, 2.0], "{tile}: pixel {position}");
                assert_eq!(large.depth().depth()[position as usize], if position % 96 < 48 { 0.25 } else { 0.75 });
            }
        }
    }

    #[test]
    fn a_linear_gradient_of_motion_stays_linear() {
        let mut motion = MotionField::new(64, 4).unwrap();
        for (vector, position) in motion.vectors_mut().iter_mut().zip(0..) {
            *vector = [f16::from_f32((position % 64) as f32 / 16.0), f16::ZERO];
        }
        let mut depth = DepthMap::new(64, 4, paper::PROJECTION).unwrap();
        depth.fill(0.5);
        let large =
            Guidance::from_parts(motion, depth, MotionOrigin::OpticalFlow).unwrap().resampled((192, 12)).unwrap();
        assert_eq!((large.depth().uniform_value(), large.origin()), (Some(0.5), MotionOrigin::OpticalFlow));
        for x in 3..189 {
            let wanted = 3.0 * ((x as f32 + 0.5) / 3.0 - 0.5) / 16.0;
            let found = large.motion().at(x, 5)[0].to_f32();
            assert!((found - wanted).abs() < 0.01, "{x}: {found}, not {wanted}");
        }
    }

    #[test]
    fn resampling_to_the_same_size_changes_nothing() {
        let mut motion = MotionField::new(9, 7).unwrap();
        motion.vectors_mut().iter_mut().zip(0_u16..).for_each(|(v, i)| *v = [f16::from_bits(i * 400), f16::ONE]);
        let mut depth = DepthMap::new(9, 7, paper::PROJECTION).unwrap();
        depth.depth_mut().iter_mut().zip(0_u16..).for_each(|(d, i)| *d = f32::from(i) / 63.0);
        let guidance = Guidance::from_parts(motion, depth, MotionOrigin::Geometry).unwrap();
        assert_eq!(guidance.resampled((9, 7)).unwrap(), guidance);
    }
}
