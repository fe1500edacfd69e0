//! Materials: reflectance of a surface point before lighting.

use glam::{Vec2, Vec3};

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
