//! Triangle meshes and the solids they are built from.

use std::f32::consts::TAU;

use glam::{Mat3, Vec2, Vec3};

use crate::material::Material;
use crate::noise::{Rng, fractal3};

/// Vertices with normals, and triangles with a material each.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Positions in metres.
    pub positions: Vec<Vec3>,
    /// Unit normals, one per position.
    pub normals: Vec<Vec3>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Material of each triangle.
    pub materials: Vec<TriangleMaterial>,
}

/// Material of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleMaterial {
    /// The kind of surface.
    pub material: Material,
    /// Variation of colour and texture between objects, 0 to 255.
    pub variant: u8,
}

impl Mesh {
    /// Adds a vertex.
    pub fn vertex(&mut self, position: Vec3, normal: Vec3) -> u32 {
        self.positions.push(position);
        self.normals.push(normal.normalize_or(Vec3::Y));
        (self.positions.len() - 1) as u32
    }

    /// Adds a triangle.
    pub fn triangle(&mut self, corners: [u32; 3], surface: TriangleMaterial) {
        self.triangles.push(corners);
        self.materials.push(surface);
    }

    /// Adds two triangles over four vertices in order around the quad.
    pub fn quad(&mut self, q: [u32; 4], surface: TriangleMaterial) {
        self.triangle([q[0], q[1], q[2]], surface);
        self.triangle([q[0], q[2], q[3]], surface);
    }

    /// Adds a copy of `other`, rotated by `rotation`, scaled by `scale` and moved to `at`.
    pub fn add_instance(&mut self, other: &Mesh, at: Vec3, rotation: Mat3, scale: Vec3) {
        let base = self.positions.len() as u32;
        let inverse = Vec3::ONE / scale;
        self.positions.extend(other.positions.iter().map(|&p| at + rotation * (p * scale)));
        self.normals.extend(other.normals.iter().map(|&n| (rotation * (n * inverse)).normalize_or(Vec3::Y)));
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
        self.materials.extend_from_slice(&other.materials);
    }

    /// A tube along `spine` (centre, radius) with `sides` sides; radii vary by the fraction `rough`.
    pub fn tube(&mut self, spine: &[(Vec3, f32)], sides: u32, rough: f32, seed: u32, surface: TriangleMaterial) {
        let mut rings: Vec<u32> = Vec::with_capacity(spine.len());
        for (k, &(centre, radius)) in spine.iter().enumerate() {
            let before = spine[k.saturating_sub(1)].0;
            let after = spine[(k + 1).min(spine.len() - 1)].0;
            let along = (after - before).normalize_or(Vec3::Y);
            let (u, v) = along.any_orthonormal_pair();
            rings.push(self.positions.len() as u32);
            for s in 0..sides {
                let (sin, cos) = (s as f32 / sides as f32 * TAU).sin_cos();
                let out = u * cos + v * sin;
                let bump = fractal3(out * 1.5 + Vec3::Y * k as f32 * 0.7, 1.0, 2, 0.0, seed);
                self.vertex(centre + out * radius * (1.0 + rough * bump), out);
            }
        }
        for pair in rings.windows(2) {
            for s in 0..sides {
                let t = (s + 1) % sides;
                self.quad([pair[0] + s, pair[1] + s, pair[1] + t, pair[0] + t], surface);
            }
        }
        if let (Some(&last), Some(&(tip, radius))) = (rings.last(), spine.last())
            && radius > 1e-3
        {
            let along = (tip - spine[spine.len() - 2].0).normalize_or(Vec3::Y);
            let centre = self.vertex(tip + along * radius * 0.4, along);
            for s in 0..sides {
                self.triangle([last + s, centre, last + (s + 1) % sides], surface);
            }
        }
    }

    /// A lumpy ball of radius about 1 with `rings` x `2 rings` faces; `rough` is the height of its lumps.
    pub fn ball(&mut self, rings: u32, rough: f32, frequency: f32, seed: u32, surface: TriangleMaterial) {
        let around = rings * 2;
        let base = self.positions.len() as u32;
        let at = |i: u32, j: u32| -> Vec3 {
            let (st, ct) = (i as f32 / rings as f32 * TAU * 0.5).sin_cos();
            let (sp, cp) = ((j % around) as f32 / around as f32 * TAU).sin_cos();
            let d = Vec3::new(st * cp, ct, st * sp);
            d * (1.0 + rough * fractal3(d * frequency, 1.0, 3, 0.0, seed) * 2.0)
        };
        for i in 0..=rings {
            for j in 0..around {
                let p = at(i, j);
                // Normal from neighbouring points; at the poles, where the rings have no extent, the radial direction.
                let normal = if i == 0 || i == rings {
                    p
                } else {
                    (at(i, j + 1) - at(i, j + around - 1)).cross(at(i + 1, j) - at(i - 1, j))
                };
                let normal = if normal.dot(p) < 0.0 { -normal } else { normal };
                self.vertex(p, normal);
            }
        }
        for i in 0..rings {
            for j in 0..around {
                let k = (j + 1) % around;
                let (a, b) = (base + i * around, base + (i + 1) * around);
                self.quad([a + j, a + k, b + k, b + j], surface);
            }
        }
    }

