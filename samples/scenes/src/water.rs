//! Still water with ripples: a level surface that mirrors the scene.

use glam::{Vec2, Vec3};

use crate::camera::View;

/// Direction, radians per metre, radians per second and height in metres of each ripple.
const RIPPLES: [(Vec2, f32, f32, f32); 4] = [
    (Vec2::new(0.80, 0.60), 9.0, 3.1, 0.0016),
    (Vec2::new(-0.52, 0.85), 14.0, 4.3, 0.0010),
    (Vec2::new(0.20, -0.98), 23.0, 6.0, 0.0005),
    (Vec2::new(-0.96, -0.28), 31.0, 7.4, 0.0003),
];

/// Slope of the surface to the east and to the north at a point at `time` seconds; ripples that a pixel of `footprint` metres does not resolve are left
/// out.
pub(crate) fn slope(p: Vec3, time: f32, footprint: f32) -> Vec2 {
    let at = Vec2::new(p.x, p.z);
    RIPPLES
        .iter()
        .map(|&(direction, frequency, speed, height)| {
            let resolved = (1.5 - footprint * frequency).clamp(0.0, 1.0);
            direction * (height * frequency * resolved * (frequency * at.dot(direction) - speed * time).cos())
        })
        .sum()
}

/// Share of light that water mirrors at a cosine of incidence (Schlick's approximation for a refractive index of 1.33).
pub(crate) fn mirrored_share(cosine: f32) -> f32 {
    0.02 + 0.98 * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
}

/// The view whose picture of what is above the level `height` is the mirror image that `view` sees in a surface at that height, at the same pixels.
pub(crate) fn mirrored_view(view: &View, height: f32) -> View {
    let mirror = |v: Vec3| Vec3::new(v.x, -v.y, v.z);
    View { eye: Vec3::new(view.eye.x, 2.0 * height - view.eye.y, view.eye.z), axes: view.axes.map(mirror), ..*view }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    #[test]
    fn a_point_and_its_mirror_image_are_at_the_same_pixel() {
        let camera = Camera {
            position: Vec3::new(1.0, 1.7, -2.0),
            yaw: 0.4,
            pitch: -0.3,
            vertical_fov: 1.0,
            aspect: 16.0 / 9.0,
        };
        let view = camera.view(640, 360);
        let mirrored = mirrored_view(&view, 0.25);
        let point = Vec3::new(3.0, 2.5, 9.0);
        let image = Vec3::new(3.0, 0.5 - 2.5, 9.0);
        let [seen, expected] = [mirrored.project(mirrored.to_view(point)), view.project(view.to_view(image))];
        assert!((seen - expected).length() < 1e-3, "{seen} {expected}");
    }
}
