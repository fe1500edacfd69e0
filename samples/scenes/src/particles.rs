//! Alpha-blended particles: smoke, sparks, flakes and dust in the air, and the flash of a muzzle.
//!
//! They are composited over the finished picture, in order of distance. Depth and motion stay those of the surface behind, as engines give them.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use crate::camera::{NEAR, View};
use crate::light::tone_map;
use crate::noise::lattice;
use crate::render::Moment;

/// A source of particles. Every particle's place is a function of time and of its number alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Emitter {
    /// Smoke that rises from a point, and sparks in it.
    Fire { at: Vec3, seed: u32 },
    /// Particles everywhere around the viewer, which fall or float with the air.
    Air { kind: AirKind, count: u32, seed: u32 },
    /// The flash of a weapon held in view.
    Muzzle,
}

/// What is in the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum AirKind {
    /// Falling snow.
    Snow,
    /// Floating dust or pollen.
    Dust,
}

/// A particle at one time.
struct Particle {
    position: Vec3,
    /// In metres.
    radius: f32,
    /// Linear reflectance or, if it glows, linear light.
    colour: Vec3,
    glows: bool,
    /// Share of its colour in the middle, 0 to 1.
    alpha: f32,
}

/// Side in metres of the cube around the viewer in which particles in the air are drawn.
const AIR: f32 = 18.0;
/// Particles of a fire's smoke and of its sparks, and the seconds that one lasts.
const SMOKE: (u32, f32) = (42, 4.2);
const SPARKS: (u32, f32) = (26, 1.3);
/// Seconds between two bursts of a muzzle, times of the shots in one, and how long a flash lasts.
const BURST: f32 = 1.1;
const SHOTS: [f32; 2] = [0.25, 0.42];
const FLASH: f32 = 0.08;
/// Where the muzzle is in view: metres right, up and forward of the eye.
const MUZZLE: Vec3 = Vec3::new(0.16, -0.13, 0.75);

/// Strength of the muzzle's flash at `time` seconds, 0 to 1.
pub(crate) fn flash(time: f32) -> f32 {
    let within = time.rem_euclid(BURST);
    SHOTS.iter().map(|shot| (1.0 - (within - shot) / FLASH) * f32::from(u8::from(within >= *shot))).fold(
        0.0,
        |best, s| {
            if s > 0.0 && s <= 1.0 { s.max(best) } else { best }
        },
    )
}

/// Where the muzzle is in the world.
pub(crate) fn muzzle(view: &View) -> Vec3 {
    view.eye + view.to_world(MUZZLE)
}

impl Emitter {
    fn particles(&self, moment: &Moment, view: &View, out: &mut Vec<Particle>) {
        let time = moment.time;
        match *self {
            Self::Fire { at, seed } => {
                for n in 0..SMOKE.0 {
                    let random = |k: i32| lattice(n as i32, k, 1, seed);
                    let age = (time / SMOKE.1 + random(0)).fract();
                    let turn = TAU * (random(1) + 0.35 * age);
                    let spread = 0.12 + 0.55 * age * random(2);
                    let drift = Vec3::new(0.5 * age * age, 3.6 * age, 0.34 * age * age)
                        + Vec3::new(turn.cos(), 0.0, turn.sin()) * spread;
                    out.push(Particle {
                        position: at + drift,
                        radius: 0.14 + 0.75 * age,
                        colour: Vec3::splat(0.30 + 0.25 * random(3)),
                        glows: false,
                        alpha: 0.34 * (age * 8.0).min(1.0) * (1.0 - age).powf(1.3),
                    });
                }
                for n in 0..SPARKS.0 {
                    let random = |k: i32| lattice(n as i32, k, 2, seed);
                    let age = (time / SPARKS.1 + random(0)).fract();
                    let turn = TAU * random(1);
                    let out_by = age * (0.2 + 0.7 * random(2));
                    let up = 2.4 * age * (0.6 + 0.6 * random(3)) - 0.9 * age * age;
                    out.push(Particle {
                        position: at + Vec3::new(turn.cos() * out_by, up, turn.sin() * out_by),
                        radius: 0.018,
                        colour: Vec3::new(3.2, 1.0, 0.16),
                        glows: true,
                        alpha: (1.0 - age).sqrt(),
                    });
                }
            }
            Self::Air { kind, count, seed } => {
                let (fall, sway, radius, colour, alpha) = match kind {
                    AirKind::Snow => (Vec3::new(0.35, -1.15, 0.2), 0.25, 0.017, Vec3::splat(0.92), 0.85),
                    AirKind::Dust => (Vec3::new(0.16, -0.03, 0.1), 0.12, 0.011, Vec3::new(0.75, 0.68, 0.52), 0.5),
                };
                for n in 0..count {
                    let random = |k: i32| lattice(n as i32, k, 3, seed);
                    let phase = TAU * random(3);
                    let base = Vec3::new(random(0), random(1), random(2)) * AIR + fall * time;
                    let swing = Vec3::new(
                        (1.3 * time + phase).sin(),
                        0.3 * (1.9 * time + phase).sin(),
                        (1.1 * time + phase).cos(),
                    ) * sway;
                    // The nearest copy of an endless lattice of cubes; it fades out where copies change.
                    let offset = base + swing - view.eye;
                    let offset = offset - (offset / AIR).round() * AIR;
                    let border = (offset.abs().max_element() / (0.5 * AIR)).clamp(0.0, 1.0);
                    let size = radius * (0.6 + 0.8 * random(4));
                    out.push(Particle {
                        position: view.eye + offset,
                        radius: size,
                        colour,
                        glows: false,
                        alpha: alpha * (1.0 - border.powi(6)),
                    });
                }
            }
            Self::Muzzle => {
                let strength = flash(time);
                if strength > 0.0 {
                    for (ahead, radius, light) in [(0.0, 0.15, 2.2), (0.06, 0.08, 7.0), (0.14, 0.05, 5.0)] {
                        out.push(Particle {
                            position: view.eye + view.to_world(MUZZLE + Vec3::Z * ahead),
                            radius,
                            colour: Vec3::new(1.0, 0.72, 0.34) * light,
                            glows: true,
                            alpha: strength.sqrt(),
                        });
                    }
                }
            }
        }
    }
}

