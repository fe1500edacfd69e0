//! Shapes of moving things, each in the frames of its bones.

use glam::{Mat3, Vec3};

use crate::animation::{body, bone};
use crate::material::Material;
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::Rng;

fn surface(material: Material, rng: &mut Rng) -> TriangleMaterial {
    TriangleMaterial { material, variant: (rng.bits() & 255) as u8 }
}

/// A mesh whose vertices belong to bones.
#[derive(Default)]
pub(crate) struct Skin {
    pub(crate) mesh: Mesh,
    pub(crate) bones: Vec<u8>,
}

impl Skin {
    /// Adds what `build` draws in the frame of `bone`.
    fn add(&mut self, bone: u8, build: impl FnOnce(&mut Mesh)) {
        build(&mut self.mesh);
        self.bones.resize(self.mesh.positions.len(), bone);
    }
}

/// An ellipsoid.
fn blob(mesh: &mut Mesh, at: Vec3, radii: Vec3, surface: TriangleMaterial) {
    let mut ball = Mesh::default();
    ball.ball(8, 0.0, 1.0, 1, surface);
    mesh.add_instance(&ball, at, Mat3::IDENTITY, radii);
}

/// A limb that hangs down `length` metres from the origin, rounded at both joints.
fn limb(mesh: &mut Mesh, length: f32, radii: [f32; 3], surface: TriangleMaterial) {
    let [top, middle, low] = radii;
    let spine = [
        (Vec3::Y * top * 0.75, top * 0.55),
        (Vec3::ZERO, top),
        (-Vec3::Y * length * 0.35, middle),
        (-Vec3::Y * length, low),
        (-Vec3::Y * (length + low * 0.6), low * 0.7),
    ];
    mesh.tube(&spine, 10, 0.0, 1, surface);
}

/// A person `scale` times 1.75 m tall, with a lantern in the right hand if `lantern`.
pub(crate) fn figure(scale: f32, lantern: bool, rng: &mut Rng) -> Skin {
    let k = scale;
    let mut skin = Skin::default();
    let (coat, trousers) = (surface(Material::Cloth, rng), surface(Material::Cloth, rng));
    let (face, hair) = (surface(Material::Skin, rng), surface(Material::Hair, rng));
    let shoe = TriangleMaterial { material: Material::Leather, variant: 20 };
    let build = rng.range(0.92, 1.12);
    skin.add(bone::PELVIS, |m| {
        let spine = [(-0.10, 0.10), (-0.04, 0.145), (0.06, 0.15), (0.16, 0.135)];
        m.tube(&spine.map(|(y, r)| (Vec3::Y * y * k, r * k * build)), 12, 0.0, 1, trousers);
    });
    skin.add(bone::CHEST, |m| {
        let mut torso = Mesh::default();
        let spine =
            [(-0.06, 0.13), (0.08, 0.15), (0.22, 0.175), (0.33, 0.17), (0.385, 0.12), (0.40, 0.06), (0.46, 0.055)];
        torso.tube(&spine.map(|(y, r)| (Vec3::Y * y, r)), 14, 0.0, 1, coat);
        m.add_instance(&torso, Vec3::ZERO, Mat3::IDENTITY, Vec3::new(1.12 * build, 1.0, 0.78 * build) * k);
    });
    skin.add(bone::HEAD, |m| {
        m.tube(&[(Vec3::ZERO, 0.05 * k), (Vec3::Y * 0.1 * k, 0.05 * k)], 8, 0.0, 1, face);
        blob(m, Vec3::new(0.0, 0.16, 0.01) * k, Vec3::new(0.085, 0.12, 0.1) * k, face);
        blob(m, Vec3::new(0.0, 0.20, -0.022) * k, Vec3::new(0.094, 0.1, 0.1) * k, hair);
        blob(m, Vec3::new(0.0, 0.145, 0.112) * k, Vec3::new(0.014, 0.022, 0.018) * k, face);
    });
    for side in 0..2 {
        let (arm, leg) = (bone::ARM[side], bone::LEG[side]);
        skin.add(arm, |m| limb(m, body::UPPER_ARM * k, [0.068, 0.056, 0.046].map(|r| r * k * build), coat));
        skin.add(arm + 1, |m| {
            limb(m, body::FOREARM * 0.86 * k, [0.047, 0.043, 0.034].map(|r| r * k * build), coat);
            blob(m, -Vec3::Y * (body::FOREARM + 0.035) * k, Vec3::new(0.028, 0.07, 0.042) * k, face);
        });
        skin.add(leg, |m| limb(m, body::THIGH * k, [0.095, 0.085, 0.062].map(|r| r * k * build), trousers));
        skin.add(leg + 1, |m| limb(m, body::SHIN * k, [0.062, 0.06, 0.042].map(|r| r * k * build), trousers));
        skin.add(leg + 2, |m| {
            blob(m, Vec3::new(0.0, -0.03, 0.05) * k, Vec3::new(0.048, 0.05, 0.13) * k, shoe);
        });
    }
    if lantern {
        skin.add(bone::LANTERN, |m| {
            let iron = TriangleMaterial { material: Material::Leather, variant: 5 };
            m.tube(&[(Vec3::ZERO, 0.008), (-Vec3::Y * 0.12, 0.008)], 5, 0.0, 1, iron);
            m.block(Vec3::new(-0.07, -0.14, -0.07), Vec3::new(0.07, -0.12, 0.07), iron);
            m.block(Vec3::new(-0.07, -0.36, -0.07), Vec3::new(0.07, -0.34, 0.07), iron);
            let glow = TriangleMaterial { material: Material::Glow, variant: 0 };
            m.block(Vec3::new(-0.052, -0.34, -0.052), Vec3::new(0.052, -0.14, 0.052), glow);
        });
    }
    skin
}

