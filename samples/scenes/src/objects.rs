//! Objects of the scenes, each generated from a seed.

use std::f32::consts::TAU;

use glam::{Mat3, Vec3};

use crate::material::Material;
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::Rng;

fn surface(material: Material, rng: &mut Rng) -> TriangleMaterial {
    TriangleMaterial { material, variant: (rng.bits() & 255) as u8 }
}

/// Mesh detail of an object. It depends on the object's position, never on the camera, so that no object changes its shape during a walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Detail {
    /// Near the path.
    Fine,
    /// Far from the path, where only the silhouette is visible.
    Coarse,
}

/// A tall tree with a bare lower trunk and a crown of leaf clumps; about `height` metres.
pub(crate) fn broadleaf(height: f32, detail: Detail, rng: &mut Rng) -> Mesh {
    let (sides, leaves, leaf_size) = match detail {
        Detail::Fine => (9, 1.0, 1.0),
        Detail::Coarse => (5, 0.3, 1.8),
    };
    let leaves = |count: u32| (count as f32 * leaves) as u32;
    let mut mesh = Mesh::default();
    let bark = surface(Material::Bark, rng);
    let leaf = surface(Material::Leaf, rng);
    let seed = rng.bits();
    let radius = height * rng.range(0.017, 0.026);
    let lean = Vec3::new(rng.range(-0.06, 0.06), 1.0, rng.range(-0.06, 0.06)) * height;
    let bow = rng.direction() * Vec3::new(1.0, 0.0, 1.0) * height * 0.03;
    let at = |t: f32| lean * t * 0.82 + bow * (t * 5.0).sin();
    let spine: Vec<_> =
        [(-0.03, 1.9), (0.015, 1.35), (0.06, 1.1), (0.25, 0.92), (0.5, 0.72), (0.75, 0.45), (1.0, 0.16)]
            .map(|(t, r)| (at(t), radius * r))
            .to_vec();
    mesh.tube(&spine, sides, 0.22, seed, bark);
    let boughs = 5 + rng.bits() % 4;
    for k in 0..boughs {
        let t = 0.42 + 0.5 * (k as f32 + rng.unit()) / boughs as f32;
        let mut out = rng.direction();
        out.y = rng.range(0.15, 0.6);
        let out = out.normalize() * height * rng.range(0.13, 0.22) * (1.25 - t * 0.6);
        let from = at(t);
        let tip = from + out;
        let elbow = from + out * 0.5 + Vec3::Y * height * 0.02;
        let bough = [(from, radius * 0.36), (elbow, radius * 0.24), (tip, radius * 0.08)];
        mesh.tube(&bough, sides.min(5) - 1, 0.2, seed.wrapping_add(k), bark);
        let crown = Vec3::new(1.0, 0.62, 1.0) * height * rng.range(0.085, 0.13);
        mesh.crown(tip, crown, leaves(46), height * 0.027 * leaf_size, rng, leaf);
    }
    mesh.crown(at(1.0), Vec3::new(1.0, 0.8, 1.0) * height * 0.13, leaves(70), height * 0.03 * leaf_size, rng, leaf);
    mesh
}

/// A fir with several storeys of boughs, snow-covered if `snowy`.
pub(crate) fn fir(height: f32, snowy: bool, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let bark = surface(Material::Bark, rng);
    let needle = surface(if snowy { Material::SnowyNeedle } else { Material::Needle }, rng);
    let radius = height * 0.02;
    mesh.tube(&[(Vec3::Y * -0.4, radius * 1.3), (Vec3::Y * height * 0.5, radius * 0.8)], 7, 0.2, rng.bits(), bark);
    let storeys = 7 + rng.bits() % 4;
    for k in 0..storeys {
        let t = k as f32 / (storeys - 1) as f32;
        let top = Vec3::new(rng.range(-0.02, 0.02) * height, height * (0.30 + 0.70 * t), 0.0);
        let wide = height * (0.215 * (1.0 - t).powf(0.8) + 0.03) * rng.range(0.9, 1.1);
        mesh.skirt(top, wide, height * 0.17 * (1.15 - 0.5 * t), 9, rng, needle);
    }
    mesh
}

