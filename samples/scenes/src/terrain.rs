//! The ground: its height, a path to walk on, and its material.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use crate::family::Family;
use crate::material::{MaterialSample, sandstone, smooth};
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::{Rng, fractal2, value2};

/// Half the side of the finely meshed square, in metres.
pub(crate) const FINE: f32 = 96.0;
/// Half the side of the whole terrain, in metres.
pub(crate) const WHOLE: f32 = 640.0;
const FINE_CELL: f32 = 1.5;
const COARSE_CELL: f32 = 16.0;
/// How far a walker gets from the origin in a level, in metres along an axis; see [`level_distance`].
pub(crate) const LEVEL: f32 = 50.0;
/// Distances at which the hills around a level begin and end to rise, in metres.
const RIM: (f32, f32) = (47.0, 60.0);
/// Half the side of the square in a level that the hills around it never reach, in metres.
const CORE: f32 = 40.0;
/// Height of the hills around a level, in metres.
const RIM_HEIGHT: f32 = 11.0;

/// The ground of one scene.
#[derive(Debug, Clone)]
pub struct Terrain {
    family: Family,
    seed: u32,
    bends: [Vec3; 3],
    mesas: Vec<(Vec2, f32, f32)>,
    /// Whether hills close it around the origin.
    closed: bool,
}

/// Distance from the origin by a norm whose circles are squares with round corners, in metres.
fn level_distance(at: Vec2) -> f32 {
    let powers = at.abs().powf(6.0);
    (powers.x + powers.y).powf(1.0 / 6.0)
}

impl Terrain {
    /// The ground of `family` for a seed, closed by hills about 50 m from the origin.
    pub(crate) fn level(family: Family, seed: u64) -> Self {
        Self { closed: true, ..Self::new(family, seed) }
    }

    /// The ground of `family` for a seed.
    pub fn new(family: Family, seed: u64) -> Self {
        let mut rng = Rng::new(seed ^ 0x7e44a1);
        // Bends of the path: amplitude in metres, angular frequency per metre, phase.
        // The path runs straight between walls.
        let curved = if matches!(family, Family::Indoors | Family::Town) { 0.0 } else { 1.0 };
        let bends = [(3.5, 0.045), (6.0, 0.021), (1.2, 0.11)].map(|(amplitude, frequency)| {
            Vec3::new(amplitude * rng.range(0.5, 1.2) * curved, frequency * rng.range(0.8, 1.25), rng.range(0.0, TAU))
        });
        let mesas = match family {
            Family::Desert => (0..9)
                .map(|k| {
                    let angle = (k as f32 + rng.range(-0.4, 0.4)) / 9.0 * TAU;
                    let at = Vec2::from_angle(angle) * rng.range(210.0, 430.0);
                    (at, rng.range(35.0, 80.0), rng.range(28.0, 62.0))
                })
                .collect(),
            _ => Vec::new(),
        };
        Self { family, seed: rng.bits(), bends, mesas, closed: false }
    }

    /// Whether hills close it around the origin.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// The point of the level towards `at`, if that is outside: `at` itself in a scene that is not closed.
    pub(crate) fn inside(&self, at: Vec2) -> Vec2 {
        if !self.closed || at.abs().max_element() < CORE {
            return at;
        }
        at * (LEVEL / level_distance(at)).min(1.0)
    }

    /// How far the hills around a level have risen at (east, north): 0 inside, 1 on their top.
    fn rim(&self, at: Vec2) -> f32 {
        if !self.closed || at.abs().max_element() < CORE {
            return 0.0;
        }
        let ragged = 4.0 * fractal2(at, 1.0 / 15.0, 3, 0.0, self.seed ^ 51);
        smooth(RIM.0, RIM.1, level_distance(at) + ragged)
    }

    /// East coordinate of the path's centre line at `north`.
    pub fn path(&self, north: f32) -> f32 {
        // The path runs through the origin, so that a walk can start there.
        self.bends.iter().map(|b| b.x * ((north * b.y + b.z).sin() - b.z.sin())).sum()
    }

    /// Signed distance from the path's centre line in metres, positive to the east.
    pub fn path_offset(&self, at: Vec2) -> f32 {
        let slope: f32 = self.bends.iter().map(|b| b.x * b.y * (at.y * b.y + b.z).cos()).sum();
        (at.x - self.path(at.y)) / (1.0 + slope * slope).sqrt()
    }