    /// `count` leaves scattered through an ellipsoid around `centre`. Their normals follow the ellipsoid, so that the crown is shaded as one body.
    pub fn crown(
        &mut self,
        centre: Vec3,
        radii: Vec3,
        count: u32,
        leaf: f32,
        rng: &mut Rng,
        surface: TriangleMaterial,
    ) {
        for _ in 0..count {
            let d = rng.direction();
            let p = centre + d * radii * rng.range(0.55, 1.0);
            let (u, v) = (d + rng.direction() * 0.9).normalize_or(d).any_orthonormal_pair();
            let (sin, cos) = rng.range(0.0, TAU).sin_cos();
            let (a, b) = (u * cos + v * sin, v * cos - u * sin);
            let size = leaf * rng.range(0.7, 1.3);
            let normal = d + Vec3::Y * 0.25;
            let corner = |m: &mut Self, x: f32, y: f32| m.vertex(p + (a * x + b * y) * size, normal);
            let q =
                [corner(self, -0.9, -0.1), corner(self, 0.0, -0.55), corner(self, 0.9, 0.05), corner(self, 0.05, 0.55)];
            self.quad(q, surface);
        }
    }

    /// One storey of a fir: a cone from `top` down to a ragged hem of `radius`.
    pub fn skirt(&mut self, top: Vec3, radius: f32, drop: f32, points: u32, rng: &mut Rng, surface: TriangleMaterial) {
        let apex = self.vertex(top, Vec3::Y);
        let start = rng.range(0.0, TAU);
        let hem: Vec<u32> = (0..points * 2)
            .map(|k| {
                let out = if k % 2 == 0 { rng.range(0.85, 1.1) } else { rng.range(0.5, 0.68) };
                let (sin, cos) = (start + k as f32 / (points * 2) as f32 * TAU).sin_cos();
                let d = Vec3::new(cos, 0.0, sin);
                let fall = drop * if k % 2 == 0 { rng.range(0.9, 1.15) } else { rng.range(0.65, 0.8) };
                self.vertex(top + d * radius * out - Vec3::Y * fall, d + Vec3::Y * 0.7)
            })
            .collect();
        for k in 0..hem.len() {
            self.triangle([apex, hem[k], hem[(k + 1) % hem.len()]], surface);
        }
    }

    /// A tuft of `blades` thin leaves from the ground, `height` tall.
    pub fn tuft(&mut self, at: Vec3, blades: u32, height: f32, spread: f32, rng: &mut Rng, surface: TriangleMaterial) {
        for _ in 0..blades {
            let (sin, cos) = rng.range(0.0, TAU).sin_cos();
            let out = Vec3::new(cos, 0.0, sin);
            let side = Vec3::new(-sin, 0.0, cos) * height * rng.range(0.05, 0.09);
            let root = at + out * spread * rng.range(0.0, 0.5);
            let bend = out * height * rng.range(0.15, 0.6);
            let tall = Vec3::Y * height * rng.range(0.7, 1.2);
            let normal = Vec3::Y + out * 0.4;
            let q = [
                self.vertex(root - side, normal),
                self.vertex(root + side, normal),
                self.vertex(root + side * 0.7 + bend * 0.4 + tall * 0.6, normal),
                self.vertex(root - side * 0.7 + bend * 0.4 + tall * 0.6, normal),
            ];
            let tip = self.vertex(root + bend + tall, normal);
            self.quad(q, surface);
            self.triangle([q[3], q[2], tip], surface);
        }
    }

    /// A flat bar along `spine` with a diamond cross-section, like a blade. Spine: `(centre, half width, half thickness)`; the width is along
    /// `across`.
    pub fn bar(&mut self, spine: &[(Vec3, f32, f32)], across: Vec3, surface: TriangleMaterial) {
        let along = (spine[spine.len() - 1].0 - spine[0].0).normalize_or(Vec3::Y);
        let thick = along.cross(across).normalize_or(Vec3::X);
        for pair in spine.windows(2) {
            for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)] {
                // One face from edge (a) to ridge (b), with its own flat normal.
                let normal = across * a * pair[0].2 + thick * b * pair[0].1;
                let edge = |s: &(Vec3, f32, f32)| s.0 + across * a * s.1;
                let ridge = |s: &(Vec3, f32, f32)| s.0 + thick * b * s.2;
                let q = [edge(&pair[0]), ridge(&pair[0]), ridge(&pair[1]), edge(&pair[1])];
                let q = q.map(|p| self.vertex(p, normal));
                self.quad(q, surface);
            }
        }
    }

    /// An axis-aligned box.
    pub fn block(&mut self, low: Vec3, high: Vec3, surface: TriangleMaterial) {
        for axis in 0..3 {
            for end in [low, high] {
                let sign = if end == high { 1.0 } else { -1.0 };
                let mut normal = Vec3::ZERO;
                normal[axis] = sign;
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y].map(|c| {
                    let mut p = Vec3::ZERO;
                    p[axis] = end[axis];
                    p[u] = low[u] + (high[u] - low[u]) * c.x;
                    p[v] = low[v] + (high[v] - low[v]) * c.y;
                    self.vertex(p, normal)
                });
                self.quad(corners, surface);
            }
        }
    }
}
