//! The motion field.

use half::f16;

use super::{checked_area, filled};
use crate::{Error, ErrorKind, Result};

/// Motion vectors `[x, y]` in render pixels, one to a pixel of the current picture, pointing from the current picture
/// to the previous one, y down. Rows run top to bottom without padding.
#[derive(Clone, PartialEq)]
pub struct MotionField {
    width: u32,
    height: u32,
    vectors: Vec<[f16; 2]>,
}

impl MotionField {
    /// A field without motion, each side 1 to [`MAX_SIDE`](crate::MAX_SIDE).
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside that range, `OutOfMemory` when it cannot be allocated.
    pub fn new(width: u32, height: u32) -> Result<Self> {
        let len = checked_area(width, height)?;
        Ok(Self { width, height, vectors: filled(len, [f16::ZERO; 2])? })
    }

    /// Takes `vectors`, `width * height` of them.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE) or a buffer of another length.
    pub fn from_vectors(width: u32, height: u32, vectors: Vec<[f16; 2]>) -> Result<Self> {
        let len = checked_area(width, height)?;
        if vectors.len() != len {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a motion field of {width} x {height} has {len} vectors, the buffer has {}", vectors.len()),
            )
            .field("vectors"));
        }
        Ok(Self { width, height, vectors })
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

    /// All vectors, row by row.
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
        write!(f, "MotionField({} x {})", self.width, self.height)
    }
}
