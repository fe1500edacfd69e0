//! Checks of ground truth that the tests share.
#![allow(dead_code, reason = "each test file uses a part")]

use glam::{Vec2, Vec3};
use scenes::camera::{FAR, device_depth, view_distance};
use scenes::{Frame, Moment, Scene};

/// Catmull-Rom sampling of an 8-bit picture at a pixel position, in code values.
pub(crate) fn sample(frame: &Frame, at: Vec2) -> Vec3 {
    let (w, h) = (frame.picture.width() as i32, frame.picture.height() as i32);
    let at = at - 0.5;
    let low = at.floor();
    let weights = |t: f32| {
        [
            t * (-0.5 + t * (1.0 - 0.5 * t)),
            1.0 + t * t * (1.5 * t - 2.5),
            t * (0.5 + t * (2.0 - 1.5 * t)),
            t * t * (0.5 * t - 0.5),
        ]
    };
    let (wx, wy) = (weights(at.x - low.x), weights(at.y - low.y));
    let mut sum = Vec3::ZERO;
    for (j, wy) in wy.into_iter().enumerate() {
        for (i, wx) in wx.into_iter().enumerate() {
            let x = (low.x as i32 + i as i32 - 1).clamp(0, w - 1);
            let y = (low.y as i32 + j as i32 - 1).clamp(0, h - 1);
            let p = frame.picture.pixels()[(y * w + x) as usize];
            sum += Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2])) * wx * wy;
        }
    }
    sum
}

/// Whether depth is smooth over the 5 x 5 pixels around (x, y): no silhouette passes there.
pub(crate) fn inside(frame: &Frame, x: i32, y: i32) -> bool {
    let (w, h) = (frame.picture.width() as i32, frame.picture.height() as i32);
    if x < 2 || y < 2 || x + 2 >= w || y + 2 >= h {
        return false;
    }
    let at = |x: i32, y: i32| view_distance(frame.depth[(y * w + x) as usize]);
    let here = at(x, y);
    (-2..=2).all(|j| {
        (-2..=2).all(|i| {
            // On a plane depth is linear in 1/z: opposite neighbours average to the middle.
            let (a, b) = (1.0 / at(x + i, y + j), 1.0 / at(x - i, y - j));
            ((a + b) * 0.5 * here - 1.0).abs() < 0.004
        })
    })
}

/// Comparison of a picture with the previous one, displaced by motion.
#[derive(Debug, Default)]
pub(crate) struct Reprojection {
    squares: f64,
    /// Pixels compared.
    pub(crate) count: u32,
    /// Longest motion in pixels.
    pub(crate) longest: f32,
}

impl Reprojection {
    /// Compares the pixels that `is_compared` accepts, by their number and the previous picture's nearest pixel, where the point is inside a smooth
    /// surface in both pictures. `motion` is that of `current`, or another to be compared with it.
    pub(crate) fn add(
        &mut self,
        current: &Frame,
        previous: &Frame,
        motion: &[Vec2],
        is_compared: impl Fn(usize, usize) -> bool,
    ) {
        let w = current.picture.width() as i32;
        for (k, displacement) in motion.iter().enumerate() {
            let (x, y) = (k as i32 % w, k as i32 / w);
            let there = Vec2::new(x as f32, y as f32) + 0.5 + current.motion[k];
            if !there.is_finite() || !inside(current, x, y) {
                continue;
            }
            let (px, py) = (there.x.floor() as i32, there.y.floor() as i32);
            if !inside(previous, px, py) {
                continue;
            }
            let was = (py * w + px) as usize;
            // Visible in both: the previous depth there is that of a point close by.
            let old = view_distance(previous.depth[was]);
            if (old / view_distance(current.depth[k]) - 1.0).abs() > 0.05 || !is_compared(k, was) {
                continue;
            }
            let p = current.picture.pixels()[k];
            let at = Vec2::new(x as f32, y as f32) + 0.5 + *displacement;
            let d = sample(previous, at) - Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2]));
            self.squares += f64::from(d.length_squared()) / 3.0;
            self.longest = self.longest.max(current.motion[k].length());
            self.count += 1;
        }
    }

    /// PSNR in dB.
    pub(crate) fn psnr(&self) -> f64 {
        10.0 * (255.0 * 255.0 / (self.squares / f64::from(self.count))).log10()
    }
}

/// Intersection of a ray and a triangle, farther than .1: distance in units of `direction`, and weights of the second and third corner (Moeller and Trumbore).
pub(crate) fn intersect_triangle(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<(f32, [f32; 2])> {
    let (u, v) = (b - a, c - a);
    let p = direction.cross(v);
    let det = u.dot(p);
    if det == 0.0 {
        return None;
    }
    let s = (origin - a) / det;
    let (x, q) = (s.dot(p), s.cross(u));
    let (y, t) = (direction.dot(q), v.dot(q));
    (x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.1).then_some((t, [x, y]))
}

/// How many of the depths of every `step`th pixel are where the ray meets the first of all triangles at the frame's time, and how many were checked.
pub(crate) fn count_matching_depths(scene: &Scene, now: &Moment, frame: &Frame, step: usize) -> (u32, u32) {
    let (width, height) = frame.picture.size();
    let view = now.view(width, height);
    let triangles: Vec<[Vec3; 3]> = (scene.chunks.iter())
        .flat_map(|c| {
            let positions = c.positions_at(now.time);
            c.mesh.triangles.iter().map(|t| t.map(|i| positions[i as usize])).collect::<Vec<_>>()
        })
        .collect();
    let (mut agree, mut asked) = (0, 0);
    for k in (0..width * height).step_by(step) {
        let pixel = Vec2::new((k % width) as f32, (k / width) as f32) + 0.5;
        let ray = view.to_world(view.ray(pixel));
        let nearest =
            triangles.iter().filter_map(|t| Some(intersect_triangle(view.eye, ray, *t)?.0)).fold(f32::MAX, f32::min);
        let expected = if nearest > FAR { 1.0 } else { device_depth(nearest) };
        let (found, expected) = (view_distance(frame.depth[k as usize]), view_distance(expected));
        asked += 1;
        agree += u32::from((found / expected - 1.0).abs() < 2e-3);
    }
    (agree, asked)
}
