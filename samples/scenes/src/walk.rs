//! From controls to a camera: a walker on the path.

use std::str::FromStr;

use cairn::world::{ControlInput, Key};
use glam::{Vec2, Vec3};

use crate::camera::Camera;
use crate::render::Moment;
use crate::scene::Scene;

/// Radians of rotation per mouse count.
pub const TURN_PER_COUNT: f32 = 0.0022;
/// Walking speed in metres per second; running is [`RUN`] times as fast.
pub const WALK: f32 = 1.9;
/// Factor of running on [`WALK`].
pub const RUN: f32 = 2.1;
/// Height of the eye above the ground, in metres.
pub const EYE: f32 = 1.68;
/// Maximum pitch, up or down, in radians.
pub const MAX_PITCH: f32 = 1.2;
/// Time constant of starting and stopping, in seconds.
pub const EASE: f32 = 0.12;

/// Where a walk starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// East and north of the origin, in metres.
    pub at: Vec2,
    /// Direction of view in radians: 0 is north, positive turns to the east.
    pub yaw: f32,
}

impl Start {
    /// Maximum distance of a start from the origin, east or north, in metres: the finely meshed ground.
    pub const FARTHEST: f32 = 96.0;
}

impl FromStr for Start {
    type Err = String;

    /// From `EAST,NORTH,YAW`: metres from the origin, at most [`Start::FARTHEST`], and degrees from north to the east.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("{text} is no start. Write EAST,NORTH,YAW in metres, at most {}, and degrees", Self::FARTHEST);
        let numbers: Vec<f32> = text.split(',').map(|t| t.parse().map_err(|_| wrong())).collect::<Result<_, _>>()?;
        let &[east, north, yaw] = numbers.as_slice() else { return Err(wrong()) };
        let inside = [east, north].iter().all(|metres| metres.abs() <= Self::FARTHEST) && yaw.is_finite();
        inside.then(|| Self { at: Vec2::new(east, north), yaw: yaw.to_radians() }).ok_or_else(wrong)
    }
}

/// Moves `at` into a closed level, and to the edge of each obstacle that contains it.
fn out_of_obstacles(scene: &Scene, at: Vec2) -> Vec2 {
    let mut at = scene.terrain.inside(at);
    for &(centre, radius) in &scene.obstacles {
        let away = at - centre;
        let room = radius + 0.25;
        if away.length_squared() < room * room {
            at = centre + away.normalize_or(Vec2::X) * room;
        }
    }
    for &(low, high) in &scene.walls {
        if low.y > EYE || high.y < 0.2 {
            continue;
        }
        let room = 0.3;
        let (low, high) = (Vec2::new(low.x, low.z) - room, Vec2::new(high.x, high.z) + room);
        if at.cmpgt(low).all() && at.cmplt(high).all() {
            // Out by the nearest side.
            let sides = [at.x - low.x, high.x - at.x, at.y - low.y, high.y - at.y];
            let nearest = (0..4).min_by(|a, b| sides[*a].total_cmp(&sides[*b]));
            match nearest {
                Some(0) => at.x = low.x,
                Some(1) => at.x = high.x,
                Some(2) => at.y = low.y,
                _ => at.y = high.y,
            }
        }
    }
    at
}

/// A walker in a scene.
#[derive(Debug, Clone)]
pub struct Walker {
    at: Vec2,
    velocity: Vec2,
    yaw: f32,
    pitch: f32,
    ground: f32,
    walked: f32,
    time: f64,
    fov: f32,
}

impl Walker {
    /// Starts on the path at the origin, looking along it.
    pub fn new(scene: &Scene) -> Self {
        let ahead = scene.terrain.path(9.0);
        Self::starting_at(scene, Start { at: Vec2::ZERO, yaw: (ahead / 9.0).atan() })
    }

    /// Starts at `start`, or beside an obstacle that is there.
    pub fn starting_at(scene: &Scene, start: Start) -> Self {
        let at = out_of_obstacles(scene, start.at);
        Self {
            at,
            velocity: Vec2::ZERO,
            yaw: start.yaw,
            pitch: -0.03,
            ground: scene.terrain.height(at),
            walked: 0.0,
            time: 0.0,
            fov: 62_f32.to_radians(),
        }
    }

    /// A walker who stands at `start`, with this one's time and distance walked: a game's score does not fall at a cut.
    pub(crate) fn jumped(&self, scene: &Scene, start: Start) -> Self {
        Self { time: self.time, walked: self.walked, ..Self::starting_at(scene, start) }
    }

    /// Advances by `seconds` with `input`: the mouse motion and the keys held during that time.
    ///
    /// W, A, S and D walk, shift runs, the mouse turns and tilts. Steps should be 1/60 s or shorter.
    pub fn step(&mut self, scene: &Scene, input: &ControlInput, seconds: f64) {
        let dt = seconds as f32;
        let [dx, dy] = input.mouse();
        self.yaw += dx * TURN_PER_COUNT;
        self.pitch = (self.pitch - dy * TURN_PER_COUNT).clamp(-MAX_PITCH, MAX_PITCH);
        let keys = input.keys();
        let axis = |plus: Key, minus: Key| f32::from(keys.contains(plus)) - f32::from(keys.contains(minus));
        let wish = Vec2::new(axis(Key(68), Key(65)), axis(Key(87), Key(83))).normalize_or_zero();
        let (sin, cos) = self.yaw.sin_cos();
        let pace = if keys.contains(Key(16)) { WALK * RUN } else { WALK };
        let wish = (Vec2::new(cos, -sin) * wish.x + Vec2::new(sin, cos) * wish.y) * pace;
        self.velocity += (wish - self.velocity) * (1.0 - (-dt / EASE).exp());
        let to = out_of_obstacles(scene, self.at + self.velocity * dt);
        self.walked += to.distance(self.at);
        self.at = to;
        // Low-pass filter over small bumps: the eye follows the ground with a time constant of a quarter of a second.
        self.ground += (scene.terrain.height(to) - self.ground) * (1.0 - (-dt / 0.25).exp());
        self.time += seconds;
    }

    /// The current moment, for a picture with the given aspect ratio.
    pub fn moment(&self, aspect: f32) -> Moment {
        let bob = 0.022 * (self.walked * 4.2).sin();
        Moment {
            camera: Camera {
                position: Vec3::new(self.at.x, self.ground + EYE + bob, self.at.y),
                yaw: self.yaw,
                pitch: self.pitch,
                vertical_fov: self.fov,
                aspect,
            },
            walked: self.walked,
            time: self.time as f32,
            shot: 0,
            jitter: Vec2::ZERO,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_is_two_distances_and_an_angle() {
        let found: Start = "-12.5,96,180".parse().unwrap();
        assert_eq!((found.at.x, found.at.y, found.yaw), (-12.5, 96.0, std::f32::consts::PI));
        for wrong in ["", "1,2", "1,2,3,4", "a,0,0", "97,0,0", "0,-97,0", "NaN,0,0", "0,0,inf"] {
            assert!(wrong.parse::<Start>().is_err(), "{wrong}");
        }
    }
}
