//! Guidance as pictures for people.
//!
//! **Motion** is drawn as a colour wheel: the hue is the direction of the stored vector (from the current picture to
//! the previous), the saturation its length, white at rest and full colour from `full_scale` pixels on. Red points
//! right, and the hue runs clockwise on screen through yellow (down right), green, cyan (left), blue and magenta.
//! [`wheel`] draws the legend. A vector that is not finite is black.
//!
//! **Depth** is grey: white at device depth 0 (near), black at 1 (far), linear in device depth.

use super::{DepthMap, MotionField};
use crate::tasks::{Parallel, ParallelSliceMut};
use crate::{Error, ErrorKind, Picture, Result};

/// Draws `field` into `out`, which has the same size; see the module for the colours.
///
/// # Errors
/// `InvalidArgument` when the sizes differ, or `full_scale` is not a positive finite number of pixels.
pub fn motion(field: &MotionField, full_scale: f32, out: &mut Picture) -> Result<()> {
    if !(full_scale > 0.0 && full_scale.is_finite()) {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("a full scale of {full_scale} pixels"))
            .field("full_scale")
            .remedy("Pass a positive number of pixels"));
    }
    check_size(field.size(), out)?;
    let width = field.width() as usize;
    out.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
        let vectors = row_values(field.vectors(), field.columns(), field.tile(), row);
        for (pixel, [x, y]) in pixels.iter_mut().zip(vectors) {
            *pixel = wheel_colour(x.to_f32() / full_scale, y.to_f32() / full_scale);
        }
    });
    Ok(())
}

/// Draws `map` as grey into `out`, which has the same size.
///
/// # Errors
/// `InvalidArgument` when the sizes differ.
pub fn depth(map: &DepthMap, out: &mut Picture) -> Result<()> {
    check_size(map.size(), out)?;
    for (row, pixels) in out.pixels_mut().chunks_mut(map.width() as usize).enumerate() {
        for (pixel, depth) in pixels.iter_mut().zip(row_values(map.depth(), map.columns(), map.tile(), row)) {
            let depth = if depth.is_nan() { 1.0 } else { depth.clamp(0.0, 1.0) };
            let grey = level(1.0 - depth);
            *pixel = [grey, grey, grey, 255];
        }
    }
    Ok(())
}

/// The legend of [`motion`]: a disc `side` pixels wide whose rim stands for `full_scale`, on transparent ground.
/// Each pixel has the colour of the vector from the centre to it.
///
/// # Errors
/// As [`Picture::new`].
pub fn wheel(side: u32) -> Result<Picture> {
    let mut picture = Picture::new(side, side)?;
    let radius = side as f32 / 2.0;
    for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
        let along = |at: usize| (at as f32 + 0.5) / radius - 1.0;
        let (x, y) = (along(i % side as usize), along(i / side as usize));
        *pixel = if x.hypot(y) <= 1.0 { wheel_colour(x, y) } else { [0; 4] };
    }
    Ok(picture)
}

/// The values for pixel row `row`, each repeated for the pixels of its tile.
fn row_values<T: Copy>(values: &[T], columns: u32, tile: u32, row: usize) -> impl Iterator<Item = T> {
    let (columns, tile) = (columns as usize, tile as usize);
    values[row / tile * columns..][..columns].iter().flat_map(move |&value| std::iter::repeat_n(value, tile))
}

fn check_size(size: (u32, u32), out: &Picture) -> Result<()> {
    if size != out.size() {
        return Err(Error::new(
            ErrorKind::InvalidArgument,
            format!("the picture has {:?} pixels, the guidance {size:?}", out.size()),
        )
        .field("out"));
    }
    Ok(())
}

/// The colour of a vector in units of the full scale.
fn wheel_colour(x: f32, y: f32) -> [u8; 4] {
    let length = x.hypot(y);
    if !length.is_finite() {
        return [0, 0, 0, 255];
    }
    let saturation = length.min(1.0);
    // With y down, the angle grows clockwise on screen.
    let hue = y.atan2(x) / std::f32::consts::TAU * 6.0;
    // The HSV hexcone at value 1: a channel is full within one sextant of its own hue and gone two sextants away.
    let [r, g, b] = [0.0, 2.0, 4.0].map(|own: f32| {
        let apart = (hue - own).rem_euclid(6.0);
        let pure = (2.0 - apart.min(6.0 - apart)).clamp(0.0, 1.0);
        level(1.0 - saturation * (1.0 - pure))
    });
    [r, g, b, 255]
}