/// A bird with a span of about 1.3 m times `scale`, its beak along z.
pub(crate) fn bird(scale: f32, rng: &mut Rng) -> Skin {
    let mut skin = Skin::default();
    let plumage = surface(Material::Feather, rng);
    let beak = TriangleMaterial { material: Material::Accent, variant: 1 };
    skin.add(0, |m| {
        blob(m, Vec3::ZERO, Vec3::new(0.075, 0.075, 0.20), plumage);
        blob(m, Vec3::new(0.0, 0.035, 0.2), Vec3::splat(0.055), plumage);
        m.tube(&[(Vec3::new(0.0, 0.03, 0.24), 0.018), (Vec3::new(0.0, 0.02, 0.31), 0.004)], 6, 0.0, 1, beak);
        let tail = [Vec3::new(-0.03, 0.01, -0.15), Vec3::new(0.03, 0.01, -0.15), Vec3::new(0.10, 0.0, -0.36)];
        let q = [tail[0], tail[1], tail[2], Vec3::new(-0.10, 0.0, -0.36)].map(|p| m.vertex(p, Vec3::Y));
        m.quad(q, plumage);
    });
    for (side, sign) in [-1.0_f32, 1.0].into_iter().enumerate() {
        let panel = |m: &mut Mesh, corners: [[f32; 2]; 4]| {
            let q = corners.map(|[x, z]| m.vertex(Vec3::new(sign * x, 0.0, z), Vec3::Y));
            m.quad(q, plumage);
        };
        skin.add(1 + 2 * side as u8, |m| panel(m, [[0.0, 0.10], [0.31, 0.13], [0.31, -0.13], [0.0, -0.12]]));
        skin.add(2 + 2 * side as u8, |m| panel(m, [[0.0, 0.13], [0.36, -0.02], [0.34, -0.10], [0.0, -0.13]]));
    }
    for p in &mut skin.mesh.positions {
        *p *= scale;
    }
    skin
}

/// A ball.
pub(crate) fn ball(radius: f32, rng: &mut Rng) -> Mesh {
    let mut unit = Mesh::default();
    unit.ball(14, 0.0, 1.0, 1, surface(Material::Rubber, rng));
    let mut mesh = Mesh::default();
    mesh.add_instance(&unit, Vec3::ZERO, Mat3::IDENTITY, Vec3::splat(radius));
    mesh
}

/// A wooden box with battens around its edges, of `half` metres half side, its centre at the origin.
pub(crate) fn crate_box(half: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let (planks, battens) = (surface(Material::Wood, rng), TriangleMaterial { material: Material::Paint, variant: 7 });
    mesh.block(Vec3::splat(-half * 0.94), Vec3::splat(half * 0.94), planks);
    let (h, w) = (half, half * 0.2);
    for a in [-1.0, 1.0] {
        for b in [-1.0, 1.0] {
            let edge = |x: f32| if x < 0.0 { (-h, w - h) } else { (h - w, h) };
            let ((u0, u1), (v0, v1)) = (edge(a), edge(b));
            mesh.block(Vec3::new(u0, v0, -h), Vec3::new(u1, v1, h), battens);
            mesh.block(Vec3::new(-h, u0, v0), Vec3::new(h, u1, v1), battens);
            mesh.block(Vec3::new(u0, -h, v0), Vec3::new(u1, h, v1), battens);
        }
    }
    mesh
}

/// A gate's leaf: boards between two rails with a brace, from its hinge at the origin along x.
pub(crate) fn gate_leaf(width: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let wood = surface(Material::Wood, rng);
    for y in [0.3, 1.0] {
        mesh.block(Vec3::new(0.05, y, -0.03), Vec3::new(width, y + 0.11, 0.03), wood);
    }
    let boards = (width / 0.2) as u32;
    for k in 0..boards {
        let x = 0.06 + k as f32 * (width - 0.06) / boards as f32;
        let board = surface(Material::Wood, rng);
        mesh.block(Vec3::new(x, 0.12, 0.03), Vec3::new(x + 0.15, 1.28 + 0.06 * rng.unit(), 0.055), board);
    }
    mesh
}

/// The two posts of a gate of `width` metres, from its hinge at the origin along x.
pub(crate) fn gate_posts(width: f32, rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let wood = surface(Material::Wood, rng);
    for x in [-0.08, width + 0.08] {
        mesh.block(Vec3::new(x - 0.08, -0.6, -0.08), Vec3::new(x + 0.08, 1.55, 0.08), wood);
    }
    mesh
}
