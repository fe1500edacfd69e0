//! Lamps: lights with a place in the scene, at rest or moving.

use glam::Vec3;

use crate::animation::{Animation, bone};
use crate::particles;
use crate::pose::Pose;
use crate::render::Moment;
use crate::scene::Chunk;

/// Where a lamp is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mount {
    /// At rest in the world.
    Fixed(Vec3),
    /// In the lantern of the figure that is chunk number `.0`.
    Lantern(usize),
    /// On the viewer's head, shining along the view.
    Headlamp,
    /// At the muzzle of a weapon held in view; lit while it flashes.
    Muzzle,
}

/// A lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lamp {
    pub(crate) mount: Mount,
    /// Light on a surface that faces the lamp one metre away, linear RGB in the unit of [`Weather::sun_light`](crate::Weather::sun_light).
    pub(crate) light: Vec3,
    /// Distance in metres at which the light has faded to nothing.
    pub(crate) reach: f32,
}

/// Solid boxes that block lamps, by their corners.
pub(crate) type Walls = Vec<(Vec3, Vec3)>;

/// A lamp at one time.
#[derive(Debug, Clone)]
pub(crate) struct LitLamp {
    position: Vec3,
    light: Vec3,
    reach: f32,
    /// Axis of a lamp that lights a cone.
    axis: Option<Vec3>,
    /// Whether its light on the world changes with time.
    pub(crate) moves: bool,
    /// Boxes within reach.
    walls: Walls,
}

/// Cosines of a headlamp's cone: full light inside the first, none outside the second.
const CONE: [f32; 2] = [0.95, 0.84];

impl Lamp {
    /// The lamp at `moment`.
    pub(crate) fn at(&self, moment: &Moment, chunks: &[Chunk], walls: &Walls) -> LitLamp {
        let mut light = self.light;
        let (position, axis) = match self.mount {
            Mount::Fixed(at) => (at, None),
            Mount::Lantern(chunk) => (lantern(&chunks[chunk], moment.time), None),
            Mount::Muzzle => {
                light *= particles::flash(moment.time);
                (particles::muzzle(&moment.camera.view(1, 1)), None)
            }
            Mount::Headlamp => {
                let view = moment.camera.view(1, 1);
                (view.eye + view.axes[1] * 0.12, Some(view.axes[2]))
            }
        };
        let near = |(low, high): &&(Vec3, Vec3)| position.clamp(*low, *high).distance(position) < self.reach;
        LitLamp {
            position,
            light,
            reach: self.reach,
            axis,
            moves: !matches!(self.mount, Mount::Fixed(_)),
            walls: walls.iter().filter(near).copied().collect(),
        }
    }
}

fn lantern(chunk: &Chunk, time: f32) -> Vec3 {
    let Animation::Skeleton { rig, .. } = &chunk.animation else { return chunk.ball().0 };
    let hand: Pose = rig.bones(time)[usize::from(bone::LANTERN)];
    hand.apply(-Vec3::Y * 0.24)
}

impl LitLamp {
    /// Light that arrives at `p` from the lamp on a surface that faces it, and the unit direction to the lamp; `None` out of reach or behind a wall.
    ///
    /// Falls off with the square of the distance; a window function takes it to zero at the reach (Karis, "Real Shading in Unreal Engine 4", 2013).
    pub(crate) fn arriving(&self, p: Vec3, normal: Vec3) -> Option<(Vec3, Vec3)> {
        let to = self.position - p;
        let square = to.length_squared();
        if square >= self.reach * self.reach {
            return None;
        }
        let far = square.sqrt();
        let direction = to / far.max(1e-3);
        let fade = (1.0 - (square / (self.reach * self.reach)).powi(2)).powi(2) / (square + 0.04);
        let cone = self.axis.map_or(1.0, |axis| {
            let t = ((-direction.dot(axis) - CONE[1]) / (CONE[0] - CONE[1])).clamp(0.0, 1.0);
            t * t
        });
        if cone * fade <= 0.0 || self.light == Vec3::ZERO {
            return None;
        }
        let from = p + normal * 0.02;
        let blocked = self.walls.iter().any(|&(low, high)| crosses(from, self.position, low, high));
        (!blocked).then_some((self.light * (fade * cone), direction))
    }
}

/// Whether the segment from `a` to `b` passes through the box, by its slabs.
fn crosses(a: Vec3, b: Vec3, low: Vec3, high: Vec3) -> bool {
    let inverse = (b - a).recip();
    let (s, t) = ((low - a) * inverse, (high - a) * inverse);
    let enters = s.min(t).max_element();
    let leaves = s.max(t).min_element();
    enters < leaves && leaves > 1e-4 && enters < 1.0 - 1e-4
}
