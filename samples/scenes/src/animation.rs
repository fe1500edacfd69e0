//! Geometry that depends on time: rigid bodies, skinned figures and plants in the wind.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3};

use crate::material::smooth;
use crate::mesh::Mesh;
use crate::pose::{Pose, Route, yaw_of};
use crate::terrain::Terrain;

/// Gravity in m/s².
const GRAVITY: f32 = 9.81;

/// How a chunk's vertices move. Every position is a function of time alone, so that any two times can be compared.
#[derive(Debug, Clone)]
pub(crate) enum Animation {
    /// At rest, or held in view.
    Still,
    /// One rigid body.
    Rigid(RigidMotion),
    /// Rigid bones; each vertex belongs to one and is given in its frame.
    Skeleton { rig: Rig, bones: Vec<u8> },
    /// Plants in the wind; one entry per vertex.
    Wind(Vec<Flex>),
}

/// How far the wind bends a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Flex {
    /// Displacement at unit strength, in metres.
    pub(crate) reach: f32,
    /// Its derivative by height.
    pub(crate) slope: f32,
    /// Additional flutter of leaves, in metres.
    pub(crate) flutter: f32,
}

/// The path of a rigid body.
#[derive(Debug, Clone)]
pub(crate) enum RigidMotion {
    /// A ball that rolls along a route without slipping, from `start` metres at time 0, and coasts to a stop at the end.
    Roll { route: Route, ground: Arc<Terrain>, start: f32, speed: f32, radius: f32 },
    /// A body that falls from each of `heights` (metres) in turn, over and over, and spins in the air. Its centre comes down to `floor`.
    Bounce { floor: Vec3, heights: [f32; 4], offset: f32, spin: f32 },
    /// A leaf that turns about a vertical hinge by `angle`: open at `opens` seconds, closed half a `period` later.
    Hinge { at: Vec3, yaw: f32, angle: f32, opens: f32, period: f32 },
}

impl RigidMotion {
    /// Pose at `time` seconds.
    pub(crate) fn pose(&self, time: f32) -> Pose {
        match self {
            Self::Roll { route, ground, start, speed, radius } => {
                // Exponential braking over the last metres keeps the speed continuous.
                let (way, brake) = (start + speed * time, 2.0);
                let last = route.length() - 2.0 * brake;
                let s = if way < last { way } else { last + brake * (1.0 - (-(way - last) / brake).exp()) };
                let (at, heading) = route.at(s);
                Pose {
                    rotation: Mat3::from_rotation_y(yaw_of(heading)) * Mat3::from_rotation_x(s / radius),
                    translation: Vec3::new(at.x, ground.mesh_height(at) + radius, at.y),
                }
            }
            Self::Bounce { floor, heights, offset, spin } => {
                let lasts = heights.map(|h| 2.0 * (2.0 * h / GRAVITY).sqrt());
                let cycle: f32 = lasts.iter().sum();
                let now = time + offset;
                let mut within = now.rem_euclid(cycle);
                let mut up = 0.0;
                for (height, last) in heights.iter().zip(lasts) {
                    if within < last {
                        let from_top = within - last * 0.5;
                        up = (height - 0.5 * GRAVITY * from_top * from_top).max(0.0);
                        break;
                    }
                    within -= last;
                }
                let turn = now * spin;
                Pose {
                    rotation: Mat3::from_rotation_y(turn * 0.6) * Mat3::from_rotation_x(turn),
                    translation: *floor + Vec3::Y * up,
                }
            }
            Self::Hinge { at, yaw, angle, opens, period } => {
                let wave = 0.5 + 0.5 * ((time - opens) / period * TAU).cos();
                let turn = angle * smooth(0.1, 0.75, wave);
                Pose { rotation: Mat3::from_rotation_y(yaw + turn), translation: *at }
            }
        }
    }
}

/// A hierarchy of bones and its movement.
#[derive(Debug, Clone)]
pub(crate) enum Rig {
    /// A walking figure.
    Figure(Figure),
    /// A flying bird.
    Bird(Bird),
}

