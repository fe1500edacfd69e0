//! The cost of a generated and of a resampled frame, relative to the plain average of two pictures: `cargo bench --bench
//! frames`.
//!
//! All lines are measured in the same run, in interleaved turns, and the result is the ratio of the medians. All use two threads, whatever
//! the machine has, except for the lines that say one. The goals are 8 averages for a frame with motion by tiles,
//! 24 with motion by pixels, and a factor of 1.7 from a second thread. Arguments select the lines whose names contain one of them; the
//! average always runs. Without `--bench`, as under `cargo test`, everything runs once at a tiny size and nothing is measured.

use std::hint::black_box;
use std::time::{Duration, Instant};

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator};
use cairn::guidance::{DepthMap, Guidance, LatentView, MotionField, MotionOrigin, paper};
use cairn::present::upscale::{Filter, Upscaler};
use cairn::tasks::Pool;
use cairn::{Picture, PictureF16};
use half::f16;
use rayon::prelude::*;

/// Turns of each line.
const TURNS: usize = 31;
/// The shape of a latent at 720p.
const LATENT: [usize; 3] = [32, 32, 64];

fn main() -> cairn::Result<()> {
    let is_measured = std::env::args().any(|arg| arg == "--bench");
    let (render, presented) = if is_measured { ((1280, 720), (1920, 1080)) } else { ((64, 36), (96, 54)) };
    let turns = if is_measured { TURNS } else { 1 };
    let (one, two) = (&Pool::new(1)?, &Pool::new(2)?);
    let averaging = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads can be started");

    let turn = Scene::new(presented, Shape { step: 0.0, pillars: 1 })?;
    let walk = Scene::new(presented, Shape { step: 0.04, pillars: 12 })?;
    let leap = Scene::new(presented, Shape { step: 0.12, pillars: 12 })?;
    let (tiles_of_8, tiles_of_16) = (turn.guidance_in(8)?, turn.guidance_in(16)?);
    let (previous, current) = (&turn.previous, &turn.current);
    let small = &Scene::new(render, turn.shape)?.current;
    let latents: Vec<f32> = (0..2 * LATENT.iter().product::<usize>()).map(|i| (i as f32 * 0.37).sin()).collect();
    let (z0, z1) = latents.split_at(latents.len() / 2);
    let view = |values| LatentView::new(LATENT[0], LATENT[1], LATENT[2], values);

    let halves = [halves(previous)?, halves(current)?];

    let mut lines: Vec<Line<'_>> = Vec::new();
    let mut out = current.clone();
    lines.push(Line::new("average of two pictures", move || {
        averaging.install(|| average(previous, current, &mut out));
        Ok(())
    }));
    for (name, pair) in [
        ("tiles of 16", AnchorPair::new(previous, current, &tiles_of_16)?),
        ("tiles of 8", AnchorPair::new(previous, current, &tiles_of_8)?),
        ("per pixel", AnchorPair::new(previous, current, &turn.guidance)?),
        ("per pixel, many edges", AnchorPair::new(&walk.previous, &walk.current, &walk.guidance)?),
        ("per pixel, no smooth tile", AnchorPair::new(&leap.previous, &leap.current, &leap.guidance)?),
    ] {
        for (threads, pool) in [("", two), (", one thread", one)] {
            let (mut generator, mut out) = (CpuGenerator::new(), current.clone());
            lines.push(Line::new(format!("generate, {name}{threads}"), move || {
                pool.install(|| generator.generate(&pair, 0.5, &mut out)).map(drop)
            }));
        }
    }
    for (name, guidance) in [("tiles of 16", &tiles_of_16), ("per pixel", &turn.guidance)] {
        let anchor = Anchor::new(current, guidance)?;
        let (mut generator, mut out) = (CpuGenerator::new(), current.clone());
        lines.push(Line::new(format!("extrapolate, {name}"), move || {
            two.install(|| generator.extrapolate(&anchor, 0.5, &mut out)).map(drop)
        }));
    }
    for (name, guidance) in [("tiles of 16", &tiles_of_16), ("per pixel", &turn.guidance)] {
        let pair = AnchorPair::new(&halves[0], &halves[1], guidance)?;
        let (mut generator, mut out) = (CpuGenerator::new(), halves[0].clone());
        lines.push(Line::new(format!("generate half floats, {name}"), move || {
            two.install(|| generator.generate(&pair, 0.5, &mut out)).map(drop)
        }));
    }
    let (mut extractor, mut guidance) =
        (paper::Extractor::new(), Guidance::new(render.0, render.1, paper::PROJECTION)?);
    lines.push(Line::new("motion and depth from latents", move || {
        two.install(|| extractor.extract(view(z0)?, view(z1)?, render, &mut guidance))
    }));
    for (name, filter) in [("upscale, Lanczos", Filter::Lanczos3), ("upscale, Catmull-Rom", Filter::CatmullRom)] {
        let mut upscaler = Upscaler::new(render, presented, filter)?;
        let mut out = Picture::new(presented.0, presented.1)?;
        lines.push(Line::new(name, move || two.install(|| upscaler.upscale(small, &mut out))));
    }

    let picked: Vec<_> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let is_picked = |name: &str| picked.is_empty() || picked.iter().any(|part| name.contains(part.as_str()));
    lines.retain(|line| line.name.starts_with("average") || is_picked(&line.name));

    for turn in 0..=turns {
        for line in &mut lines {
            let start = Instant::now();
            (line.work)()?;
            // The first turn warms up.
            if turn > 0 {
                line.times.push(start.elapsed());
            }
        }
    }
    if is_measured {
        println!("{render:?} -> {presented:?}, median of {turns}");
        let average = lines[0].median();
        let mut before = average;
        for line in &mut lines {
            let median = line.median();
            let second = if line.name.ends_with("one thread") {
                format!(", {:.2} times that of two", median / before)
            } else {
                String::new()
            };
            println!("{:40} {:8.2} ms {:8.2} x{second}", line.name, median * 1e3, median / average);
            before = median;
        }
    }
    Ok(())
}

