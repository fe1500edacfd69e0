//! Rigid poses, and routes over the ground.

use glam::{Mat3, Vec2, Vec3};

/// A rotation followed by a translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    pub(crate) rotation: Mat3,
    pub(crate) translation: Vec3,
}

impl Pose {
    pub(crate) fn apply(&self, p: Vec3) -> Vec3 {
        self.rotation * p + self.translation
    }

    /// Applies the inverse pose.
    pub(crate) fn apply_inverse(&self, p: Vec3) -> Vec3 {
        self.rotation.transpose() * (p - self.translation)
    }

    /// Pose of a child that turns by `rotation` about `joint`, a point in this pose's frame.
    pub(crate) fn child(&self, joint: Vec3, rotation: Mat3) -> Self {
        Self { rotation: self.rotation * rotation, translation: self.apply(joint) }
    }
}

/// Distance along the route over which its corners are rounded, in metres.
const ROUNDING: f32 = 0.35;

/// A polyline over the ground (east, north), followed by its length.
#[derive(Debug, Clone)]
pub(crate) struct Route {
    points: Vec<Vec2>,
    /// Length from the start to each point.
    lengths: Vec<f32>,
    closed: bool,
}

/// Points that are closer together, in metres, are one.
const SAME_POINT: f32 = 1e-3;

impl Route {
    /// A route through at least two points that returns to the first one and goes on.
    pub(crate) fn closed(mut points: Vec<Vec2>) -> Self {
        points.dedup_by(|a, b| a.distance(*b) < SAME_POINT);
        points.push(points[0]);
        Self { closed: true, ..Self::through(points) }
    }

    /// A route through at least two points that ends at the last one.
    pub(crate) fn open(mut points: Vec<Vec2>) -> Self {
        points.dedup_by(|a, b| a.distance(*b) < SAME_POINT);
        Self::through(points)
    }

    fn through(points: Vec<Vec2>) -> Self {
        let mut lengths = vec![0.0];
        for pair in points.windows(2) {
            lengths.push(lengths[lengths.len() - 1] + pair[0].distance(pair[1]));
        }
        Self { points, lengths, closed: false }
    }

    /// Whole length in metres.
    pub(crate) fn length(&self) -> f32 {
        self.lengths[self.lengths.len() - 1]
    }

    fn on_line(&self, s: f32) -> Vec2 {
        let s = if self.closed { s.rem_euclid(self.length()) } else { s.clamp(0.0, self.length()) };
        let k = self.lengths.partition_point(|l| *l <= s).clamp(1, self.points.len() - 1);
        let (from, until) = (self.lengths[k - 1], self.lengths[k]);
        self.points[k - 1].lerp(self.points[k], (s - from) / (until - from).max(1e-6))
    }

    /// Position and unit heading `s` metres along the route.
    pub(crate) fn at(&self, s: f32) -> (Vec2, Vec2) {
        let (behind, here, ahead) = (self.on_line(s - ROUNDING), self.on_line(s), self.on_line(s + ROUNDING));
        ((behind + here * 2.0 + ahead) * 0.25, (ahead - behind).normalize_or(Vec2::Y))
    }
}

/// Yaw of a heading (east, north): 0 is north, positive turns to the east.
pub(crate) fn yaw_of(heading: Vec2) -> f32 {
    heading.x.atan2(heading.y)
}
