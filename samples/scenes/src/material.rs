//! Materials: reflectance of a surface point before lighting.

use glam::{Vec2, Vec3};

use crate::mesh::TriangleMaterial;
use crate::noise::{fractal2, fractal3, lattice};

/// A kind of surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Material {
    /// The terrain; its appearance depends on the family.
    Ground,
    /// Bark of a living tree.
    Bark,
    /// Broad leaves, by variant from fresh to autumnal green.
    Leaf,
    /// Needles.
    Needle,
    /// Needles with snow on their upper side.
    SnowyNeedle,
    /// Grass blades.
    Grass,
    /// Dry scrub.
    Scrub,
    /// Grey rock.
    Rock,
    /// Red sandstone in strata.
    Sandstone,
    /// Rock with snow on its upper side.
    SnowyRock,
    /// Cactus skin with ribs.
    Cactus,
    /// Weathered planks.
    Wood,
    /// Polished steel.
    Steel,
    /// Gilded metal.
    Gold,
    /// Dark leather.
    Leather,
    /// A cap of mushrooms, or berries.
    Accent,
    /// Woven cloth with stripes and checks, in a colour by variant.
    Cloth,
    /// Skin of a person.
    Skin,
    /// Hair.
    Hair,
    /// Plumage, dark with light bars.
    Feather,
    /// A rubber ball's panels in two colours.
    Rubber,
    /// Something that gives light: a lamp's shade or a lit window, by variant.
    Glow,
    /// Painted plaster.
    Plaster,
    /// Floor boards along north.
    Boards,
    /// Bricks.
    Brick,
    /// Stone tiles in two shades.
    Tiles,
    /// Wet asphalt with patches of standing water.
    Asphalt,
    /// Glossy paint, in a colour by variant.
    Paint,
    /// Still water, which mirrors.
    Water,
}

/// Material properties at one point.
#[derive(Debug, Clone, Copy)]
pub struct MaterialSample {
    /// Linear RGB reflectance, 0 to 1.
    pub albedo: Vec3,
    /// Specular strength, 0 to 1.
    pub gloss: f32,
    /// Transmission of light from behind, 0 to 1.
    pub translucency: f32,
}

impl MaterialSample {
    fn matte(albedo: Vec3) -> Self {
        Self { albedo, gloss: 0.0, translucency: 0.0 }
    }
}

const SNOW: Vec3 = Vec3::new(0.86, 0.9, 0.97);

