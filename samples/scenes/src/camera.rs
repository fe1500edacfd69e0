//! The pinhole camera and its depth.

use glam::{Vec2, Vec3};

/// Nearest visible distance along the view axis, in metres.
pub const NEAR: f32 = 0.1;
/// Distance along the view axis that maps to depth 1, in metres; the sky has this depth.
pub const FAR: f32 = 1000.0;

/// A pinhole camera. The world is left-handed: x east, y up, z north, in metres; yaw 0 looks north, positive yaw turns right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position of the eye.
    pub position: Vec3,
    /// Turn to the right, in radians.
    pub yaw: f32,
    /// Upward tilt, in radians.
    pub pitch: f32,
    /// Vertical field of view, in radians.
    pub vertical_fov: f32,
    /// Aspect ratio of the view. A picture of another ratio has non-square pixels.
    pub aspect: f32,
}

/// A camera's axes and scales for one picture size.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Position of the eye.
    pub eye: Vec3,
    /// Unit axes: right, up, forward.
    pub axes: [Vec3; 3],
    /// Focal lengths: pixels per unit of x/z and of y/z.
    pub focal: Vec2,
    /// The picture's centre, in pixels.
    pub centre: Vec2,
}

impl Camera {
    /// The camera's view for a picture of `width` x `height` pixels.
    pub fn view(&self, width: u32, height: u32) -> View {
        let (sy, cy) = self.yaw.sin_cos();
        let (sp, cp) = self.pitch.sin_cos();
        let forward = Vec3::new(sy * cp, sp, cy * cp);
        let right = Vec3::new(cy, 0.0, -sy);
        let up = forward.cross(right);
        let half = (self.vertical_fov * 0.5).tan();
        let (w, h) = (width as f32, height as f32);
        View {
            eye: self.position,
            axes: [right, up, forward],
            focal: Vec2::new(w * 0.5 / (half * self.aspect), h * 0.5 / half),
            centre: Vec2::new(w * 0.5, h * 0.5),
        }
    }
}

impl View {
    /// Transforms a world point to view space: right, up, forward of the eye.
    #[inline]
    pub fn to_view(&self, p: Vec3) -> Vec3 {
        self.rotate(p - self.eye)
    }

    /// Transforms a world direction to view space.
    #[inline]
    pub fn rotate(&self, d: Vec3) -> Vec3 {
        Vec3::new(d.dot(self.axes[0]), d.dot(self.axes[1]), d.dot(self.axes[2]))
    }

    /// Transforms a view-space direction to the world.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.axes[0] * v.x + self.axes[1] * v.y + self.axes[2] * v.z
    }

    /// Pixel position of a view-space point in front of the eye; (0, 0) is the picture's top left corner.
    #[inline]
    pub fn project(&self, v: Vec3) -> Vec2 {
        Vec2::new(self.centre.x + self.focal.x * v.x / v.z, self.centre.y - self.focal.y * v.y / v.z)
    }

    /// View-space direction through a pixel position, with z = 1.
    #[inline]
    pub fn ray(&self, pixel: Vec2) -> Vec3 {
        Vec3::new((pixel.x - self.centre.x) / self.focal.x, (self.centre.y - pixel.y) / self.focal.y, 1.0)
    }
}

/// Device depth of a distance along the view axis: 0 at [`NEAR`], 1 at [`FAR`] (Direct3D's perspective depth).
#[inline]
pub fn device_depth(z: f32) -> f32 {
    (FAR / (FAR - NEAR) * (1.0 - NEAR / z)).clamp(0.0, 1.0)
}

/// Distance along the view axis of a device depth: the inverse of [`device_depth`].
#[inline]
pub fn view_distance(depth: f32) -> f32 {
    NEAR / (1.0 - depth * (FAR - NEAR) / FAR).max(NEAR / FAR)
}