/// A measurement.
struct Line<'a> {
    name: String,
    work: Box<dyn FnMut() -> cairn::Result<()> + 'a>,
    times: Vec<Duration>,
}

impl<'a> Line<'a> {
    fn new(name: impl Into<String>, work: impl FnMut() -> cairn::Result<()> + 'a) -> Self {
        Self { name: name.into(), work: Box::new(work), times: Vec::new() }
    }

    /// In seconds.
    fn median(&mut self) -> f64 {
        self.times.sort_unstable();
        self.times[self.times.len() / 2].as_secs_f64()
    }
}

/// The per-value average of two pictures: the cheapest frame between them.
fn average(previous: &Picture, current: &Picture, out: &mut Picture) {
    let (previous, current) = (previous.rgba(), current.rgba());
    out.rgba_mut().par_chunks_mut(1 << 16).enumerate().for_each(|(i, out)| {
        let (a, b) = (&previous[i << 16..], &current[i << 16..]);
        for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
            *out = (u16::from(a) + u16::from(b)).div_ceil(2) as u8;
        }
    });
    black_box(out);
}

/// The same picture in half floats.
fn halves(picture: &Picture) -> cairn::Result<PictureF16> {
    let mut halves = PictureF16::new(picture.width(), picture.height())?;
    for (half, pixel) in halves.pixels_mut().iter_mut().zip(picture.pixels()) {
        *half = pixel.map(|v| f16::from_f32(f32::from(v) / 255.0));
    }
    Ok(halves)
}

/// Two anchors of a turn past near pillars, optionally with a step forward: every pixel moves, and there are occlusions and
/// disocclusions.
struct Scene {
    previous: Picture,
    current: Picture,
    guidance: Guidance,
    shape: Shape,
}

#[derive(Clone, Copy)]
struct Shape {
    /// Relative growth of the picture by the step forward.
    step: f32,
    /// Number of pillars. Together they cover a tenth of the width, or a little more.
    pillars: u32,
}

/// Motion of the ground and the pillars, in pixels.
const TURN: f32 = 11.3;
const PILLAR_TURN: f32 = 23.7;

impl Shape {
    fn is_pillar(self, x: f32, width: u32, t: f32) -> bool {
        let spacing = width as f32 / self.pillars as f32;
        (x - PILLAR_TURN * t - 0.4 * spacing).rem_euclid(spacing) < 0.1 * spacing
    }

    /// Maps a ground position at time `t` to its position at time 0.
    fn moved(self, [x, y]: [f32; 2], (width, height): (u32, u32), t: f32) -> [f32; 2] {
        let shrink = 1.0 / (1.0 + self.step * t) - 1.0;
        [(x - width as f32 / 2.0) * shrink - TURN * t, (y - height as f32 / 2.0) * shrink]
    }

    fn painted(self, size: (u32, u32), t: f32) -> cairn::Result<Picture> {
        let mut picture = Picture::new(size.0, size.1)?;
        picture.pixels_mut().par_iter_mut().enumerate().for_each(|(i, pixel)| {
            let [x, y] = [i as u32 % size.0, i as u32 / size.0].map(|v| v as f32);
            let [x, y] = if self.is_pillar(x, size.0, t) {
                [x - PILLAR_TURN * t + 3000.0, y]
            } else {
                let [dx, dy] = self.moved([x, y], size, t);
                [x + dx, y + dy]
            };
            let wave = |a: f32, b: f32| 60.0 * ((x * a + y * b).sin() + (x * b * 0.7 - y * a).sin());
            let [r, g, b] = [wave(0.11, 0.05), wave(-0.06, 0.23), wave(0.31, -0.17)].map(|v| (127.0 + v) as u8);
            *pixel = [r, g, b, 255];
        });
        Ok(picture)
    }

    /// The true motion and depth, per pixel or at the centre of each tile.
    fn guidance(self, (width, height): (u32, u32), tile: u32) -> cairn::Result<Guidance> {
        let (mut motion, mut depth) =
            (MotionField::tiled(width, height, tile)?, DepthMap::tiled(width, height, tile, paper::PROJECTION)?);
        let columns = motion.columns();
        for (i, (vector, depth)) in motion.vectors_mut().iter_mut().zip(depth.depth_mut()).enumerate() {
            let at = [i as u32 % columns, i as u32 / columns].map(|v| (v * tile + tile / 2) as f32);
            let is_near = self.is_pillar(at[0], width, 1.0);
            let ground = self.moved(at, (width, height), 1.0);
            *vector = if is_near { [-PILLAR_TURN, 0.0] } else { ground }.map(f16::from_f32);
            *depth = if is_near { 0.3 } else { 0.95 };
        }
        Guidance::from_parts(motion, depth, MotionOrigin::Geometry)
    }
}

impl Scene {
    fn new(size: (u32, u32), shape: Shape) -> cairn::Result<Self> {
        let (previous, current) = (shape.painted(size, 0.0)?, shape.painted(size, 1.0)?);
        Ok(Self { previous, current, guidance: shape.guidance(size, 1)?, shape })
    }

    fn guidance_in(&self, tile: u32) -> cairn::Result<Guidance> {
        self.shape.guidance(self.current.size(), tile)
    }
}