/// Properties of `material` at `p` metres (in the object's own frame for a held item); a pixel covers `footprint` metres.
pub(crate) fn material_at(material: Material, variant: u8, p: Vec3, normal: Vec3, footprint: f32) -> MaterialSample {
    let v = f32::from(variant) / 255.0;
    let grain = |frequency: f32, octaves: u32| fractal3(p, frequency, octaves, footprint, u32::from(variant));
    match material {
        Material::Ground => MaterialSample::matte(Vec3::splat(0.4)),
        Material::Bark => {
            let ridges = fractal3(p * Vec3::new(9.0, 1.6, 9.0), 1.0, 3, footprint * 9.0, u32::from(variant));
            let moss = (grain(0.9, 2) + 0.15 - p.y.rem_euclid(9.0) * 0.05).clamp(0.0, 0.5);
            let bark = Vec3::new(0.17, 0.125, 0.09).lerp(Vec3::new(0.25, 0.22, 0.19), v) * (1.0 + 0.8 * ridges);
            MaterialSample::matte(bark.lerp(Vec3::new(0.12, 0.16, 0.05), moss))
        }
        Material::Leaf => {
            let base = Vec3::new(0.10, 0.21, 0.045).lerp(Vec3::new(0.27, 0.25, 0.06), v * v);
            MaterialSample { albedo: base * (1.0 + 0.5 * grain(1.3, 3)), gloss: 0.04, translucency: 0.5 }
        }
        Material::Needle => {
            let base = Vec3::new(0.045, 0.11, 0.055).lerp(Vec3::new(0.08, 0.15, 0.05), v);
            MaterialSample { albedo: base * (1.0 + 0.8 * grain(4.0, 3)), gloss: 0.02, translucency: 0.2 }
        }
        Material::SnowyNeedle => {
            let needle = Vec3::new(0.05, 0.10, 0.07) * (1.0 + 0.7 * grain(4.0, 3));
            let snow = smooth(0.35, 0.75, normal.y + 0.55 * grain(1.7, 3) + 0.05);
            MaterialSample::matte(needle.lerp(SNOW, snow))
        }
        Material::Grass => {
            let base = Vec3::new(0.13, 0.22, 0.04).lerp(Vec3::new(0.30, 0.28, 0.09), v);
            MaterialSample { albedo: base, gloss: 0.03, translucency: 0.5 }
        }
        Material::Scrub => MaterialSample {
            albedo: Vec3::new(0.30, 0.24, 0.12).lerp(Vec3::new(0.22, 0.25, 0.12), v),
            gloss: 0.0,
            translucency: 0.3,
        },
        Material::Rock => MaterialSample::matte(rock(v, grain(1.2, 4), grain(7.0, 3))),
        Material::SnowyRock => {
            let snow = smooth(0.3, 0.6, normal.y + 0.5 * grain(1.6, 3));
            MaterialSample::matte(rock(v, grain(1.2, 4), grain(7.0, 3)).lerp(SNOW, snow))
        }
        Material::Sandstone => MaterialSample::matte(sandstone(p, grain(0.5, 4))),
        Material::Cactus => {
            let ribs = (p.x * 41.0).sin() * (p.z * 37.0).cos() * (1.0 - (footprint * 20.0)).clamp(0.0, 1.0);
            let base = Vec3::new(0.13, 0.22, 0.10).lerp(Vec3::new(0.19, 0.24, 0.12), v);
            MaterialSample { albedo: base * (1.0 + 0.25 * ribs + 0.3 * grain(2.5, 3)), gloss: 0.06, translucency: 0.0 }
        }
        Material::Wood => {
            let lines = fractal3(p * Vec3::new(22.0, 3.0, 22.0), 1.0, 3, footprint * 20.0, u32::from(variant));
            MaterialSample::matte(Vec3::new(0.26, 0.20, 0.15) * (1.0 + 0.6 * lines))
        }
        Material::Steel => {
            let scratch = fractal2(Vec2::new(p.x * 60.0, p.y * 4.0), 1.0, 3, footprint * 60.0, 5);
            MaterialSample {
                albedo: Vec3::new(0.42, 0.45, 0.50) * (1.0 + 0.25 * scratch),
                gloss: 0.85,
                translucency: 0.0,
            }
        }
        Material::Gold => MaterialSample {
            albedo: Vec3::new(0.55, 0.40, 0.13) * (1.0 + 0.3 * grain(40.0, 2)),
            gloss: 0.6,
            translucency: 0.0,
        },
        Material::Leather => {
            let wrap = (p.y * 150.0 + p.x * 40.0).sin() * (1.0 - footprint * 120.0).clamp(0.0, 1.0);
            MaterialSample { albedo: Vec3::new(0.13, 0.065, 0.04) * (1.0 + 0.45 * wrap), gloss: 0.1, translucency: 0.0 }
        }
        Material::Accent => {
            let hue = [Vec3::new(0.55, 0.08, 0.05), Vec3::new(0.6, 0.4, 0.08), Vec3::new(0.5, 0.42, 0.55)];
            MaterialSample { albedo: hue[usize::from(variant % 3)], gloss: 0.1, translucency: 0.2 }
        }
        Material::Cloth => {
            let base = HUES[usize::from(variant % 8)];
            let round = p.x.atan2(p.z);
            let stripe = wave(p.y * 11.0, footprint * 11.0) * 0.22 + wave(round * 1.6, footprint * 12.0) * 0.12;
            MaterialSample::matte(base * (1.0 + stripe + 0.4 * grain(14.0, 3)))
        }
        Material::Skin => MaterialSample::matte(
            Vec3::new(0.58, 0.38, 0.28).lerp(Vec3::new(0.24, 0.14, 0.09), v) * (1.0 + 0.25 * grain(18.0, 3)),
        ),
        Material::Hair => MaterialSample::matte(
            Vec3::new(0.05, 0.035, 0.025).lerp(Vec3::new(0.30, 0.19, 0.08), v) * (1.0 + 0.7 * grain(30.0, 3)),
        ),
        Material::Feather => {
            let bars = wave(p.z * 14.0, footprint * 14.0);
            let tip = smooth(0.10, 0.26, p.x.abs());
            let base = Vec3::new(0.13, 0.12, 0.12).lerp(Vec3::new(0.52, 0.50, 0.47), v);
            MaterialSample { albedo: base * (1.0 + 0.5 * bars) * (1.0 - 0.5 * tip), gloss: 0.03, translucency: 0.2 }
        }
        Material::Rubber => {
            let panels = 6.0 / std::f32::consts::TAU;
            let (a, b) = (HUES[usize::from(variant % 8)], Vec3::new(0.75, 0.73, 0.68));
            // Panels, from the middle of the nearest one of colour `a`; their edges are as soft as a pixel is wide.
            let apart = ((p.x.atan2(p.y) * panels).rem_euclid(2.0) - 0.5).abs();
            let apart = apart.min(2.0 - apart);
            let soft = 1.5 * footprint * panels / p.x.hypot(p.y).max(1e-4);
            let base = a.lerp(b, smooth(0.5 - soft, 0.5 + soft, apart));
            MaterialSample { albedo: base * (1.0 + 0.4 * grain(11.0, 3)), gloss: 0.05, translucency: 0.0 }
        }
        Material::Glow => MaterialSample::matte(Vec3::splat(0.6)),
        Material::Water => MaterialSample { albedo: Vec3::new(0.030, 0.055, 0.060), gloss: 1.0, translucency: 0.0 },
        Material::Plaster => {
            let base = PLASTER[usize::from(variant % 4)];
            MaterialSample::matte(base * (1.0 + 0.22 * grain(0.9, 3) + 0.22 * grain(9.0, 3)))
        }
        Material::Boards => {
            let board = (p.x / 0.16).floor();
            let tone = lattice(board as i32, (p.z / 2.1 + board * 0.37).floor() as i32, 5, 17);
            let across = (p.x / 0.16).rem_euclid(1.0);
            let seam = smooth(0.0, 0.09 + footprint * 6.0, across.min(1.0 - across));
            let lines = fractal3(p * Vec3::new(40.0, 1.0, 3.0), 1.0, 3, footprint * 40.0, u32::from(variant));
            let base = Vec3::new(0.26, 0.15, 0.08).lerp(Vec3::new(0.40, 0.26, 0.14), tone);
            MaterialSample { albedo: base * (1.0 + 0.5 * lines) * (0.55 + 0.45 * seam), gloss: 0.06, translucency: 0.0 }
        }
        Material::Brick => {
            let along = if normal.x.abs() > normal.z.abs() { p.z } else { p.x };
            let row = (p.y / 0.16).floor();
            let at = along / 0.42 + 0.5 * row.rem_euclid(2.0);
            let soft = 0.03 + footprint * 2.5;
            let joint = |x: f32, width: f32| {
                let edge = (x.rem_euclid(1.0) - 0.5).abs() * 2.0;
                1.0 - smooth(1.0 - width - soft, 1.0 - width + soft, edge)
            };
            let stone = joint(at, 0.07) * joint(p.y / 0.16, 0.16);
            let tone =
                lattice(at.floor() as i32, row as i32, 3, u32::from(variant)) * (1.0 - footprint * 3.0).clamp(0.0, 1.0);
            let brick = BRICKS[usize::from(variant % 4)] * (0.75 + 0.5 * tone + 0.4 * grain(7.0, 3));
            MaterialSample::matte(Vec3::splat(0.32).lerp(brick, 0.25 + 0.75 * stone * (1.0 - soft).clamp(0.0, 1.0)))
        }
        Material::Tiles => {
            let squares = square_wave(p.x / 0.6, footprint / 0.6) * square_wave(p.z / 0.6, footprint / 0.6);
            let base = Vec3::new(0.20, 0.21, 0.23).lerp(Vec3::new(0.52, 0.49, 0.44), 0.5 + 0.5 * squares);
            MaterialSample { albedo: base * (1.0 + 0.35 * grain(3.0, 4)), gloss: 0.10, translucency: 0.0 }
        }
        Material::Asphalt => {
            let wet = smooth(-0.05, 0.25, fractal2(Vec2::new(p.x, p.z), 0.35, 3, footprint, 71));
            let base = Vec3::splat(0.11) * (1.0 + 0.6 * grain(12.0, 3) + 0.3 * grain(1.1, 2));
            MaterialSample { albedo: base * (1.0 - 0.45 * wet), gloss: 0.12 + 0.5 * wet, translucency: 0.0 }
        }
        Material::Paint => {
            let base = HUES[usize::from(variant % 8)];
            MaterialSample { albedo: base * (1.0 + 0.15 * grain(5.0, 3)), gloss: 0.2, translucency: 0.0 }
        }
    }
}

