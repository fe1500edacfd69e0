//! Motion and depth from the controls alone: a model of a walking camera over level ground.
//!
//! ```text
//! yaw, pitch   mouse counts times the angle per count; pitch clamped to its limit
//! velocity     from the keys W, A, S, D and shift, approached with a time constant
//! a pixel      below the horizon is on the ground, `height` below the camera; above it, at infinity
//! motion       position of that point in the previous picture minus its position in the current one, clamped to the picture's size
//! depth        device depth of that point
//! ```
//!
//! It needs no picture and no latent. It knows nothing of objects on the ground, items in the camera's hand, or obstacles. The values
//! of a [`WalkingCamera`] are specific to a world; without them this extractor is of no use.

use half::f16;

use super::{Guidance, MotionOrigin, Projection};
use crate::tasks::{Parallel, ParallelSliceMut, PoolLease};
use crate::world::{ControlInput, Key, WorldTime};
use crate::{Error, ErrorKind, Result};

/// Near plane of the depth, in world units; farther points than the far plane are clamped to it.
const NEAR: f32 = 0.1;
/// Far plane, in world units.
const FAR: f32 = 1000.0;
/// A point closer to the previous camera's plane than this, or behind it, was not visible.
const MIN_VIEW_DEPTH: f32 = 1e-3;
/// Keys for walking forwards, left, backwards and right, and for running.
const WALKING: [Key; 5] = [Key(b'W'), Key(b'A'), Key(b'S'), Key(b'D'), Key(0x10)];

/// Parameters of a camera that the controls move over level ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WalkingCamera {
    /// Vertical field of view, in radians.
    pub vertical_fov: f32,
    /// Radians of turn per mouse count.
    pub turn_per_count: f32,
    /// Largest pitch, up or down, in radians.
    pub max_pitch: f32,
    /// Walking speed, in world units per second.
    pub walk: f32,
    /// Running speed as a multiple of `walk`.
    pub run: f32,
    /// Time constant of starting and stopping, in seconds.
    pub ease: f32,
    /// Height above the ground, in world units.
    pub height: f32,
}

/// Integrates the controls of a walk, one time span after another from its start.
#[derive(Debug, Clone)]
pub struct Extractor {
    camera: WalkingCamera,
    yaw: f64,
    pitch: f64,
    /// East and north, in world units per second.
    velocity: [f64; 2],
    _threads: PoolLease,
}

/// Camera orientation: unit axes right, up and forward, in east, up, north coordinates.
type Axes = [[f64; 3]; 3];

