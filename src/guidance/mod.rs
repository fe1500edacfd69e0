//! Motion and depth for a pair of anchors.
//!
//! One convention holds everywhere: **motion** is in render pixels, stored at the *current* picture's pixel and
//! pointing from the current picture to the previous one, y down. **Depth** is device depth in [0, 1], 0 near, of a
//! stated near plane, far plane and vertical field of view. Both have render size.

pub mod camera;
mod depth;
mod interpolation;
mod latent;
pub mod latent_flow;
mod motion;
pub mod paper;
pub mod picture_flow;
mod resample;
pub mod visual;

pub use depth::{DepthEncoding, DepthMap, Projection};
pub use latent::LatentView;
pub use motion::MotionField;

use crate::Result;

/// Where a motion field came from. Frame generators choose their thresholds by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MotionOrigin {
    /// A renderer's motion vectors, or a known camera and depth. Edges are accurate to a pixel, and depth tells which side is nearer.
    #[default]
    Geometry,
    /// Spatial gradients of latents ([`paper`]), with the depth estimated beside them.
    LatentGradient,
    /// Optical flow between pictures ([`picture_flow`]) or latents ([`latent_flow`]). Edges are accurate to a pixel or two, and depth is
    /// unknown: frames are a little soft at edges.
    OpticalFlow,
}

impl MotionOrigin {
    /// Whether the motion is optical flow.
    pub fn is_optical_flow(self) -> bool {
        self == Self::OpticalFlow
    }
}

/// Motion and depth of one pair of anchors, of the same size. Each may be per pixel or per tile, with its own tile size.
#[derive(Debug, Clone, PartialEq)]
pub struct Guidance {
    motion: MotionField,
    depth: DepthMap,
    origin: MotionOrigin,
}

impl Guidance {
    /// A buffer: zero motion, and depth at the near plane of `projection`, both per pixel. Its origin is [`MotionOrigin::Geometry`] until
    /// an extractor writes into it.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE), `OutOfMemory` when it cannot be
    /// allocated.
    pub fn new(width: u32, height: u32, projection: Projection) -> Result<Self> {
        Ok(Self {
            motion: MotionField::new(width, height)?,
            depth: DepthMap::new(width, height, projection)?,
            origin: MotionOrigin::default(),
        })
    }

    /// Combines a motion field that came from `origin` and a depth map of the same size.
    ///
    /// # Errors
    /// `InvalidArgument` when their sizes differ.
    pub fn from_parts(motion: MotionField, depth: DepthMap, origin: MotionOrigin) -> Result<Self> {
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
        Ok(Self { motion, depth, origin })
    }

    /// Prepares the buffer for an extractor that writes every pixel of `width` x `height`. Allocates anew if the size differs or values are
    /// per tile; otherwise the old values stay, and the caller overwrites them. Sets `projection` and `origin` in either case.
    pub(crate) fn make_per_pixel(
        &mut self,
        (width, height): (u32, u32),
        projection: Projection,
        origin: MotionOrigin,
    ) -> Result<()> {
        if self.size() != (width, height) || self.motion.tile() != 1 || self.depth.tile() != 1 {
            *self = Self::new(width, height, projection)?;
        }
        self.depth.set_projection(projection);
        self.origin = origin;
        Ok(())
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

    /// Where the motion came from.
    pub fn origin(&self) -> MotionOrigin {
        self.origin
    }

    /// `(width, height)` of both, in render pixels.
    pub fn size(&self) -> (u32, u32) {
        self.motion.size()
    }
}

/// Number of values in a buffer with one value per square of `tile` x `tile` pixels.
fn tile_count(width: u32, height: u32, tile: u32) -> Result<usize> {
    let refuse = |cause: String, field: &str, remedy: String| {
        Err(crate::Error::new(crate::ErrorKind::InvalidArgument, cause).field(field).remedy(remedy))
    };
    let sides = 1..=crate::MAX_SIDE;
    if !sides.contains(&width) || !sides.contains(&height) {
        let remedy = format!("Use a width and a height from 1 to {}", crate::MAX_SIDE);
        return refuse(format!("guidance of {width} x {height} pixels cannot be made"), "size", remedy);
    }
    if !matches!(tile, 1 | 8 | 16) {
        return refuse(format!("guidance in tiles of {tile} pixels"), "tile", "Use tiles of 1, 8 or 16 pixels".into());
    }
    Ok(width.div_ceil(tile) as usize * height.div_ceil(tile) as usize)
}

/// Refuses latents of two shapes.
fn check_shapes(z0: LatentView<'_>, z1: LatentView<'_>) -> Result<()> {
    if z0.shape() == z1.shape() {
        return Ok(());
    }
    Err(crate::Error::new(
        crate::ErrorKind::InvalidArgument,
        format!("the latents have shapes {:?} and {:?}", z0.shape(), z1.shape()),
    )
    .field("z0"))
}

/// The constants of these modules that shaders have too, for `constants.hlsli`.
#[cfg(test)]
pub(crate) fn shader_constants() -> Vec<crate::shader_constants::Constants> {
    [picture_flow::shader_constants(), vec![resample::SHADER_CONSTANTS, paper::SHADER_CONSTANTS]].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn make_per_pixel_reallocates_only_for_tiles_or_another_size() {
        let tiled = MotionField::tiled(20, 10, 8).unwrap();
        let depth = DepthMap::new(20, 10, paper::PROJECTION).unwrap();
        let mut guidance = Guidance::from_parts(tiled, depth, MotionOrigin::Geometry).unwrap();
        guidance.make_per_pixel((20, 10), paper::PROJECTION, MotionOrigin::LatentGradient).unwrap();
        assert_eq!((guidance.motion().tile(), guidance.motion().vectors().len()), (1, 200));
        assert_eq!(guidance.origin(), MotionOrigin::LatentGradient);
        let before = guidance.motion().vectors().as_ptr();
        guidance.make_per_pixel((20, 10), paper::PROJECTION, MotionOrigin::LatentGradient).unwrap();
        assert_eq!(guidance.motion().vectors().as_ptr(), before);
        guidance.make_per_pixel((10, 20), paper::PROJECTION, MotionOrigin::LatentGradient).unwrap();
        assert_eq!(guidance.size(), (10, 20));
    }
}