/// A particle in the picture.
struct Sprite {
    /// Middle and radius in pixels.
    centre: Vec2,
    radius: Vec2,
    /// Distance along the view axis, in metres.
    distance: f32,
    /// In metres.
    world_radius: f32,
    /// Linear display light.
    colour: Vec3,
    alpha: f32,
}

/// Rows of pixels that share a list.
const BAND: usize = 16;

/// The particles of a frame, far ones first, by bands of rows.
pub(crate) struct ParticleLayer {
    sprites: Vec<Sprite>,
    bands: Vec<Vec<u32>>,
}

impl ParticleLayer {
    /// Projects the particles of all emitters. `light` gives the light that falls on a point, linear RGB with exposure.
    pub(crate) fn new(
        emitters: &[Emitter],
        moment: &Moment,
        view: &View,
        height: u32,
        light: impl Fn(Vec3) -> Vec3,
    ) -> Self {
        let mut particles = Vec::new();
        for emitter in emitters {
            emitter.particles(moment, view, &mut particles);
        }
        let mut sprites: Vec<Sprite> = particles
            .into_iter()
            .filter_map(|p| {
                let at = view.to_view(p.position);
                if at.z < NEAR * 2.0 || p.alpha < 0.004 {
                    return None;
                }
                let exact = view.focal * p.radius / at.z;
                // A particle smaller than a pixel covers a part of it.
                let radius = exact.max(Vec2::splat(0.75));
                let share = exact.x * exact.y / (radius.x * radius.y);
                let light = if p.glows { p.colour } else { p.colour * light(p.position) };
                Some(Sprite {
                    centre: view.project(at),
                    radius,
                    distance: at.z,
                    world_radius: p.radius,
                    colour: tone_map(light),
                    alpha: p.alpha * share,
                })
            })
            .collect();
        sprites.sort_by(|a, b| b.distance.total_cmp(&a.distance));
        let mut bands = vec![Vec::new(); (height as usize).div_ceil(BAND)];
        for (n, s) in sprites.iter().enumerate() {
            let (low, high) = (s.centre.y - s.radius.y, s.centre.y + s.radius.y);
            if high >= 0.0 && low < height as f32 {
                let (first, last) = (low.max(0.0) as usize / BAND, high.min(height as f32 - 1.0) as usize / BAND);
                bands[first..=last].iter_mut().for_each(|band| band.push(n as u32));
            }
        }
        Self { sprites, bands }
    }

    /// Composites the particles in front of `distance` metres over `light`, linear display light, at a pixel's centre. Returns the light and the
    /// particles' share in it.
    pub(crate) fn over(&self, light: Vec3, at: Vec2, distance: f32) -> (Vec3, f32) {
        let (mut light, mut transmittance) = (light, 1.0_f32);
        for &n in &self.bands[at.y as usize / BAND] {
            let s = &self.sprites[n as usize];
            let off = ((at - s.centre) / s.radius).length_squared();
            if off >= 1.0 {
                continue;
            }
            // Soft particle: fades out where it intersects a surface.
            let front = ((distance - s.distance) / (s.world_radius + 1e-3) * 0.5 + 0.5).clamp(0.0, 1.0);
            let share = s.alpha * (1.0 - off).powi(2) * front;
            light = light.lerp(s.colour, share);
            transmittance *= 1.0 - share;
        }
        (light, 1.0 - transmittance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_muzzle_flashes_at_its_shots_and_is_dark_between() {
        assert_eq!([0.0, 0.2, 0.34, 0.6, 1.0].map(flash), [0.0; 5]);
        assert!(flash(0.26) > 0.8 && flash(0.43) > 0.8 && flash(BURST + 0.29) > 0.4);
        assert!((0..2000).all(|n| (0.0..=1.0).contains(&flash(n as f32 * 0.003))));
    }
}