/// Colours of clothes, balls and paint.
const HUES: [Vec3; 8] = [
    Vec3::new(0.48, 0.09, 0.07),
    Vec3::new(0.10, 0.17, 0.42),
    Vec3::new(0.55, 0.40, 0.10),
    Vec3::new(0.12, 0.30, 0.16),
    Vec3::new(0.42, 0.40, 0.38),
    Vec3::new(0.14, 0.12, 0.13),
    Vec3::new(0.36, 0.20, 0.34),
    Vec3::new(0.50, 0.28, 0.16),
];

const PLASTER: [Vec3; 4] = [
    Vec3::new(0.62, 0.57, 0.48),
    Vec3::new(0.42, 0.50, 0.50),
    Vec3::new(0.58, 0.46, 0.36),
    Vec3::new(0.68, 0.67, 0.64),
];

const BRICKS: [Vec3; 4] = [
    Vec3::new(0.40, 0.17, 0.11),
    Vec3::new(0.34, 0.25, 0.18),
    Vec3::new(0.46, 0.36, 0.26),
    Vec3::new(0.28, 0.26, 0.27),
];

/// A sine with one period per unit, faded out where a pixel of `footprint` units no longer resolves it.
fn wave(x: f32, footprint: f32) -> f32 {
    (x * std::f32::consts::TAU).sin() * ((0.5 - footprint) * 4.0).clamp(0.0, 1.0)
}

