//! The depth map, and conversion of a host's depth.

use super::tile_count;
use crate::allocate;
use crate::{Error, ErrorKind, Result};

/// The camera that device depth belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    near: f32,
    far: f32,
    vertical_fov: f32,
}

impl Projection {
    /// A perspective camera: near and far plane in world units, vertical field of view in radians.
    /// `far` may be infinite.
    ///
    /// # Errors
    /// `InvalidArgument` unless 0 < `near` < `far` and 0 < `vertical_fov` < pi.
    pub fn new(near: f32, far: f32, vertical_fov: f32) -> Result<Self> {
        let refuse = |field: &str, cause: String| Err(Error::new(ErrorKind::InvalidArgument, cause).field(field));
        if !(near > 0.0 && near.is_finite()) {
            return refuse("near", format!("the near plane cannot be at {near}"));
        }
        if far.is_nan() || far <= near {
            return refuse("far", format!("the far plane at {far} is not behind the near plane at {near}"));
        }
        if !(vertical_fov > 0.0 && vertical_fov < std::f32::consts::PI) {
            return refuse("vertical_fov", format!("a field of view of {vertical_fov} rad is not between 0 and pi"));
        }
        Ok(Self { near, far, vertical_fov })
    }

    /// For constants of this module, which must meet the conditions of [`Projection::new`].
    pub(super) const fn constant(near: f32, far: f32, vertical_fov: f32) -> Self {
        Self { near, far, vertical_fov }
    }

    /// Distance of the near plane, in world units.
    pub fn near(&self) -> f32 {
        self.near
    }

    /// Distance of the far plane, in world units; may be infinite.
    pub fn far(&self) -> f32 {
        self.far
    }

    /// Vertical field of view in radians.
    pub fn vertical_fov(&self) -> f32 {
        self.vertical_fov
    }

    /// Device depth of a point at view distance `z`: `far (z - near) / (z (far - near))`, clamped to [0, 1].
    pub fn device_depth(&self, z: f32) -> f32 {
        // In f64, and in a form that also works for an infinite far plane.
        let (z, near, inverse_far) = (f64::from(z), f64::from(self.near), 1.0 / f64::from(self.far));
        if z <= near {
            return 0.0;
        }
        ((1.0 - near / z) / (1.0 - near * inverse_far)).min(1.0) as f32
    }
}

/// Encoding of a host's depth values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DepthEncoding {
    /// Device depth with 1 near and 0 far ("reversed z").
    pub inverted: bool,
    /// Distance along the view axis in the world units of the projection, instead of device depth.
    pub linear: bool,
}

/// Device depth in [0, 1], 0 near, of the current picture: one value per pixel, or one per square tile of 8 or 16 pixels. The last
/// column and row of tiles may extend outside the picture. Rows run top to bottom without padding.
#[derive(Clone)]
pub struct DepthMap {
    width: u32,
    height: u32,
    tile: u32,
    depth: Vec<f32>,
    /// Whether all values are known to be equal, so that readers can skip the scan.
    is_uniform: bool,
    projection: Projection,
}

/// Maps are equal if their values are; `is_uniform` does not count.
impl PartialEq for DepthMap {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height, self.tile, self.projection)
            == (other.width, other.height, other.tile, other.projection)
            && self.depth == other.depth
    }
}

impl DepthMap {
    /// A map with every pixel at the near plane, one value per pixel, each side 1 to [`MAX_SIDE`](crate::MAX_SIDE).
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside that range, `OutOfMemory` when it cannot be allocated.
    pub fn new(width: u32, height: u32, projection: Projection) -> Result<Self> {
        Self::tiled(width, height, 1, projection)
    }

    /// A map with every pixel at the near plane, one value per square of `tile` x `tile` pixels: 1, 8 or 16.
    ///
    /// # Errors
    /// As [`new`](Self::new), and `InvalidArgument` for another tile.
    pub fn tiled(width: u32, height: u32, tile: u32, projection: Projection) -> Result<Self> {
        let len = tile_count(width, height, tile)?;
        Ok(Self { width, height, tile, depth: allocate::filled(len, 0.0)?, is_uniform: true, projection })
    }