/// Number of bones of the largest rig.
pub(crate) const BONES: usize = 14;

impl Rig {
    /// Pose of every bone in the world at `time` seconds.
    pub(crate) fn bones(&self, time: f32) -> [Pose; BONES] {
        match self {
            Self::Figure(figure) => figure.bones(time),
            Self::Bird(bird) => bird.bones(time),
        }
    }
}

/// A figure that walks along a closed route.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    pub(crate) route: Route,
    pub(crate) ground: Arc<Terrain>,
    /// Metres along the route at time 0.
    pub(crate) start: f32,
    /// Metres per second.
    pub(crate) speed: f32,
    /// Height divided by 1.75 m.
    pub(crate) scale: f32,
    /// Whether the right hand holds a lantern.
    pub(crate) lantern: bool,
}

/// Bones of a figure, in the order of [`Figure::bones`].
pub(crate) mod bone {
    pub(crate) const PELVIS: u8 = 0;
    pub(crate) const CHEST: u8 = 1;
    pub(crate) const HEAD: u8 = 2;
    /// Left and right; the forearm follows its upper arm.
    pub(crate) const ARM: [u8; 2] = [3, 5];
    /// Left and right; shin and foot follow their thigh.
    pub(crate) const LEG: [u8; 2] = [7, 10];
    pub(crate) const LANTERN: u8 = 13;
}

/// Measures of a figure of 1.75 m, in metres.
pub(crate) mod body {
    pub(crate) const HIP: f32 = 0.93;
    pub(crate) const HIP_HALF: f32 = 0.095;
    pub(crate) const THIGH: f32 = 0.45;
    pub(crate) const SHIN: f32 = 0.43;
    pub(crate) const ANKLE: f32 = 0.08;
    pub(crate) const WAIST: f32 = 0.12;
    pub(crate) const SHOULDER: f32 = 0.37;
    pub(crate) const SHOULDER_HALF: f32 = 0.205;
    pub(crate) const NECK: f32 = 0.43;
    pub(crate) const UPPER_ARM: f32 = 0.29;
    pub(crate) const FOREARM: f32 = 0.26;
}

/// A turn about the x axis that swings a limb which hangs down forward by `angle`.
fn forward(angle: f32) -> Mat3 {
    Mat3::from_rotation_x(-angle)
}

impl Figure {
    /// Length of two steps in metres: grows with speed, as people walk (about 1.4 m at 1.3 m/s).
    fn stride(&self) -> f32 {
        (0.75 + 0.5 * self.speed) * self.scale
    }