    /// Half the width of the path, in metres.
    pub fn path_half_width(&self) -> f32 {
        match self.family {
            Family::Forest => 1.3,
            Family::Sword => 1.0,
            Family::Desert => 3.4,
            Family::Snow => 1.6,
            Family::Indoors => 1.2,
            Family::Town => 3.0,
        }
    }

    /// Height in metres at (east, north).
    pub fn height(&self, at: Vec2) -> f32 {
        let (swell, rough) = match self.family {
            Family::Forest => (5.0, 1.1),
            Family::Sword => (11.0, 1.6),
            Family::Desert => (4.0, 0.9),
            Family::Snow => (9.0, 0.8),
            Family::Indoors | Family::Town => return 0.0,
        };
        let off = self.path_offset(at).abs();
        let wide = self.path_half_width();
        let hills = swell * (fractal2(at, 1.0 / 95.0, 2, 0.0, self.seed));
        let away = smooth(wide, wide * 4.0 + 5.0, off);
        let detail = rough * fractal2(at, 1.0 / 11.0, 3, 0.0, self.seed ^ 77) * (0.12 + 0.88 * away);
        let bank = match self.family {
            Family::Sword => 5.0 * smooth(6.0, 40.0, off) * (0.4 + 0.6 * value2(at / 60.0, self.seed ^ 5).abs()),
            Family::Forest => 1.2 * smooth(4.0, 22.0, off),
            _ => 0.0,
        };
        let far = smooth(150.0, WHOLE, at.length());
        let ridge = match self.family {
            Family::Desert => 8.0,
            Family::Forest => 30.0,
            _ => 120.0,
        };
        let mountains = far * ridge * (0.55 + fractal2(at, 1.0 / 160.0, 4, 0.0, self.seed ^ 31)).max(0.0);
        let open = hills + detail + bank + mountains + self.mesa(at);
        match self.rim(at) {
            0.0 => open,
            rim => open + rim * RIM_HEIGHT * (1.0 + 0.5 * fractal2(at, 1.0 / 21.0, 3, 0.0, self.seed ^ 52)),
        }
    }

    /// Height of the fine mesh at (east, north): of the triangle over it, where things stand.
    pub(crate) fn mesh_height(&self, at: Vec2) -> f32 {
        let cell = (at / FINE_CELL).floor();
        let f = at / FINE_CELL - cell;
        let corner = |i: f32, j: f32| self.height((cell + Vec2::new(i, j)) * FINE_CELL);
        let (low, high) = (corner(0.0, 0.0), corner(1.0, 1.0));
        if f.y >= f.x {
            let north = corner(0.0, 1.0);
            low + (north - low) * f.y + (high - north) * f.x
        } else {
            let east = corner(1.0, 0.0);
            low + (east - low) * f.x + (high - east) * f.y
        }
    }

    fn mesa(&self, at: Vec2) -> f32 {
        let ragged = 9.0 * fractal2(at, 1.0 / 28.0, 3, 0.0, self.seed ^ 9);
        self.mesas
            .iter()
            .map(|&(centre, radius, height)| {
                let d = centre.distance(at) + ragged;
                let foot = 0.22 * height * (1.0 - smooth(radius, radius * 2.1, d));
                height * 0.78 * (1.0 - smooth(radius * 0.82, radius, d)) + foot
            })
            .fold(0.0, f32::max)
    }

    /// Unit normal at (east, north).
    pub fn normal(&self, at: Vec2, step: f32) -> Vec3 {
        let dx = self.height(at + Vec2::X * step) - self.height(at - Vec2::X * step);
        let dz = self.height(at + Vec2::Y * step) - self.height(at - Vec2::Y * step);
        Vec3::new(-dx, 2.0 * step, -dz).normalize()
    }

    /// The point on the ground at (east, north).
    pub fn on(&self, at: Vec2) -> Vec3 {
        Vec3::new(at.x, self.height(at), at.y)
    }