fn level(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::*;
    use crate::guidance::paper;

    #[test]
    fn the_wheel_shows_directions_and_lengths() {
        let vectors: [([f32; 2], [u8; 3]); 8] = [
            ([0.0, 0.0], [255, 255, 255]),
            ([8.0, 0.0], [255, 0, 0]),
            ([800.0, 0.0], [255, 0, 0]),
            ([4.0, 0.0], [255, 128, 128]),
            ([-8.0, 0.0], [0, 255, 255]),
            ([0.0, 8.0], [128, 255, 0]),
            ([0.0, -8.0], [127, 0, 255]),
            ([f32::NAN, 1.0], [0, 0, 0]),
        ];
        let field = vectors.iter().map(|(v, _)| v.map(f16::from_f32)).collect();
        let mut out = Picture::new(8, 1).unwrap();
        motion(&MotionField::from_vectors(8, 1, field).unwrap(), 8.0, &mut out).unwrap();
        for (pixel, (vector, colour)) in out.pixels().iter().zip(vectors) {
            for (have, want) in pixel.iter().zip(colour) {
                assert!(have.abs_diff(want) <= 1, "{vector:?}: {pixel:?}");
            }
        }
    }

    #[test]
    fn every_pixel_of_a_tile_has_its_colour() {
        let mut field = MotionField::tiled(19, 9, 8).unwrap();
        field.vectors_mut().iter_mut().zip(1..).for_each(|(v, i)| *v = [f16::from_f32(i as f32), f16::ZERO]);
        let mut map = DepthMap::tiled(19, 9, 8, paper::PROJECTION).unwrap();
        map.depth_mut().iter_mut().zip(1..).for_each(|(v, i)| *v = i as f32 / 8.0);
        let (mut moved, mut deep) = (Picture::new(19, 9).unwrap(), Picture::new(19, 9).unwrap());
        motion(&field, 8.0, &mut moved).unwrap();
        depth(&map, &mut deep).unwrap();
        for pixel in 0..19 * 9 {
            let tile = (pixel / 19 / 8 * 3 + pixel % 19 / 8 + 1) as f32;
            assert_eq!(moved.pixels()[pixel], wheel_colour(tile / 8.0, 0.0));
            assert_eq!(deep.pixels()[pixel][0], level(1.0 - tile / 8.0));
        }
    }

    #[test]
    fn the_legend_has_the_colours_of_its_vectors() {
        let legend = wheel(9).unwrap();
        assert_eq!(legend.pixels()[0], [0; 4]);
        assert_eq!(legend.pixels()[4 * 9 + 4], [255, 255, 255, 255]);
        let right = legend.pixels()[4 * 9 + 8];
        assert!(right[0] == 255 && right[1] == right[2] && right[1] < 40, "{right:?}");
    }

    #[test]
    fn depth_is_white_near_and_black_far() {
        let mut map = DepthMap::new(4, 1, paper::PROJECTION).unwrap();
        map.depth_mut().copy_from_slice(&[0.0, 0.5, 1.0, f32::NAN]);
        let mut out = Picture::new(4, 1).unwrap();
        depth(&map, &mut out).unwrap();
        assert_eq!(out.pixels().iter().map(|p| p[0]).collect::<Vec<_>>(), [255, 128, 0, 0]);
    }

    #[test]
    fn bad_arguments_are_refused() {
        let mut out = Picture::new(3, 2).unwrap();
        let field = MotionField::new(2, 3).unwrap();
        assert_eq!(motion(&field, 1.0, &mut out).unwrap_err().offending_field(), Some("out"));
        for scale in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(motion(&field, scale, &mut out).unwrap_err().offending_field(), Some("full_scale"));
        }
        assert!(wheel(0).is_err());
    }
}