    fn bones(&self, time: f32) -> [Pose; BONES] {
        let k = self.scale;
        let s = self.start + self.speed * time;
        let (at, heading) = self.route.at(s);
        let floor = self.ground.mesh_height(at);
        let stride = self.stride();
        let phase = s / stride * TAU;
        // Lowest when the feet are farthest apart.
        let hip = (body::HIP - 0.025 - 0.018 * (2.0 * phase).cos()) * k;
        let root =
            Pose { rotation: Mat3::from_rotation_y(yaw_of(heading)), translation: Vec3::new(at.x, floor + hip, at.y) };
        let mut bones = [root; BONES];
        let pelvis = root.child(Vec3::ZERO, Mat3::from_rotation_y(-0.10 * phase.cos()));
        let chest = root.child(Vec3::Y * body::WAIST * k, Mat3::from_rotation_y(0.14 * phase.cos()) * forward(-0.05));
        bones[usize::from(bone::PELVIS)] = pelvis;
        bones[usize::from(bone::CHEST)] = chest;
        let nod = Mat3::from_rotation_y(-0.14 * phase.cos() + 0.25 * (time * 0.7 + self.start).sin());
        bones[usize::from(bone::HEAD)] = chest.child(Vec3::Y * body::NECK * k, nod);
        for (side, sign) in [-1.0_f32, 1.0].into_iter().enumerate() {
            let swing = sign * phase.cos();
            let holds = self.lantern && side == 1;
            let (upper, elbow) = if holds { (0.35 + 0.04 * swing, 1.1) } else { (0.42 * swing, 0.35 + 0.18 * swing) };
            let shoulder = Vec3::new(sign * body::SHOULDER_HALF, body::SHOULDER, 0.0) * k;
            let arm = chest.child(shoulder, Mat3::from_rotation_z(sign * 0.09) * forward(upper));
            let first = usize::from(bone::ARM[side]);
            bones[first] = arm;
            bones[first + 1] = arm.child(-Vec3::Y * body::UPPER_ARM * k, forward(elbow));
            if holds {
                let hand = bones[first + 1].apply(-Vec3::Y * (body::FOREARM + 0.05) * k);
                let sway = root.rotation * forward(0.16 * (phase + 0.7).sin());
                bones[usize::from(bone::LANTERN)] = Pose { rotation: sway, translation: hand };
            }
            // The left foot is in front at phase 0. A foot on the ground stays where it is while the body passes over it.
            let cycle = (s / stride + if side == 0 { 0.0 } else { 0.5 }).rem_euclid(1.0);
            let swings = ((cycle - 0.5) * 2.0).max(0.0);
            let along = if cycle < 0.5 { 0.25 - cycle } else { -0.25 + 0.5 * smooth(0.0, 1.0, swings) } * stride;
            let lift = 0.12 * k * (PI * swings).sin();
            let side_step = sign * body::HIP_HALF * k;
            let right = Vec2::new(heading.y, -heading.x);
            let rise = self.ground.mesh_height(at + heading * along + right * side_step) - floor;
            let joint = Vec3::new(side_step, 0.0, 0.0);
            let ankle = Vec2::new(along, body::ANKLE * k + lift + rise - hip);
            let [thigh, knee] = two_bones(ankle, body::THIGH * k, body::SHIN * k);
            let first = usize::from(bone::LEG[side]);
            bones[first] = root.child(joint, forward(thigh));
            bones[first + 1] = bones[first].child(-Vec3::Y * body::THIGH * k, forward(knee - thigh));
            let foot = -0.5 * (PI * swings).sin() * (1.0 - 1.5 * swings);
            bones[first + 2] = bones[first + 1].child(-Vec3::Y * body::SHIN * k, forward(foot - knee));
        }
        bones
    }
}

/// Angles forward from straight down of two bones that lead from the origin to `end` (forward, up), with the joint between them in front.
fn two_bones(end: Vec2, first: f32, second: f32) -> [f32; 2] {
    let far = end.length().clamp((first - second).abs() + 1e-3, (first + second) * 0.999);
    let line = end.x.atan2(-end.y);
    let cos = (first * first + far * far - second * second) / (2.0 * first * far);
    let upper = line + cos.clamp(-1.0, 1.0).acos();
    let joint = Vec2::new(upper.sin(), -upper.cos()) * first;
    let rest = end.normalize_or(-Vec2::Y) * far - joint;
    [upper, rest.x.atan2(-rest.y)]
}

/// A bird of a flock.
#[derive(Debug, Clone)]
pub(crate) struct Bird {
    /// Where the flock is at each second from 0 on; it stays at the last.
    pub(crate) flock: Arc<[Vec3]>,
    /// Place in the flock.
    pub(crate) offset: Vec3,
    /// Phase of the bird's own movement, in radians.
    pub(crate) phase: f32,
    /// Wing beats per second.
    pub(crate) beats: f32,
    /// Width of the flock's turns to either side, in metres.
    pub(crate) weave: f32,
    /// Size of the bird; 1 spans about 1.3 m.
    pub(crate) scale: f32,
}