impl Extractor {
    /// A camera at rest, pitched up by `pitch` radians.
    ///
    /// # Errors
    /// `InvalidArgument` for a parameter of `camera` that is not finite or not positive, a field of view of pi or more, a `max_pitch` of
    /// pi / 2 or more, and a `pitch` outside `-max_pitch` to `max_pitch`.
    pub fn new(camera: WalkingCamera, pitch: f32) -> Result<Self> {
        let refuse = |field: &str, value: f32| {
            Err(Error::new(ErrorKind::InvalidArgument, format!("{value} cannot be")).field(field))
        };
        let WalkingCamera { vertical_fov, turn_per_count, max_pitch, walk, run, ease, height } = camera;
        for (value, field) in [
            (vertical_fov, "vertical_fov"),
            (turn_per_count, "turn_per_count"),
            (max_pitch, "max_pitch"),
            (walk, "walk"),
            (run, "run"),
            (ease, "ease"),
            (height, "height"),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(field, value);
            }
        }
        if vertical_fov >= std::f32::consts::PI {
            return refuse("vertical_fov", vertical_fov);
        }
        if max_pitch >= std::f32::consts::FRAC_PI_2 {
            return refuse("max_pitch", max_pitch);
        }
        if pitch.is_nan() || pitch.abs() > max_pitch {
            return refuse("pitch", pitch);
        }
        Ok(Self { camera, yaw: 0.0, pitch: pitch.into(), velocity: [0.0; 2], _threads: PoolLease::new() })
    }

    /// Writes the guidance for a step of length `time` with `controls` to `out`, at the `render` size `(width, height)` in square pixels.
    /// `out` is resized to one value per pixel if needed. The next call continues from the camera's new state.
    ///
    /// # Errors
    /// `InvalidArgument` for a render size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE), after which the camera is unchanged;
    /// `OutOfMemory` when `out` cannot grow.
    pub fn extract(
        &mut self,
        controls: &ControlInput,
        time: WorldTime,
        render: (u32, u32),
        out: &mut Guidance,
    ) -> Result<()> {
        let projection = Projection::new(NEAR, FAR, self.camera.vertical_fov)?;
        out.make_per_pixel(render, projection, MotionOrigin::Geometry)?;
        let before = self.axes();
        let travelled = self.advance(controls, time.seconds());
        self.write(&before, travelled, out);
        Ok(())
    }

    /// Turns and moves the camera; returns the distance travelled, east and north, in world units.
    fn advance(&mut self, controls: &ControlInput, seconds: f64) -> [f64; 2] {
        let (camera, [dx, dy]) = (self.camera, controls.mouse().map(f64::from));
        let turn = dx * f64::from(camera.turn_per_count);
        let limit = f64::from(camera.max_pitch);
        self.pitch = (self.pitch - dy * f64::from(camera.turn_per_count)).clamp(-limit, limit);
        let [w, a, s, d, shift] = WALKING.map(|key| f64::from(u8::from(controls.keys().contains(key))));
        let (across, along) = (d - a, w - s);
        let speed = f64::from(camera.walk) * if shift > 0.0 { f64::from(camera.run) } else { 1.0 };
        let speed = speed / across.hypot(along).max(1.0);
        // The camera turns during the whole step: use the yaw at its middle.
        let (sin, cos) = (self.yaw + 0.5 * turn).sin_cos();
        let target_velocity = [(cos * across + sin * along) * speed, (cos * along - sin * across) * speed];
        self.yaw += turn;
        let ease = f64::from(camera.ease);
        let kept = (-seconds / ease).exp();
        let travelled = [0, 1].map(|axis| {
            target_velocity[axis] * seconds + (self.velocity[axis] - target_velocity[axis]) * ease * (1.0 - kept)
        });
        self.velocity = [0, 1].map(|axis| target_velocity[axis] + (self.velocity[axis] - target_velocity[axis]) * kept);
        travelled
    }

    fn axes(&self) -> Axes {
        let ((sy, cy), (sp, cp)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        [[cy, 0.0, -sy], [-sy * sp, cp, -cy * sp], [sy * cp, sp, cy * cp]]
    }

    /// Writes the guidance for a camera that had the axes `before` and has moved by `travelled` since.
    fn write(&self, before: &Axes, travelled: [f64; 2], out: &mut Guidance) {
        let (width, height) = (out.size().0 as usize, out.size().1 as usize);
        let limit = [width as f32, height as f32];
        let (centre, now) = ([width as f64 / 2.0, height as f64 / 2.0], self.axes());
        let focal = centre[1] / (f64::from(self.camera.vertical_fov) / 2.0).tan();
        let eye_height = f64::from(self.camera.height);
        let projection = out.depth().projection();
        let Guidance { motion, depth, .. } = out;
        let rows = motion.vectors_mut().par_chunks_mut(width).zip(depth.depth_mut().par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (vectors, depths))| {
            for (x, (vector, depth)) in vectors.iter_mut().zip(depths).enumerate() {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let ray = [(at[0] - centre[0]) / focal, (centre[1] - at[1]) / focal, 1.0];
                let along = [0, 1, 2].map(|i| (0..3).map(|axis| now[axis][i] * ray[axis]).sum::<f64>());
                // Distance along the ray to the ground; infinite at and above the horizon.
                let distance = if along[1] < 0.0 { eye_height / -along[1] } else { f64::INFINITY };
                let point = if distance.is_finite() {
                    [along[0] * distance + travelled[0], along[1] * distance, along[2] * distance + travelled[1]]
                } else {
                    along
                };
                let seen = before.map(|axis| (0..3).map(|i| axis[i] * point[i]).sum::<f64>());
                let was = if seen[2] > f64::from(MIN_VIEW_DEPTH) {
                    [centre[0] + focal * seen[0] / seen[2], centre[1] - focal * seen[1] / seen[2]]
                } else {
                    at
                };
                *vector = [0, 1].map(|i| f16::from_f32(((was[i] - at[i]) as f32).clamp(-limit[i], limit[i])));
                *depth = projection.device_depth(distance as f32);
            }
        });
    }
}

#[cfg(test)]
mod tests;
