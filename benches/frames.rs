//! What a generated frame and a resampled one cost, beside the plain average of two pictures: `cargo bench --bench
//! frames`.
//!
//! Every line is measured in the same run, its turns interleaved with the others', and the ratio of the medians is what
//! counts. Without `--bench`, as under `cargo test`, everything runs once at a tiny size and nothing is measured.

use std::hint::black_box;
use std::time::{Duration, Instant};

use cairn::Picture;
use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator};
use cairn::guidance::{DepthMap, Guidance, LatentView, MotionField, paper};
use cairn::present::upscale::{Filter, Upscaler};
use half::f16;
use rayon::prelude::*;

/// Turns of each line.
const TURNS: usize = 15;
/// The shape of a latent at 720p.
const LATENT: [usize; 3] = [32, 32, 64];

fn main() -> cairn::Result<()> {
    let is_measured = std::env::args().any(|arg| arg == "--bench");
    let (render, presented) = if is_measured { ((1280, 720), (1920, 1080)) } else { ((64, 36), (96, 54)) };
    let turns = if is_measured { TURNS } else { 1 };

    let scene = Scene::new(render)?;
    let (previous, current) = (&scene.previous, &scene.current);
    let pair = AnchorPair::new(previous, current, &scene.guidance)?;
    let anchor = Anchor::new(current, &scene.guidance)?;
    let latents: Vec<f32> = (0..2 * LATENT.iter().product::<usize>()).map(|i| (i as f32 * 0.37).sin()).collect();
    let (z0, z1) = latents.split_at(latents.len() / 2);
    let view = |values| LatentView::new(LATENT[0], LATENT[1], LATENT[2], values);
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");

    let mut lines: Vec<Line<'_>> = Vec::new();
    let mut out = current.clone();
    lines.push(Line::new("average of two pictures", move || {
        average(previous, current, &mut out);
        Ok(())
    }));
    let (mut generator, mut out) = (CpuGenerator::new(), current.clone());
    lines.push(Line::new("generate, t = 1/2", move || generator.generate(&pair, 0.5, &mut out).map(drop)));
    let (mut generator, mut out) = (CpuGenerator::new(), current.clone());
    lines.push(Line::new("generate, t = 1/2, one thread", move || {
        single.install(|| generator.generate(&pair, 0.5, &mut out)).map(drop)
    }));
    let (mut generator, mut out) = (CpuGenerator::new(), current.clone());
    lines.push(Line::new("extrapolate, t = 1/2", move || generator.extrapolate(&anchor, 0.5, &mut out).map(drop)));
    let (mut extractor, mut guidance) = (paper::Extractor::new(), scene.guidance.clone());
    lines.push(Line::new("motion and depth from latents", move || {
        extractor.extract(view(z0)?, view(z1)?, render, &mut guidance)
    }));
    for (name, filter) in [("upscale, Lanczos", Filter::Lanczos3), ("upscale, Catmull-Rom", Filter::CatmullRom)] {
        let mut upscaler = Upscaler::new(render, presented, filter)?;
        let mut out = Picture::new(presented.0, presented.1)?;
        lines.push(Line::new(name, move || upscaler.upscale(current, &mut out)));
    }

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
        println!("{render:?} -> {presented:?}, {} threads, median of {turns}", rayon::current_num_threads());
        let average = lines[0].median();
        for line in &mut lines {
            let median = line.median();
            println!("{:32} {:8.2} ms {:8.2} x", line.name, median * 1e3, median / average);
        }
    }
    Ok(())
}

/// Something to measure.
struct Line<'a> {
    name: &'static str,
    work: Box<dyn FnMut() -> cairn::Result<()> + 'a>,
    times: Vec<Duration>,
}

impl<'a> Line<'a> {
    fn new(name: &'static str, work: impl FnMut() -> cairn::Result<()> + 'a) -> Self {
        Self { name, work: Box::new(work), times: Vec::new() }
    }

    /// In seconds.
    fn median(&mut self) -> f64 {
        self.times.sort_unstable();
        self.times[self.times.len() / 2].as_secs_f64()
    }
}

/// The cheapest picture there is between two others.
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

/// Two anchors of a turn past a near pillar: every pixel moves, one surface uncovers another.
struct Scene {
    previous: Picture,
    current: Picture,
    guidance: Guidance,
}

impl Scene {
    fn new((width, height): (u32, u32)) -> cairn::Result<Self> {
        let (turn, pillar_turn) = (11.3, 23.7);
        let on_pillar = |x: f32, t: f32| {
            let left = width as f32 * 0.4 + pillar_turn * t;
            (left..left + width as f32 * 0.1).contains(&x)
        };
        let paint = |t: f32| -> cairn::Result<Picture> {
            let mut picture = Picture::new(width, height)?;
            picture.pixels_mut().par_iter_mut().enumerate().for_each(|(i, pixel)| {
                let (x, y) = ((i as u32 % width) as f32, (i as u32 / width) as f32);
                let x = if on_pillar(x, t) { x - pillar_turn * t + 3000.0 } else { x - turn * t };
                let wave = |a: f32, b: f32| 60.0 * ((x * a + y * b).sin() + (x * b * 0.7 - y * a).sin());
                let [r, g, b] = [wave(0.11, 0.05), wave(-0.06, 0.23), wave(0.31, -0.17)].map(|v| (127.0 + v) as u8);
                *pixel = [r, g, b, 255];
            });
            Ok(picture)
        };
        let (mut motion, mut depth) =
            (MotionField::new(width, height)?, DepthMap::new(width, height, paper::PROJECTION)?);
        for (i, vector) in motion.vectors_mut().iter_mut().enumerate() {
            let is_near = on_pillar((i as u32 % width) as f32, 1.0);
            *vector = [f16::from_f32(if is_near { -pillar_turn } else { -turn }), f16::ZERO];
            depth.depth_mut()[i] = if is_near { 0.3 } else { 0.95 };
        }
        Ok(Self { previous: paint(0.0)?, current: paint(1.0)?, guidance: Guidance::from_parts(motion, depth)? })
    }
}