impl Bird {
    fn position(&self, time: f32) -> Vec3 {
        let last = self.flock.len() - 1;
        let t = time.clamp(0.0, last as f32 - 1e-3);
        let k = t as usize;
        let knot = |n: usize| self.flock[n.clamp(1, last + 1) - 1];
        let [a, b, c, d] = [knot(k), knot(k + 1), knot(k + 2), knot(k + 3)];
        let u = t - k as f32;
        let spline =
            b + ((c - a) + ((a * 2.0 - b * 5.0 + c * 4.0 - d) + (b * 3.0 - a - c * 3.0 + d) * u) * u) * (0.5 * u);
        let turn = time * 1.25 + self.phase * 0.12;
        let weave = Vec3::new(turn.sin(), 0.14 * (2.3 * turn).sin(), 0.55 * (2.0 * turn).sin()) * self.weave;
        let own = Vec3::new((time * 0.9 + self.phase).sin(), 0.5 * (time * 1.3 + self.phase).cos(), 0.0) * 0.25;
        spline + weave + self.offset + own
    }

    fn bones(&self, time: f32) -> [Pose; BONES] {
        let step = 0.04;
        let (before, here, after) = (self.position(time - step), self.position(time), self.position(time + step));
        let along = (after - before).normalize_or(Vec3::Z);
        let bend = (after - here * 2.0 + before) / (step * step);
        let right = Vec3::Y.cross(along).normalize_or(Vec3::X);
        let bank = (bend.dot(right) * 0.06).clamp(-0.8, 0.8);
        let level = Mat3::from_cols(right, along.cross(right), along);
        let beat = time * self.beats * TAU + self.phase;
        let body = Pose {
            rotation: level * Mat3::from_rotation_z(-bank),
            translation: here - Vec3::Y * 0.05 * self.scale * beat.sin(),
        };
        let mut bones = [body; BONES];
        for (side, sign) in [-1.0_f32, 1.0].into_iter().enumerate() {
            let inner = Mat3::from_rotation_z(sign * (0.15 + 0.65 * beat.sin()));
            let outer = Mat3::from_rotation_z(sign * (0.7 * (beat - 1.0).sin() - 0.1));
            bones[1 + 2 * side] = body.child(Vec3::new(sign * 0.05, 0.03, 0.0) * self.scale, inner);
            bones[2 + 2 * side] = bones[1 + 2 * side].child(Vec3::new(sign * 0.3, 0.0, 0.0) * self.scale, outer);
        }
        bones
    }
}

/// Direction of the wind, east and north.
const WIND: Vec2 = Vec2::new(0.83, 0.56);

/// Strength of the wind at a rest position: gusts that run with the wind, and a faster sway.
fn gust(p: Vec3, time: f32) -> f32 {
    let at = Vec2::new(p.x, p.z);
    let along = at.dot(WIND);
    0.42 + 0.34 * (1.7 * time - 0.22 * along).sin() + 0.24 * (4.1 * time - 0.9 * along + 0.5 * at.perp_dot(WIND)).sin()
}

fn bent(p: Vec3, flex: Flex, time: f32) -> Vec3 {
    let push = flex.reach * gust(p, time);
    let trill = flex.flutter * (7.3 * time + 2.1 * p.x + 1.7 * p.y - 2.6 * p.z).sin();
    p + Vec3::new(WIND.x * push, trill, WIND.y * push)
}

impl Animation {
    /// Whether the chunk is at rest in the world or relative to the eye.
    pub(crate) fn is_still(&self) -> bool {
        matches!(self, Self::Still)
    }

    /// Positions in the world of `mesh`'s vertices at `time` seconds.
    pub(crate) fn positions(&self, mesh: &Mesh, time: f32) -> Vec<Vec3> {
        let rest = mesh.positions.iter();
        match self {
            Self::Still => mesh.positions.clone(),
            Self::Rigid(body) => {
                let pose = body.pose(time);
                rest.map(|&p| pose.apply(p)).collect()
            }
            Self::Skeleton { rig, bones } => {
                let poses = rig.bones(time);
                rest.zip(bones).map(|(&p, bone)| poses[usize::from(*bone)].apply(p)).collect()
            }
            Self::Wind(flexes) => rest.zip(flexes).map(|(&p, flex)| bent(p, *flex, time)).collect(),
        }
    }

