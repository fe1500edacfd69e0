//! Effects of renderers and cameras on pictures: temporal anti-aliasing, motion blur and film grain. Depth and motion stay those of the frame.

use std::sync::LazyLock;

use cairn::Picture;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::light::srgb;
use crate::noise::lattice;
use crate::render::{Frame, Moment, Quality, render};
use crate::scene::Scene;

/// Effects on the pictures of a clip, in the order in which they are applied: blur, temporal anti-aliasing, grain.
///
/// Every frame of a clip gets them, so a frame between two others is what the same camera would have shown there.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FilmOptions {
    /// Motion blur, if any.
    pub blur: Option<MotionBlur>,
    /// Frames of history of temporal anti-aliasing, as of [`TemporalAntiAliasing::new`], if it is on.
    pub anti_aliasing: Option<u32>,
    /// Film grain, if any.
    pub grain: Option<FilmGrain>,
}

/// Linear display light of every 8-bit sRGB code value.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let x = code as f32 / 255.0;
        if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    })
});

fn linear(pixel: [u8; 4]) -> Vec3 {
    let [r, g, b, _] = pixel.map(|code| LINEAR[usize::from(code)]);
    Vec3::new(r, g, b)
}

/// Motion blur as the mean of sub-frames while the shutter is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionBlur {
    /// How long the shutter is open, in seconds of world time; it closes at the frame's time.
    pub exposure: f64,
    /// Pictures that are averaged, at the middles of equal parts of the exposure; 2 or more.
    pub subframes: u32,
}

impl MotionBlur {
    /// A shutter that is open for `angle` of 360 degrees of the time between two frames at `rate` frames per second.
    pub fn shutter(angle: f64, rate: u32, subframes: u32) -> Self {
        Self { exposure: angle / 360.0 / f64::from(rate), subframes }
    }

    /// Times of the sub-frames before the frame's time, in seconds, the earliest first.
    pub fn offsets(&self) -> impl Iterator<Item = f64> {
        let (exposure, count) = (self.exposure, self.subframes);
        (0..count).map(move |k| -exposure * (1.0 - (f64::from(k) + 0.5) / f64::from(count)))
    }
}

/// Renders `scene` at each of `moments` and averages the pictures in linear display light.
pub fn mean_picture(scene: &Scene, moments: &[Moment], width: u32, height: u32, quality: Quality) -> Picture {
    let mut sum = vec![Vec3::ZERO; width as usize * height as usize];
    for moment in moments {
        let picture = render(scene, moment, moment, width, height, quality).picture;
        sum.par_iter_mut().zip(picture.pixels()).for_each(|(sum, pixel)| *sum += linear(*pixel));
    }
    let scale = 1.0 / moments.len().max(1) as f32;
    encode(width, height, sum.par_iter().map(|light| srgb(*light * scale)).collect())
}

fn encode(width: u32, height: u32, pixels: Vec<[u8; 4]>) -> Picture {
    Picture::from_rgba(width, height, pixels.into_flattened()).expect("the buffer has the size of a frame")
}

/// Camera jitter of frame `number`: point `number % phases` of the Halton sequence of bases 2 and 3, within half a pixel of the pixel's centre.
///
/// AMD's FSR takes `8 * (display height / render height)^2` phases, thus 8 at display size.
pub fn halton_jitter(number: u64, phases: u32) -> Vec2 {
    let radical_inverse = |base: u64| {
        // The sequence begins at 1, because point 0 of every base is 0.
        let (mut index, mut part, mut value) = (number % u64::from(phases.max(1)) + 1, 1.0_f64, 0.0);
        while index > 0 {
            part /= base as f64;
            value += part * (index % base) as f64;
            index /= base;
        }
        value as f32 - 0.5
    };
    Vec2::new(radical_inverse(2), radical_inverse(3))
}

/// Temporal anti-aliasing of one shot: jittered frames are accumulated along their exact motion.
///
/// Each pixel follows the motion of the nearest depth among its 3 x 3 neighbours without the jitter, samples the history there with a Catmull-Rom
/// filter, clamps it to the range of colours of its 3 x 3 neighbours in YCoCg, and mixes in the new sample: the mean of all frames so far, then an
/// exponential mean. This is the scheme of Karis, "High-Quality Temporal Supersampling" (SIGGRAPH 2014). Works in linear display light.
#[derive(Debug)]
pub struct TemporalAntiAliasing {
    /// Frames after which the mean becomes an exponential one.
    frames: f32,
    size: (u32, u32),
    history: Vec<Vec3>,
    /// Frames in each pixel's mean.
    age: Vec<f32>,
}