    /// Meshes in square tiles of at most 24 x 24 cells, fine near the origin and coarse farther out.
    pub fn tiles(&self, surface: TriangleMaterial) -> Vec<Mesh> {
        let mut tiles = self.grid(FINE, FINE_CELL, 0.0, 16, surface);
        tiles.extend(self.grid(WHOLE, COARSE_CELL, FINE - COARSE_CELL, 10, surface));
        tiles
    }

    /// A grid over the square of half side `half`, without the square of half side `hole`.
    fn grid(&self, half: f32, cell: f32, hole: f32, tile: i32, surface: TriangleMaterial) -> Vec<Mesh> {
        let n = (half / cell) as i32;
        let at = |i: i32, j: i32| Vec2::new(i as f32 * cell, j as f32 * cell);
        let mut tiles = Vec::new();
        for tj in (-n..n).step_by(tile as usize) {
            for ti in (-n..n).step_by(tile as usize) {
                let mut mesh = Mesh::default();
                let (ei, ej) = ((ti + tile).min(n), (tj + tile).min(n));
                for j in tj..=ej {
                    for i in ti..=ei {
                        let p = at(i, j);
                        // The coarse ring extends one cell under the fine square, so that there is no gap.
                        let sink = if hole > 0.0 && p.abs().max_element() < FINE { 1.0 } else { 0.0 };
                        mesh.vertex(self.on(p) - Vec3::Y * sink, self.normal(p, cell * 0.5));
                    }
                }
                let row = (ei - ti + 1) as u32;
                for j in 0..(ej - tj) as u32 {
                    for i in 0..(ei - ti) as u32 {
                        let middle = (at(ti, tj) + Vec2::new(i as f32 + 0.5, j as f32 + 0.5) * cell).abs();
                        if middle.max_element() < hole {
                            continue;
                        }
                        let a = j * row + i;
                        mesh.quad([a, a + row, a + row + 1, a + 1], surface);
                    }
                }
                if !mesh.triangles.is_empty() {
                    tiles.push(mesh);
                }
            }
        }
        tiles
    }

    /// Material properties of the ground at `p`, and the slope (metres per metre) of its small bumps.
    pub fn surface_at(&self, p: Vec3, normal: Vec3, footprint: f32) -> (MaterialSample, Vec2) {
        let at = Vec2::new(p.x, p.z);
        // The path ends at the foot of the hills around a level.
        let off = self.path_offset(at);
        let off = off + (60.0 * self.rim(at)).copysign(off);
        let wide = self.path_half_width();
        let noise = |frequency: f32, octaves: u32, k: u32| fractal2(at, frequency, octaves, footprint, self.seed ^ k);
        let edge = noise(0.9, 3, 1) * 0.8;
        let on_path = 1.0 - smooth(wide - 0.35, wide + 0.45, off.abs() + edge);
        let (fine, coarse) = (noise(5.0, 4, 2), noise(0.25, 3, 3));
        let steep = 1.0 - smooth(0.72, 0.86, normal.y);
        let slope = |height: f32, frequency: f32| {
            let step = footprint.max(0.04);
            let h = |d: Vec2| fractal2(at + d, frequency, 3, footprint, self.seed ^ 4) * height;
            let here = h(Vec2::ZERO);
            Vec2::new(h(Vec2::X * step) - here, h(Vec2::Y * step) - here) / step
        };
        let (albedo, bumps) = match self.family {
            Family::Forest => {
                let litter =
                    Vec3::new(0.17, 0.11, 0.055).lerp(Vec3::new(0.25, 0.15, 0.06), (fine + 0.5).clamp(0.0, 1.0));
                let moss = Vec3::new(0.10, 0.16, 0.045) * (1.0 + 0.6 * fine);
                let floor = litter.lerp(moss, smooth(-0.05, 0.3, coarse + 0.3 * noise(1.3, 3, 6)));
                let trail = Vec3::new(0.27, 0.205, 0.14) * (1.0 + 0.55 * fine + 0.3 * noise(1.5, 2, 7));
                (floor.lerp(trail, on_path), slope(0.10, 4.0))
            }
            Family::Sword => {
                let blades = noise(9.0, 3, 8);
                let grass = Vec3::new(0.12, 0.20, 0.045)
                    .lerp(Vec3::new(0.27, 0.27, 0.09), (coarse * 1.4 + 0.5).clamp(0.0, 1.0));
                let grass = grass * (1.0 + 0.55 * fine + 0.35 * blades);
                let trail = Vec3::new(0.34, 0.26, 0.17) * (1.0 + 0.5 * fine);
                let stone = Vec3::new(0.27, 0.26, 0.25) * (1.0 + 0.8 * fine + 0.5 * coarse);
                (grass.lerp(trail, on_path).lerp(stone, steep), slope(0.09, 4.0))
            }
            Family::Desert => self.desert(p, off, wide, steep, fine, coarse, footprint),
            Family::Snow => {
                let snow = Vec3::new(0.84, 0.88, 0.95) * (1.0 + 0.05 * fine + 0.05 * coarse);
                let rut = |middle: f32| (1.0 - smooth(0.16, 0.34, (off.abs() - middle).abs() + 0.25 * edge)).max(0.0);
                let track = rut(0.75);
                let packed = Vec3::new(0.62, 0.66, 0.74) * (1.0 + 0.25 * fine);
                let stone = Vec3::new(0.25, 0.255, 0.27) * (1.0 + 0.7 * fine);
                let bare = smooth(0.55, 0.75, steep);
                let drift = slope(0.10, 0.9) + Vec2::X * (track * 1.2 * (off.abs() - 0.75).signum() * off.signum());
                (snow.lerp(packed, track * 0.8).lerp(stone, bare), drift)
            }
            // Built over with floors and streets of their own.
            Family::Indoors | Family::Town => (Vec3::new(0.16, 0.17, 0.12) * (1.0 + 0.5 * fine), Vec2::ZERO),
        };
        (
            MaterialSample { albedo: albedo.max(Vec3::splat(0.01)), gloss: 0.0, translucency: 0.0 },
            bumps.clamp_length_max(1.2),
        )
    }