    /// Unit normals in the world of `mesh`'s vertices at `time` seconds.
    pub(crate) fn normals(&self, mesh: &Mesh, time: f32) -> Vec<Vec3> {
        let rest = mesh.normals.iter();
        match self {
            Self::Still => mesh.normals.clone(),
            Self::Rigid(body) => {
                let rotation = body.pose(time).rotation;
                rest.map(|&n| rotation * n).collect()
            }
            Self::Skeleton { rig, bones } => {
                let poses = rig.bones(time);
                rest.zip(bones).map(|(&n, bone)| poses[usize::from(*bone)].rotation * n).collect()
            }
            // A shear by height: normals transform with its inverse transpose.
            Self::Wind(flexes) => rest
                .zip(flexes)
                .zip(&mesh.positions)
                .map(|((&n, flex), &p)| {
                    let lean = flex.slope * gust(p, time) * (n.x * WIND.x + n.z * WIND.y);
                    (n - Vec3::Y * lean).normalize_or(n)
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Family;

    fn figure() -> Figure {
        let points = vec![Vec2::new(0.0, -20.0), Vec2::new(0.0, 20.0), Vec2::new(1.0, 20.0), Vec2::new(1.0, -20.0)];
        Figure {
            route: Route::closed(points),
            ground: Arc::new(Terrain::new(Family::Desert, 1)),
            start: 5.0,
            speed: 1.3,
            scale: 1.0,
            lantern: true,
        }
    }

    #[test]
    fn a_foot_on_the_ground_does_not_slide() {
        let figure = figure();
        let stride = figure.stride();
        let (mut slid, mut steps) = (0.0_f32, 0);
        for n in 0..600 {
            let times = [n as f32 / 60.0, (n + 1) as f32 / 60.0];
            for side in 0..2 {
                let cycles =
                    times.map(|t| ((figure.start + figure.speed * t) / stride + 0.5 * side as f32).rem_euclid(1.0));
                if cycles[0] < cycles[1] && cycles[1] < 0.5 {
                    let foot = usize::from(bone::LEG[side]) + 2;
                    let [a, b] = times.map(|t| figure.bones(t)[foot].translation);
                    slid = slid.max((b - a).length());
                    steps += 1;
                }
            }
        }
        assert!(steps > 500, "{steps}");
        // Uneven ground and the limit of the leg's length let it slide by a few millimetres a frame; the body moves 22.
        assert!(slid < 0.004, "{slid} m");
    }

    #[test]
    fn a_ball_rolls_without_slipping() {
        let route = Route::open(vec![Vec2::new(0.0, -40.0), Vec2::new(0.0, 40.0)]);
        let ground = Arc::new(Terrain::new(Family::Desert, 1));
        let ball = RigidMotion::Roll { route, ground, start: 3.0, speed: 2.0, radius: 0.3 };
        let (a, b) = (ball.pose(1.0), ball.pose(1.01));
        // The point that touches the ground stays where it is.
        let touches = a.apply_inverse(a.translation - Vec3::Y * 0.3);
        let moved = b.apply(touches) - a.apply(touches);
        assert!(moved.z.abs() < 1e-3 && (b.translation - a.translation).z > 0.019, "{moved}");
    }

    #[test]
    fn a_bounce_is_continuous_and_touches_the_floor() {
        let body = RigidMotion::Bounce { floor: Vec3::ZERO, heights: [2.0, 1.2, 0.7, 0.4], offset: 0.3, spin: 2.0 };
        let heights: Vec<f32> = (0..4000).map(|n| body.pose(n as f32 * 0.002).translation.y).collect();
        assert!(heights.windows(2).all(|w| (w[1] - w[0]).abs() < 0.014));
        assert!(heights.iter().any(|h| *h > 1.98) && heights.iter().filter(|h| **h < 0.01).count() > 5);
    }
}
