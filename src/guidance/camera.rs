//! Motion and depth from the controls alone: how the eye moves that they steer, over level ground.
//!
//! ```text
//! yaw, pitch   the mouse's counts times the turn of a count; pitch cut to its limit
//! velocity     that of the keys W, A, S, D and shift, reached with a time constant
//! a pixel      below the horizon lies on the ground, `height` under the eye; above it, infinitely far
//! motion       where that point was in the picture of the eye before, less where it is; cut to the picture's size
//! depth        its device depth
//! ```
//!
//! It needs no picture and no latent, and knows nothing of what stands on the ground, of what the eye holds, and of what stops
//! it. The numbers of an [`Eye`] are a world's own: who does not know them has no use for it.

use half::f16;

use super::{Guidance, Projection};
use crate::tasks::{Parallel, ParallelSliceMut, Use};
use crate::world::{ControlInput, Key, WorldTime};
use crate::{Error, ErrorKind, Result};

/// The planes between which depth is told, in units of the world; what is farther lies on the far one.
const NEAR: f32 = 0.1;
/// See [`NEAR`].
const FAR: f32 = 1000.0;
/// A point nearer to the plane of the eye than this was not seen from it.
const LEAST_AHEAD: f32 = 1e-3;
/// The keys that walk: forwards, left, backwards, right, and the one that runs.
const WALKING: [Key; 5] = [Key(b'W'), Key(b'A'), Key(b'S'), Key(b'D'), Key(0x10)];

/// What is known of the eye that controls move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// Vertical field of view, in radians.
    pub vertical_fov: f32,
    /// Radians of turn for a count of the mouse.
    pub turn_per_count: f32,
    /// The farthest tilt, up or down, in radians.
    pub most_pitch: f32,
    /// Units of the world a second, walking.
    pub walk: f32,
    /// How many times as fast it runs.
    pub run: f32,
    /// Time constant of starting and stopping, in seconds.
    pub ease: f32,
    /// Height above the ground, in units of the world.
    pub height: f32,
}

/// Follows the controls of a walk, from its beginning on, span by span.
#[derive(Debug, Clone)]
pub struct Extractor {
    eye: Eye,
    yaw: f64,
    pitch: f64,
    /// East and north, in units a second.
    velocity: [f64; 2],
    _threads: Use,
}

/// Where the eye looks: its unit axes right, up and forward, in east, up and north.
type Axes = [[f64; 3]; 3];