/// A low bush of leaves.
pub(crate) fn bush(size: f32, material: Material, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let leaf = surface(material, rng);
    for _ in 0..3 {
        let centre = Vec3::new(rng.range(-0.4, 0.4), rng.range(0.25, 0.5), rng.range(-0.4, 0.4)) * size;
        mesh.crown(centre, Vec3::new(0.55, 0.45, 0.55) * size, 34, size * 0.13, rng, leaf);
    }
    mesh
}

/// A fern or a bunch of long leaves.
pub(crate) fn fern(size: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let leaf = surface(Material::Leaf, rng);
    mesh.tuft(Vec3::ZERO, 12, size, size * 0.3, rng, leaf);
    mesh
}

/// A bunch of grass.
pub(crate) fn grass(height: f32, material: Material, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let blade = surface(material, rng);
    mesh.tuft(Vec3::ZERO, 9, height, height * 0.7, rng, blade);
    mesh
}

/// A boulder about `size` metres wide.
pub(crate) fn rock(size: f32, material: Material, rng: &mut Rng) -> Mesh {
    let mut ball = Mesh::default();
    let rings = if size > 1.0 { 10 } else { 6 };
    ball.ball(rings, 0.28, 1.6, rng.bits(), surface(material, rng));
    let mut mesh = Mesh::default();
    let shape = Vec3::new(rng.range(0.8, 1.2), rng.range(0.5, 0.85), rng.range(0.8, 1.2)) * size * 0.5;
    let rotation = Mat3::from_rotation_y(rng.range(0.0, TAU)) * Mat3::from_rotation_x(rng.range(-0.3, 0.3));
    mesh.add_instance(&ball, Vec3::Y * shape.y * 0.45, rotation, shape);
    mesh
}

/// A fallen trunk along the x axis.
pub(crate) fn log(length: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let bark = surface(Material::Bark, rng);
    let r = rng.range(0.16, 0.3);
    let spine = [-0.5, -0.2, 0.15, 0.5].map(|t| (Vec3::new(t * length, r * 0.8, t * 0.2), r * (1.0 - 0.3 * t)));
    mesh.tube(&spine, 9, 0.25, rng.bits(), bark);
    let moss = surface(Material::Leaf, rng);
    mesh.crown(Vec3::new(0.0, r * 1.4, 0.0), Vec3::new(length * 0.3, 0.1, r), 14, 0.1, rng, moss);
    mesh
}

/// A mushroom.
pub(crate) fn mushroom(height: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let stem = TriangleMaterial { material: Material::Wood, variant: 200 };
    mesh.tube(&[(Vec3::ZERO, height * 0.12), (Vec3::Y * height * 0.8, height * 0.09)], 6, 0.1, 3, stem);
    let mut cap = Mesh::default();
    cap.ball(6, 0.05, 1.0, rng.bits(), surface(Material::Accent, rng));
    mesh.add_instance(&cap, Vec3::Y * height * 0.8, Mat3::IDENTITY, Vec3::new(0.42, 0.26, 0.42) * height);
    mesh
}

/// A saguaro with up to four arms.
pub(crate) fn saguaro(height: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let skin = surface(Material::Cactus, rng);
    let r = height * rng.range(0.055, 0.07);
    let column = |from: Vec3, tall: f32, r: f32| {
        [(0.0, 0.85), (0.15, 1.0), (0.5, 1.05), (0.85, 0.95), (0.96, 0.6), (1.0, 0.12)]
            .map(|(t, k)| (from + Vec3::Y * tall * t, r * k))
            .to_vec()
    };
    mesh.tube(&column(Vec3::Y * -0.2, height, r), 12, 0.06, 4, skin);
    for _ in 0..rng.bits() % 5 {
        let (sin, cos) = rng.range(0.0, TAU).sin_cos();
        let out = Vec3::new(cos, 0.0, sin);
        let low = Vec3::Y * height * rng.range(0.3, 0.55);
        let reach = r * rng.range(2.4, 3.2);
        let elbow = low + out * reach;
        mesh.tube(
            &[
                (low, r * 0.6),
                (low + out * reach * 0.7 - Vec3::Y * r * 0.2, r * 0.66),
                (elbow + Vec3::Y * r * 0.5, r * 0.66),
            ],
            9,
            0.05,
            5,
            skin,
        );
        mesh.tube(&column(elbow, height * rng.range(0.2, 0.38), r * 0.66), 9, 0.05, 6, skin);
    }
    mesh
}