/// 1 and -1 in turn on intervals of one unit, with edges as soft as a pixel of `footprint` units needs.
fn square_wave(x: f32, footprint: f32) -> f32 {
    let softness = std::f32::consts::PI * (0.02 + 1.5 * footprint);
    ((x * std::f32::consts::PI).sin() / softness).clamp(-1.0, 1.0) * ((0.6 - footprint) * 3.0).clamp(0.0, 1.0)
}

/// Light that a surface gives by itself, linear RGB, at `p` in the object's own frame.
pub(crate) fn emission(surface: TriangleMaterial, p: Vec3) -> Vec3 {
    if surface.material != Material::Glow {
        return Vec3::ZERO;
    }
    match surface.variant {
        // Daylight through a window.
        1 => Vec3::new(1.5, 1.7, 1.95),
        // A lit room behind curtains.
        2 => Vec3::new(1.15, 0.72, 0.30) * (0.75 + 0.25 * (p.x * 9.0 + p.z * 9.0).sin()),
        3 => Vec3::new(0.55, 0.66, 0.80) * (0.8 + 0.2 * (p.x * 7.0 + p.z * 7.0).sin()),
        // A lamp.
        _ => Vec3::new(4.2, 3.1, 1.7),
    }
}

fn rock(v: f32, coarse: f32, fine: f32) -> Vec3 {
    let base = Vec3::new(0.24, 0.235, 0.225).lerp(Vec3::new(0.33, 0.30, 0.26), v);
    let lichen = smooth(0.12, 0.3, coarse) * 0.5;
    (base * (1.0 + 0.7 * coarse + 0.5 * fine)).lerp(Vec3::new(0.24, 0.26, 0.14), lichen)
}

/// Bands of colour by height, wavy and uneven.
pub(crate) fn sandstone(p: Vec3, wave: f32) -> Vec3 {
    let level = p.y * 0.35 + wave * 1.6;
    let (band, within) = (level.floor(), level.fract());
    let shade = |k: f32| lattice(k as i32, 7, 3, 11);
    let tone = shade(band) + (shade(band + 1.0) - shade(band)) * smooth(0.75, 1.0, within);
    Vec3::new(0.42, 0.20, 0.11).lerp(Vec3::new(0.58, 0.36, 0.22), tone) * (1.0 + 0.4 * wave)
}

/// Smoothstep: 0 below `low`, 1 above `high`.
#[inline]
pub(crate) fn smooth(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