impl Extractor {
    /// An eye at rest that looks up by `pitch` radians.
    ///
    /// # Errors
    /// `InvalidArgument` for a number of `eye` that is not finite or not positive, a field of view of half a turn or more, a farthest tilt
    /// of a quarter of a turn or more, and a `pitch` beyond it.
    pub fn new(eye: Eye, pitch: f32) -> Result<Self> {
        let refuse = |field: &str, value: f32| {
            Err(Error::new(ErrorKind::InvalidArgument, format!("{value} cannot be")).field(field))
        };
        let Eye { vertical_fov, turn_per_count, most_pitch, walk, run, ease, height } = eye;
        for (value, field) in [
            (vertical_fov, "vertical_fov"),
            (turn_per_count, "turn_per_count"),
            (most_pitch, "most_pitch"),
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
        if most_pitch >= std::f32::consts::FRAC_PI_2 {
            return refuse("most_pitch", most_pitch);
        }
        if pitch.is_nan() || pitch.abs() > most_pitch {
            return refuse("pitch", pitch);
        }
        Ok(Self { eye, yaw: 0.0, pitch: pitch.into(), velocity: [0.0; 2], _threads: Use::new() })
    }

    /// Fills `out` for the step that `controls` took in `time`, at the `render` size `(width, height)`, whose pixels are
    /// square; `out` becomes one of that size, per pixel, if it is another. The next call goes on from there.
    ///
    /// # Errors
    /// `InvalidArgument` for a render size outside 1 to [`MAX_SIDE`](crate::MAX_SIDE), after which the eye is where it was;
    /// `OutOfMemory` when `out` cannot grow.
    pub fn extract(
        &mut self,
        controls: &ControlInput,
        time: WorldTime,
        render: (u32, u32),
        out: &mut Guidance,
    ) -> Result<()> {
        let projection = Projection::new(NEAR, FAR, self.eye.vertical_fov)?;
        out.make_per_pixel(render, projection)?;
        let before = self.axes();
        let way = self.follow(controls, time.seconds());
        self.write(&before, way, out);
        Ok(())
    }

    /// Moves the eye, and says how far, east and north.
    fn follow(&mut self, controls: &ControlInput, seconds: f64) -> [f64; 2] {
        let (eye, [dx, dy]) = (self.eye, controls.mouse().map(f64::from));
        let turn = dx * f64::from(eye.turn_per_count);
        let limit = f64::from(eye.most_pitch);
        self.pitch = (self.pitch - dy * f64::from(eye.turn_per_count)).clamp(-limit, limit);
        let [w, a, s, d, shift] = WALKING.map(|key| f64::from(u8::from(controls.keys().contains(key))));
        let (across, along) = (d - a, w - s);
        let pace = f64::from(eye.walk) * if shift > 0.0 { f64::from(eye.run) } else { 1.0 };
        let pace = pace / across.hypot(along).max(1.0);
        // It turns all the while: the way is that of the middle.
        let (sin, cos) = (self.yaw + 0.5 * turn).sin_cos();
        let wish = [(cos * across + sin * along) * pace, (cos * along - sin * across) * pace];
        self.yaw += turn;
        let ease = f64::from(eye.ease);
        let kept = (-seconds / ease).exp();
        let way = [0, 1].map(|axis| wish[axis] * seconds + (self.velocity[axis] - wish[axis]) * ease * (1.0 - kept));
        self.velocity = [0, 1].map(|axis| wish[axis] + (self.velocity[axis] - wish[axis]) * kept);
        way
    }

    fn axes(&self) -> Axes {
        let ((sy, cy), (sp, cp)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        [[cy, 0.0, -sy], [-sy * sp, cp, -cy * sp], [sy * cp, sp, cy * cp]]
    }

    /// Writes what an eye sees that looked along `before` and has gone `way` since.
    fn write(&self, before: &Axes, way: [f64; 2], out: &mut Guidance) {
        let (width, height) = (out.size().0 as usize, out.size().1 as usize);
        let limit = [width as f32, height as f32];
        let (centre, now) = ([width as f64 / 2.0, height as f64 / 2.0], self.axes());
        let focal = centre[1] / (f64::from(self.eye.vertical_fov) / 2.0).tan();
        let eye_height = f64::from(self.eye.height);
        let projection = out.depth().projection();
        let Guidance { motion, depth } = out;
        let rows = motion.vectors_mut().par_chunks_mut(width).zip(depth.depth_mut().par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (vectors, depths))| {
            for (x, (vector, depth)) in vectors.iter_mut().zip(depths).enumerate() {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let ray = [(at[0] - centre[0]) / focal, (centre[1] - at[1]) / focal, 1.0];
                let along = [0, 1, 2].map(|i| (0..3).map(|axis| now[axis][i] * ray[axis]).sum::<f64>());
                // How far along the ray the ground is; what is not below the horizon is nowhere near.
                let distance = if along[1] < 0.0 { eye_height / -along[1] } else { f64::INFINITY };
                let point = if distance.is_finite() {
                    [along[0] * distance + way[0], along[1] * distance, along[2] * distance + way[1]]
                } else {
                    along
                };
                let seen = before.map(|axis| (0..3).map(|i| axis[i] * point[i]).sum::<f64>());
                let was = if seen[2] > f64::from(LEAST_AHEAD) {
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
