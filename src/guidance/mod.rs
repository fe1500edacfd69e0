//! Motion and depth for a pair of anchors.
//!
//! One convention holds everywhere: **motion** is in render pixels, stored at the *current* picture's pixel and
//! pointing from the current picture to the previous one, y down. **Depth** is device depth in [0, 1], 0 near, of a
//! stated near plane, far plane and vertical field of view. Both live at render size.

mod depth;
mod latent;
mod motion;
pub mod paper;
pub mod picture_flow;
pub mod visual;

pub use depth::{DepthEncoding, DepthMap, Projection};
pub use latent::LatentView;
pub use motion::MotionField;

use crate::Result;

/// Motion and depth of one pair of anchors, both of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Guidance {
    motion: MotionField,
    depth: DepthMap,
}

impl Guidance {
    /// No motion, and everything at the near plane of `projection`: a buffer for an extractor to fill.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE), `OutOfMemory` when it cannot be
    /// allocated.
    pub fn new(width: u32, height: u32, projection: Projection) -> Result<Self> {
        Ok(Self { motion: MotionField::new(width, height)?, depth: DepthMap::new(width, height, projection)? })
    }

    /// Puts together a motion field and a depth map.
    ///
    /// # Errors
    /// `InvalidArgument` when their sizes differ.
    pub fn from_parts(motion: MotionField, depth: DepthMap) -> Result<Self> {
        if motion.size() != depth.size() {
            return Err(crate::Error::new(
                crate::ErrorKind::InvalidArgument,
                format!(
                    "the motion field has {} x {} pixels, the depth map {} x {}",
                    motion.width(),
                    motion.height(),
                    depth.width(),
                    depth.height()
                ),
            )
            .field("guidance"));
        }
        Ok(Self { motion, depth })
    }

    /// The motion field.
    pub fn motion(&self) -> &MotionField {
        &self.motion
    }

    /// The motion field, writable.
    pub fn motion_mut(&mut self) -> &mut MotionField {
        &mut self.motion
    }

    /// The depth map.
    pub fn depth(&self) -> &DepthMap {
        &self.depth
    }

    /// The depth map, writable.
    pub fn depth_mut(&mut self) -> &mut DepthMap {
        &mut self.depth
    }

    /// `(width, height)` of both, in render pixels.
    pub fn size(&self) -> (u32, u32) {
        self.motion.size()
    }
}

/// The number of pixels of a picture-sized buffer.
fn checked_area(width: u32, height: u32) -> Result<usize> {
    let sides = 1..=crate::MAX_SIDE;
    if !sides.contains(&width) || !sides.contains(&height) {
        return Err(crate::Error::new(
            crate::ErrorKind::InvalidArgument,
            format!("guidance of {width} x {height} pixels cannot be made"),
        )
        .field("size")
        .remedy(format!("Use a width and a height from 1 to {}", crate::MAX_SIDE)));
    }
    Ok(width as usize * height as usize)
}

/// `len` copies of `value`, with refusal instead of an abort where memory is short.
fn filled<T: Clone>(len: usize, value: T) -> Result<Vec<T>> {
    let mut values = Vec::new();
    values.try_reserve_exact(len).map_err(|_| {
        crate::Error::new(
            crate::ErrorKind::OutOfMemory,
            format!("a buffer of {len} values of {} bytes cannot be allocated", size_of::<T>()),
        )
    })?;
    values.resize(len, value);
    Ok(values)
}