    /// Takes a host's `values`, `width * height` of them, and converts them to device depth with 0 near. Values outside
    /// the range of `encoding` are clamped to it; NaN counts as far.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE), a buffer of another length, or an
    /// encoding that is both inverted and linear, which has no meaning.
    pub fn from_host(
        width: u32,
        height: u32,
        mut values: Vec<f32>,
        encoding: DepthEncoding,
        projection: Projection,
    ) -> Result<Self> {
        let len = tile_count(width, height, 1)?;
        if values.len() != len {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a depth map of {width} x {height} has {len} values, the buffer has {}", values.len()),
            )
            .field("values"));
        }
        let convert: fn(f32, &Projection) -> f32 = match encoding {
            DepthEncoding { inverted: false, linear: false } => |v, _| v.clamp(0.0, 1.0),
            DepthEncoding { inverted: true, linear: false } => |v, _| 1.0 - v.clamp(0.0, 1.0),
            DepthEncoding { inverted: false, linear: true } => |v, camera| camera.device_depth(v),
            DepthEncoding { inverted: true, linear: true } => {
                return Err(Error::new(ErrorKind::InvalidArgument, "depth cannot be both inverted and linear")
                    .field("encoding")
                    .remedy("Clear `inverted`: a distance along the view axis always grows away from the camera"));
            }
        };
        for v in &mut values {
            *v = if v.is_nan() { 1.0 } else { convert(*v, &projection) };
        }
        Ok(Self { width, height, tile: 1, depth: values, is_uniform: false, projection })
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

    /// The side of the squares that have one value each, in pixels: 1, 8 or 16.
    pub fn tile(&self) -> u32 {
        self.tile
    }

    /// Values in a row.
    pub fn columns(&self) -> u32 {
        self.width.div_ceil(self.tile)
    }

    /// Rows of values.
    pub fn rows(&self) -> u32 {
        self.height.div_ceil(self.tile)
    }

    /// All values, row by row: [`columns`](Self::columns) times [`rows`](Self::rows).
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// All values, writable. Readers clamp them to [0, 1] and treat NaN as far.
    pub fn depth_mut(&mut self) -> &mut [f32] {
        self.is_uniform = false;
        &mut self.depth
    }

    /// Sets all values to `depth`. Does nothing if the map is known to be uniform at `depth`.
    pub fn fill(&mut self, depth: f32) {
        if self.uniform_value() != Some(depth) {
            self.depth.fill(depth);
            self.is_uniform = true;
        }
    }

    /// The depth of all pixels, if it is known to be uniform: after [`fill`](Self::fill), or for a map of `new` or `tiled` that was not
    /// written.
    pub fn uniform_value(&self) -> Option<f32> {
        self.depth.first().copied().filter(|_| self.is_uniform)
    }

    /// The camera the values belong to.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Sets the camera the values belong to; the values stay as they are.
    pub fn set_projection(&mut self, projection: Projection) {
        self.projection = projection;
    }
}

impl std::fmt::Debug for DepthMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "DepthMap({} x {}, tiles of {}, {:?})", self.width, self.height, self.tile, self.projection)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_known_to_be_uniform_from_fill_until_the_next_write() {
        let projection = Projection::new(0.1, 100.0, 1.0).unwrap();
        let mut depth = DepthMap::new(4, 3, projection).unwrap();
        assert_eq!(depth.uniform_value(), Some(0.0));
        depth.fill(0.5);
        assert_eq!((depth.uniform_value(), depth.depth()), (Some(0.5), &[0.5; 12][..]));
        let known = depth.clone();
        depth.depth_mut()[7] = 0.5;
        assert_eq!(depth.uniform_value(), None);
        assert!(depth == known);
        depth.depth_mut()[7] = 0.25;
        assert!(depth != known);
        depth.fill(0.5);
        assert_eq!(depth.depth(), known.depth());
    }

    fn camera() -> Projection {
        Projection::new(0.1, 100.0, 1.0).unwrap()
    }

    fn convert(values: &[f32], inverted: bool, linear: bool, projection: Projection) -> Vec<f32> {
        let encoding = DepthEncoding { inverted, linear };
        DepthMap::from_host(values.len() as u32, 1, values.to_vec(), encoding, projection).unwrap().depth().to_vec()
    }

    #[test]
    fn device_depth_is_clamped_and_nan_is_far() {
        let host = [-0.5, 0.0, 0.25, 1.0, 7.0, f32::NAN, f32::INFINITY];
        assert_eq!(convert(&host, false, false, camera()), [0.0, 0.0, 0.25, 1.0, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn inverted_depth_is_converted() {
        assert_eq!(convert(&[1.0, 0.75, 0.0, 2.0, f32::NAN], true, false, camera()), [0.0, 0.25, 1.0, 0.0, 1.0]);
    }

    #[test]
    fn linear_depth_follows_the_projection() {
        // far (z - near) / (z (far - near)), by hand: z = 0.2 gives 100 * 0.1 / (0.2 * 99.9).
        let host = [0.05, 0.1, 0.2, 100.0, 500.0, f32::INFINITY, f32::NAN];
        let device = convert(&host, false, true, camera());
        let expected = [0.0, 0.0, 0.500_500_5, 1.0, 1.0, 1.0, 1.0];
        for (have, want) in device.iter().zip(expected) {
            assert!((have - want).abs() < 1e-6, "{device:?}");
        }
        let infinite = Projection::new(0.1, f32::INFINITY, 1.0).unwrap();
        assert_eq!(convert(&[0.2, 0.4, f32::INFINITY], false, true, infinite), [0.5, 0.75, 1.0]);
    }

    #[test]
    fn contradictory_flags_and_wrong_lengths_are_refused() {
        let both = DepthEncoding { inverted: true, linear: true };
        assert_eq!(
            DepthMap::from_host(1, 1, vec![0.0], both, camera()).unwrap_err().kind(),
            ErrorKind::InvalidArgument
        );
        let short = DepthMap::from_host(2, 2, vec![0.0; 3], DepthEncoding::default(), camera()).unwrap_err();
        assert_eq!(short.offending_field(), Some("values"));
    }

    #[test]
    fn impossible_cameras_are_refused() {
        for (near, far, fov, field) in [
            (0.0, 1.0, 1.0, "near"),
            (f32::NAN, 1.0, 1.0, "near"),
            (1.0, 1.0, 1.0, "far"),
            (1.0, f32::NAN, 1.0, "far"),
            (0.1, 1.0, 0.0, "vertical_fov"),
            (0.1, 1.0, 3.2, "vertical_fov"),
            (0.1, 1.0, f32::NAN, "vertical_fov"),
        ] {
            assert_eq!(Projection::new(near, far, fov).unwrap_err().offending_field(), Some(field));
        }
    }
}
