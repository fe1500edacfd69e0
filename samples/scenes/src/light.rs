//! Light, atmosphere and sky: from a surface's material to the light that reaches the eye.

use std::sync::LazyLock;

use glam::{Vec2, Vec3};

use crate::family::Weather;
use crate::material::{MaterialSample, smooth};
use crate::noise::fractal2;

/// A surface point to be shaded.
pub struct SurfacePoint {
    /// Material properties.
    pub material: MaterialSample,
    /// Unit normal on the eye's side.
    pub normal: Vec3,
    /// Unit direction from the eye to the point.
    pub towards: Vec3,
    /// Metres from the eye.
    pub distance: f32,
    /// Sun visibility, 0 to 1.
    pub sun: f32,
    /// Diffuse light of lamps that arrives, linear RGB.
    pub lamps: Vec3,
    /// Mirrored light of lamps, before the material's gloss, linear RGB.
    pub glints: Vec3,
    /// Light that the surface gives by itself, linear RGB.
    pub emission: Vec3,
}

impl Weather {
    /// Light from a surface point through the atmosphere to the eye, linear RGB.
    pub fn shade(&self, p: &SurfacePoint) -> Vec3 {
        let facing = p.normal.dot(self.sun);
        let direct = self.sun_light * facing.max(0.0) * p.sun;
        let through = self.sun_light * (-facing).max(0.0) * p.sun * p.material.translucency;
        let up = p.normal.y * 0.5 + 0.5;
        let ambient = self.sky_light * up + self.ground_light * (1.0 - up);
        let mut light = p.material.albedo * (direct + through + ambient + p.lamps) + p.emission;
        if p.material.gloss > 0.0 {
            let mirror = p.towards - p.normal * (2.0 * p.towards.dot(p.normal));
            let spark = mirror.dot(self.sun).max(0.0).powi(48) * p.sun;
            let rim = 0.2 + 0.8 * (1.0 + p.towards.dot(p.normal)).clamp(0.0, 1.0).powi(4);
            light +=
                (self.gradient(mirror) * 0.8 * rim + self.sun_light * spark * 2.0 + p.glints) * p.material.gloss * 0.6;
        }
        let left = (-self.fog * p.distance).exp();
        light * left + self.air(p.towards) * (1.0 - left)
    }

    /// Light of the sky in a unit direction, without clouds.
    fn gradient(&self, d: Vec3) -> Vec3 {
        let t = smooth(-0.05, 0.55, d.y);
        self.horizon.lerp(self.zenith, t.sqrt())
    }

    /// Light that fog scatters towards the eye from a unit direction.
    fn air(&self, d: Vec3) -> Vec3 {
        let glow = (0.5 + 0.5 * d.dot(self.sun)).powi(8);
        self.horizon + self.sun_light * (0.10 * glow)
    }

    /// Light of the sky in a unit direction, with clouds and the sun; a pixel covers `footprint` radians.
    pub fn sky(&self, d: Vec3, footprint: f32) -> Vec3 {
        let mut light = self.gradient(d);
        let glow = d.dot(self.sun).max(0.0);
        light += self.sun_light * (0.10 * glow.powi(8) + 0.22 * glow.powi(90));
        if d.y > 0.0 {
            let along = Vec2::new(d.x, d.z) / (d.y + 0.14);
            let spread = footprint / (d.y + 0.14);
            let body = fractal2(along, 0.9, 5, spread, 41) + 0.25 * fractal2(along, 3.1, 3, spread, 43);
            let cover = smooth(0.28 - 0.5 * self.clouds, 0.62 - 0.4 * self.clouds, body + 0.12);
            let towards_sun = fractal2(along + Vec2::new(self.sun.x, self.sun.z) * 0.12, 0.9, 4, spread, 41);
            let bright = (0.75 + 0.9 * (body - towards_sun)).clamp(0.45, 1.15);
            let cloud = (self.sun_light * 0.24 + self.sky_light * 0.55) * bright;
            light = light.lerp(cloud, cover * smooth(0.02, 0.22, d.y) * 0.92);
        }
        let disc = smooth(0.99955, 0.99985, d.dot(self.sun));
        light += self.sun_light * (2.0 * disc);
        let haze = 1.0 - smooth(-0.02, 0.12 + self.fog * 6.0, d.y);
        light.lerp(self.air(d), haze)
    }
}

/// Filmic curve: linear scene light to linear display light, 0 to 1 (Narkowicz's fit of the ACES reference transform).
#[inline]
pub(crate) fn tone_map(x: Vec3) -> Vec3 {
    let x = x.max(Vec3::ZERO) * 0.6;
    ((x * (x * 2.51 + 0.03)) / (x * (x * 2.43 + 0.59) + 0.14)).clamp(Vec3::ZERO, Vec3::ONE)
}

const STEPS: usize = 8192;

static SRGB: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..=STEPS)
        .map(|k| {
            let x = k as f32 / STEPS as f32;
            255.0 * if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
        })
        .collect()
});

/// Linear display light to 8-bit sRGB, opaque.
#[inline]
pub(crate) fn srgb(light: Vec3) -> [u8; 4] {
    let code = |x: f32| {
        let at = x.clamp(0.0, 1.0) * STEPS as f32;
        let k = (at as usize).min(STEPS - 1);
        let (a, b) = (SRGB[k], SRGB[k + 1]);
        (a + (b - a) * (at - k as f32) + 0.5) as u8
    };
    [code(light.x), code(light.y), code(light.z), 255]
}