/// A barrel cactus or prickly pear.
pub(crate) fn barrel(size: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let skin = surface(Material::Cactus, rng);
    let mut ball = Mesh::default();
    ball.ball(8, 0.06, 3.0, rng.bits(), skin);
    if rng.unit() < 0.5 {
        mesh.add_instance(&ball, Vec3::Y * size * 0.45, Mat3::IDENTITY, Vec3::new(0.42, 0.55, 0.42) * size);
    } else {
        for k in 0..7 {
            let rotation = Mat3::from_rotation_y(rng.range(0.0, TAU)) * Mat3::from_rotation_z(rng.range(-0.6, 0.6));
            let at = rotation * Vec3::Y * size * (0.35 + 0.12 * k as f32);
            mesh.add_instance(&ball, at, rotation, Vec3::new(0.3, 0.36, 0.1) * size);
        }
    }
    mesh
}

/// A fence of posts and two rails along the x axis, `spans` spans of 2.4 metres.
pub(crate) fn fence(spans: u32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let wood = surface(Material::Wood, rng);
    for k in 0..=spans {
        let x = k as f32 * 2.4 + rng.range(-0.08, 0.08);
        let tall = rng.range(1.05, 1.25);
        mesh.block(Vec3::new(x - 0.06, -0.4, -0.06), Vec3::new(x + 0.06, tall, 0.06), wood);
        if k < spans {
            for y in [0.45, 0.85] {
                let y = y + rng.range(-0.05, 0.05);
                mesh.block(Vec3::new(x, y, 0.05), Vec3::new(x + 2.45, y + 0.09, 0.1), wood);
            }
        }
    }
    mesh
}

/// A sign post at a road.
pub(crate) fn sign(rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let wood = surface(Material::Wood, rng);
    mesh.block(Vec3::new(-0.05, -0.4, -0.05), Vec3::new(0.05, 2.3, 0.05), wood);
    mesh.block(
        Vec3::new(-0.55, 1.55, -0.09),
        Vec3::new(0.55, 2.2, -0.05),
        TriangleMaterial { material: Material::Accent, variant: 1 },
    );
    mesh
}

/// The held sword in view space: metres right, up and forward of the eye, with the hand that holds it.
pub(crate) fn sword() -> Mesh {
    let plain = |material| TriangleMaterial { material, variant: 90 };
    let mut mesh = Mesh::default();
    let across = Vec3::new(0.94, 0.10, 0.33).normalize();
    let grip = Vec3::new(0.27, -0.30, 0.58);
    let up = Vec3::new(-0.16, 0.93, 0.33).normalize();
    let at = |t: f32| grip + up * t;
    let blade = [
        (0.10, 0.026, 0.006),
        (0.45, 0.024, 0.0055),
        (0.66, 0.020, 0.005),
        (0.74, 0.010, 0.004),
        (0.79, 0.0005, 0.0005),
    ];
    mesh.bar(&blade.map(|(t, w, d)| (at(t), w, d)), across, plain(Material::Steel));
    let guard = [-0.115_f32, -0.1, 0.0, 0.1, 0.115];
    let spine: Vec<_> =
        guard.iter().map(|&s| (at(0.085 + 0.25 * s.abs() * s.abs()) + across * s, 0.016 - s.abs() * 0.05)).collect();
    mesh.tube(&spine, 8, 0.0, 1, plain(Material::Gold));
    mesh.tube(&[(at(-0.14), 0.017), (at(-0.05), 0.02), (at(0.08), 0.016)], 10, 0.04, 2, plain(Material::Leather));
    let mut pommel = Mesh::default();
    pommel.ball(8, 0.0, 1.0, 1, plain(Material::Gold));
    mesh.add_instance(&pommel, at(-0.165), Mat3::IDENTITY, Vec3::splat(0.03));
    let mut knuckle = Mesh::default();
    knuckle.ball(7, 0.08, 2.0, 7, plain(Material::Leather));
    for k in 0..4 {
        let p = at(-0.07 + 0.037 * k as f32) - across * 0.012 - Vec3::Z * 0.022;
        mesh.add_instance(&knuckle, p, Mat3::IDENTITY, Vec3::new(0.036, 0.021, 0.03));
    }
    mesh.tube(
        &[
            (at(-0.02) + across * 0.02, 0.04),
            (Vec3::new(0.34, -0.44, 0.45), 0.052),
            (Vec3::new(0.48, -0.75, 0.22), 0.075),
        ],
        12,
        0.1,
        9,
        plain(Material::Leather),
    );
    mesh
}