    #[expect(clippy::too_many_arguments, reason = "the local facts of one point, each used once")]
    fn desert(&self, p: Vec3, off: f32, wide: f32, steep: f32, fine: f32, coarse: f32, footprint: f32) -> (Vec3, Vec2) {
        let at = Vec2::new(p.x, p.z);
        let sand = Vec3::new(0.52, 0.36, 0.21).lerp(Vec3::new(0.60, 0.45, 0.29), (coarse + 0.5).clamp(0.0, 1.0));
        let pebbles = fractal2(at, 9.0, 2, footprint, self.seed ^ 12);
        let sand = sand * (1.0 + 0.3 * fine) * (1.0 - 0.45 * smooth(0.22, 0.4, pebbles));
        let stone = sandstone(p, fractal2(at + p.y, 0.2, 3, footprint, self.seed ^ 13));
        let asphalt = Vec3::splat(0.135) * (1.0 + 0.45 * fine + 0.25 * coarse);
        let soft = footprint.max(0.02);
        let line = |middle: f32, half: f32| 1.0 - smooth(half - soft * 0.5, half + soft, (off - middle).abs());
        let dash =
            smooth(0.0, 0.05, (p.z / 6.0).rem_euclid(1.0)) * (1.0 - smooth(0.45, 0.5, (p.z / 6.0).rem_euclid(1.0)));
        let worn = (0.85 + fine).clamp(0.3, 1.0);
        let paint = (line(0.0, 0.07) * dash + line(wide - 0.35, 0.06) + line(0.35 - wide, 0.06)).min(1.0) * worn;
        let sandy = smooth(0.05, 0.5, fine + 0.35 * coarse + 0.25 * smooth(0.5, 1.0, off.abs() / wide));
        let road = asphalt.lerp(Vec3::new(0.62, 0.55, 0.35), paint).lerp(sand, 0.55 * sandy);
        let on_road = 1.0 - smooth(wide - 0.06, wide + 0.1 + soft, off.abs() + 0.12 * fine);
        let ripple = (p.x * 3.1 + 2.0 * fractal2(at, 0.3, 2, footprint, self.seed ^ 14) + p.z * 0.9).sin();
        let bumps = Vec2::new(0.16, 0.05) * ripple * (1.0 - (footprint * 3.0).clamp(0.0, 1.0)) * (1.0 - on_road);
        (sand.lerp(stone, smooth(0.2, 0.7, steep)).lerp(road, on_road), bumps)
    }
}
