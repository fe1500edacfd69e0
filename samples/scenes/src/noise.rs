//! Value noise from an integer hash: the same on every machine, no tables.

use glam::{Vec2, Vec3};

/// Mixes 32 bits (Murmur3's finaliser).
#[inline]
pub(crate) fn mix(mut h: u32) -> u32 {
    h ^= h >> 16;
    h = h.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// A uniform number in [0, 1) from a lattice point and a seed.
#[inline]
pub(crate) fn lattice(x: i32, y: i32, z: i32, seed: u32) -> f32 {
    let h = (x as u32).wrapping_mul(0x9e37_79b1)
        ^ (y as u32).wrapping_mul(0x85eb_ca77)
        ^ (z as u32).wrapping_mul(0xc2b2_ae3d)
        ^ seed.wrapping_mul(0x27d4_eb2f);
    (mix(h) >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[inline]
fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[inline]
fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Value noise in the plane, -1 to 1, one cell per unit.
#[inline]
pub(crate) fn value2(p: Vec2, seed: u32) -> f32 {
    let (fx, fy) = (p.x.floor(), p.y.floor());
    let (x, y) = (fx as i32, fy as i32);
    let (u, v) = (fade(p.x - fx), fade(p.y - fy));
    let at = |dx, dy| lattice(x + dx, y + dy, 0, seed);
    2.0 * lerp(lerp(at(0, 0), at(1, 0), u), lerp(at(0, 1), at(1, 1), u), v) - 1.0
}

/// Value noise in space, -1 to 1, one cell per unit.
#[inline]
pub(crate) fn value3(p: Vec3, seed: u32) -> f32 {
    let f = p.floor();
    let (x, y, z) = (f.x as i32, f.y as i32, f.z as i32);
    let (u, v, w) = (fade(p.x - f.x), fade(p.y - f.y), fade(p.z - f.z));
    let at = |dx, dy, dz| lattice(x + dx, y + dy, z + dz, seed);
    let low = lerp(lerp(at(0, 0, 0), at(1, 0, 0), u), lerp(at(0, 1, 0), at(1, 1, 0), u), v);
    let high = lerp(lerp(at(0, 0, 1), at(1, 0, 1), u), lerp(at(0, 1, 1), at(1, 1, 1), u), v);
    2.0 * lerp(low, high, w) - 1.0
}

/// Fractal sum in the plane: octave k has frequency `frequency * 2^k` and amplitude `2^-k`, and fades out where a pixel
/// of `footprint` units no longer resolves it. Roughly -1 to 1.
#[inline]
pub(crate) fn fractal2(p: Vec2, frequency: f32, octaves: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut f, mut a) = (0.0, frequency, 0.5);
    for k in 0..octaves {
        let weight = resolved(f * footprint);
        if weight <= 0.0 {
            break;
        }
        sum += a * weight * value2(p * f, seed.wrapping_add(k * 101));
        f *= 2.03;
        a *= 0.5;
    }
    sum
}

/// As [`fractal2`], in space.
#[inline]
pub(crate) fn fractal3(p: Vec3, frequency: f32, octaves: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut f, mut a) = (0.0, frequency, 0.5);
    for k in 0..octaves {
        let weight = resolved(f * footprint);
        if weight <= 0.0 {
            break;
        }
        sum += a * weight * value3(p * f, seed.wrapping_add(k * 101));
        f *= 2.03;
        a *= 0.5;
    }
    sum
}

/// 1 for features of four pixels and more, falling to 0 at two pixels, to avoid aliasing.
#[inline]
fn resolved(cycles_per_pixel: f32) -> f32 {
    ((0.5 - cycles_per_pixel) * 4.0).clamp(0.0, 1.0)
}

/// A sequence of seeded numbers for placement and shapes.
#[derive(Debug, Clone)]
pub struct Rng(u64);

impl Rng {
    /// Starts a sequence; equal seeds give equal sequences.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x243f_6a88_85a3_08d3)
    }

    /// The next 32 bits (SplitMix64).
    pub fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 32) as u32
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in [`low`, `high`).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// A point on the unit sphere.
    pub fn direction(&mut self) -> Vec3 {
        let y = self.range(-1.0, 1.0);
        let a = self.range(0.0, std::f32::consts::TAU);
        let r = (1.0 - y * y).max(0.0).sqrt();
        Vec3::new(r * a.cos(), y, r * a.sin())
    }
}
