//! The motion field.

use half::f16;

use super::tile_count;
use crate::allocate;
use crate::{Error, ErrorKind, Result};

/// Motion vectors `[x, y]` in render pixels, stored at the current picture's pixels and pointing from the current picture to
/// the previous one, y down. There is one vector per pixel, or one per square tile of 8 or 16 pixels. The last column and row
/// of tiles may extend outside the picture. Rows run top to bottom without padding.
#[derive(Clone, PartialEq)]
pub struct MotionField {
    width: u32,
    height: u32,
    tile: u32,
    vectors: Vec<[f16; 2]>,
}

impl MotionField {
    /// A field of zero vectors, one per pixel, each side 1 to [`MAX_SIDE`](crate::MAX_SIDE).
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside that range, `OutOfMemory` when it cannot be allocated.
    pub fn new(width: u32, height: u32) -> Result<Self> {
        Self::tiled(width, height, 1)
    }

    /// A field of zero vectors, one per square of `tile` x `tile` pixels: 1, 8 or 16.
    ///
    /// # Errors
    /// As [`new`](Self::new), and `InvalidArgument` for another tile.
    pub fn tiled(width: u32, height: u32, tile: u32) -> Result<Self> {
        let len = tile_count(width, height, tile)?;
        Ok(Self { width, height, tile, vectors: allocate::filled(len, [f16::ZERO; 2])? })
    }

    /// Takes `vectors`, `width * height` of them.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE) or a buffer of another length.
    pub fn from_vectors(width: u32, height: u32, vectors: Vec<[f16; 2]>) -> Result<Self> {
        let len = tile_count(width, height, 1)?;
        if vectors.len() != len {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a motion field of {width} x {height} has {len} vectors, the buffer has {}", vectors.len()),
            )
            .field("vectors"));
        }
        Ok(Self { width, height, tile: 1, vectors })
    }

    /// Width in render pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in render pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// `(width, height)` in render pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The side of the squares that have one vector each, in pixels: 1, 8 or 16.
    pub fn tile(&self) -> u32 {
        self.tile
    }

    /// Vectors in a row.
    pub fn columns(&self) -> u32 {
        self.width.div_ceil(self.tile)
    }

    /// Rows of vectors.
    pub fn rows(&self) -> u32 {
        self.height.div_ceil(self.tile)
    }

    /// The vector of pixel (x, y).
    ///
    /// # Panics
    /// When the pixel is outside the field.
    pub fn at(&self, x: u32, y: u32) -> [f16; 2] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of a field of {} x {}", self.width, self.height);
        self.vectors[(y / self.tile) as usize * self.columns() as usize + (x / self.tile) as usize]
    }

    /// All vectors, row by row: [`columns`](Self::columns) times [`rows`](Self::rows).
    pub fn vectors(&self) -> &[[f16; 2]] {
        &self.vectors
    }

    /// All vectors, writable.
    pub fn vectors_mut(&mut self) -> &mut [[f16; 2]] {
        &mut self.vectors
    }

    /// The longest finite vector, in render pixels.
    pub fn peak(&self) -> f32 {
        let length = |[x, y]: &[f16; 2]| x.to_f32().hypot(y.to_f32());
        self.vectors.iter().map(length).filter(|l| l.is_finite()).fold(0.0, f32::max)
    }
}

impl std::fmt::Debug for MotionField {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "MotionField({} x {}, tiles of {})", self.width, self.height, self.tile)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_has_one_vector() {
        let mut field = MotionField::tiled(19, 9, 8).unwrap();
        assert_eq!((field.columns(), field.rows(), field.tile(), field.vectors().len()), (3, 2, 8, 6));
        field.vectors_mut()[5] = [f16::ONE; 2];
        assert_eq!(
            (field.at(18, 8), field.at(15, 8), field.at(18, 7)),
            ([f16::ONE; 2], [f16::ZERO; 2], [f16::ZERO; 2])
        );
        assert_eq!(MotionField::new(19, 9).unwrap().vectors().len(), 19 * 9);
    }

    #[test]
    fn other_tiles_and_sizes_are_refused() {
        for tile in [0, 2, 4, 17, 32] {
            assert_eq!(MotionField::tiled(64, 64, tile).unwrap_err().offending_field(), Some("tile"));
        }
        assert_eq!(MotionField::tiled(0, 64, 8).unwrap_err().offending_field(), Some("size"));
    }
}