impl TemporalAntiAliasing {
    /// Without history. A new frame counts at least `1 / frames`; engines use 8 to 20.
    pub fn new(frames: u32) -> Self {
        Self { frames: frames.max(1) as f32, size: (0, 0), history: Vec::new(), age: Vec::new() }
    }

    /// Accumulates the next frame, rendered at `now` with motion to `before`. History is dropped at a cut and at a change of size.
    pub fn resolve(&mut self, frame: &Frame, now: &Moment, before: &Moment) -> Picture {
        let size = frame.picture.size();
        let current: Vec<Vec3> = frame.picture.pixels().iter().map(|pixel| linear(*pixel)).collect();
        if self.size != size || now.shot != before.shot {
            self.size = size;
            self.age.clear();
        }
        if self.age.is_empty() {
            self.age = vec![1.0; current.len()];
            self.history = current;
            return frame.picture.clone();
        }
        let jitter = before.jitter - now.jitter;
        let (w, h) = (size.0 as usize, size.1 as usize);
        let resolved: Vec<(Vec3, f32)> = (0..w * h)
            .into_par_iter()
            .map(|k| {
                let (x, y) = (k % w, k / w);
                let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
                let mut nearest = k;
                for j in y.saturating_sub(1)..(y + 2).min(h) {
                    for i in x.saturating_sub(1)..(x + 2).min(w) {
                        let n = j * w + i;
                        let colour = to_ycocg(current[n]);
                        (low, high) = (low.min(colour), high.max(colour));
                        if frame.depth[n] < frame.depth[nearest] {
                            nearest = n;
                        }
                    }
                }
                let was = Vec2::new(x as f32, y as f32) + 0.5 + frame.motion[nearest] - jitter;
                let inside =
                    was.is_finite() && was.min_element() >= 0.0 && was.x < size.0 as f32 && was.y < size.1 as f32;
                if !inside {
                    return (current[k], 1.0);
                }
                let age = self.age[was.y as usize * w + was.x as usize].min(self.frames - 1.0) + 1.0;
                let history = from_ycocg(to_ycocg(self.sample(was)).clamp(low, high));
                (history + (current[k] - history) / age, age)
            })
            .collect();
        (self.history, self.age) = resolved.into_iter().unzip();
        encode(size.0, size.1, self.history.par_iter().map(|light| srgb(*light)).collect())
    }

    /// Catmull-Rom sample of the history at a pixel position.
    fn sample(&self, at: Vec2) -> Vec3 {
        let at = at - 0.5;
        let low = at.floor();
        let weights = |t: f32| {
            let (t2, t3) = (t * t, t * t * t);
            [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, -0.5 * t2 + 0.5 * t3]
        };
        let (wx, wy) = (weights(at.x - low.x), weights(at.y - low.y));
        let mut sum = Vec3::ZERO;
        for (j, wy) in wy.into_iter().enumerate() {
            let y = (low.y as i32 + j as i32 - 1).clamp(0, self.size.1 as i32 - 1) as usize;
            for (i, wx) in wx.into_iter().enumerate() {
                let x = (low.x as i32 + i as i32 - 1).clamp(0, self.size.0 as i32 - 1) as usize;
                sum += self.history[y * self.size.0 as usize + x] * (wx * wy);
            }
        }
        sum
    }
}

fn to_ycocg(c: Vec3) -> Vec3 {
    Vec3::new(0.25 * c.x + 0.5 * c.y + 0.25 * c.z, 0.5 * (c.x - c.z), 0.5 * c.y - 0.25 * (c.x + c.z))
}

fn from_ycocg(c: Vec3) -> Vec3 {
    Vec3::new(c.x + c.y - c.z, c.x + c.z, c.x - c.y - c.z)
}

/// Monochrome Gaussian noise, independent from pixel to pixel and from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilmGrain {
    /// Standard deviation in 8-bit code values.
    pub deviation: f32,
    /// Frames of the same number and seed get the same noise.
    pub seed: u64,
}

impl FilmGrain {
    /// Adds the noise of frame `number` to `picture`. Code values are clamped to 0 to 255.
    pub fn apply(&self, picture: &mut Picture, number: u64) {
        let width = picture.width() as usize;
        let seed = (self.seed ^ (self.seed >> 32)) as u32;
        picture.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let uniform = |k: i32| lattice(x as i32, y as i32, (number as i32).wrapping_mul(2) + k, seed);
                // Box and Muller's transform of two uniform numbers.
                let radius = (-2.0 * (1.0 - uniform(0)).ln()).sqrt();
                let noise = radius * (std::f32::consts::TAU * uniform(1)).cos() * self.deviation;
                for code in &mut pixel[..3] {
                    *code = (f32::from(*code) + noise + 0.5).clamp(0.0, 255.0) as u8;
                }
            }
        });
    }
}
