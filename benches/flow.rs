//! The cost of optical flow between two pictures, relative to their plain average: `cargo bench --bench flow`.
//!
//! All lines are measured in the same run, in interleaved turns, and the result is the ratio of the shortest times.
//! Without `--bench`, as under `cargo test`, everything runs once at a tiny size and nothing is measured.

use std::hint::black_box;
use std::time::{Duration, Instant};

use cairn::guidance::Guidance;
use cairn::guidance::picture_flow::{self, Extractor, StageTimes};
use cairn::tasks::Pool;
use cairn::{Picture, Result};
use rayon::prelude::*;

/// Turns of each line.
const TURNS: usize = 15;

fn main() -> Result<()> {
    let is_measured = std::env::args().any(|arg| arg == "--bench");
    let (width, height) = if is_measured { (1920, 1080) } else { (64, 36) };
    let turns = if is_measured { TURNS } else { 1 };
    let (previous, current) = (view(width, height, 0.0)?, view(width, height, 1.0)?);
    let averaging = [1, 2].map(|threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("two threads can be started")
    });
    let extracting = [Pool::new(1)?, Pool::new(2)?];

    let mut lines = Vec::new();
    for ((averaging, extracting), threads) in averaging.iter().zip(&extracting).zip([1, 2]) {
        let mut out = current.clone();
        let (previous, current) = (&previous, &current);
        lines.push(Line::new("average of two pictures", threads, move || {
            averaging.install(|| average(previous, current, &mut out));
            Ok(StageTimes::default())
        }));
        let mut guidance = Guidance::new(width, height, picture_flow::PROJECTION)?;
        let mut extractor = Extractor::new();
        lines.push(Line::new("extract", threads, move || {
            extracting.install(|| extractor.extract(previous, current, &mut guidance))?;
            Ok(extractor.stage_times())
        }));
    }
    for turn in 0..=turns {
        for line in &mut lines {
            let start = Instant::now();
            let stages = (line.work)()?;
            // The first turn warms up.
            if turn > 0 {
                line.times.push((start.elapsed(), stages));
            }
        }
    }
    if is_measured {
        println!("{width} x {height}, least of {turns}");
        let half = lines.len() / 2;
        for (i, line) in lines.iter().enumerate() {
            let average = lines[i / half * half].shortest().0.as_secs_f64();
            let (time, stages) = line.shortest();
            let time = time.as_secs_f64();
            let name =
                format!("{}, {} {}", line.name, line.threads, if line.threads == 1 { "thread" } else { "threads" });
            print!("{name:36} {:8.2} ms {:8.2} x the average", time * 1e3, time / average);
            if i >= half {
                let single = lines[i - half].shortest().0.as_secs_f64();
                print!(", {:.2} x as fast as on one thread", single / time);
            }
            println!();
            if stages != StageTimes::default() {
                println!("    {stages:.1?}");
            }
        }
    }
    Ok(())
}

/// A measurement.
struct Line<'a> {
    name: &'static str,
    threads: usize,
    work: Box<dyn FnMut() -> Result<StageTimes> + 'a>,
    times: Vec<(Duration, StageTimes)>,
}

impl<'a> Line<'a> {
    fn new(name: &'static str, threads: usize, work: impl FnMut() -> Result<StageTimes> + 'a) -> Self {
        Self { name, threads, work: Box::new(work), times: Vec::new() }
    }

    fn shortest(&self) -> (Duration, StageTimes) {
        *self.times.iter().min_by_key(|(time, _)| *time).expect("every line has turns")
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

/// Draws the view at anchor `t` of a walk past a row of posts: textured ground that grows and turns, and near objects in front of it that move twice as
/// fast, so that there are motion edges and disocclusions.
fn view(width: u32, height: u32, t: f32) -> Result<Picture> {
    let mut picture = Picture::new(width, height)?;
    let post = |x: f32| (x - 26.0 * t).rem_euclid(240.0) < 40.0;
    picture.pixels_mut().par_iter_mut().enumerate().for_each(|(i, pixel)| {
        let (x, y) = ((i as u32 % width) as f32, (i as u32 / width) as f32);
        let (x, y) = if post(x) { (x - 26.0 * t + 5000.0, y) } else { (x * (1.0 - 0.01 * t) - 9.0 * t, y - 2.0 * t) };
        let level = 0.55 * noise(x / 3.0, y / 3.0) + 0.45 * noise(x / 17.0, y / 17.0);
        let [r, g, b] = [200.0, 230.0, 150.0].map(|most| (most * level) as u8);
        *pixel = [r, g, b, 255];
    });
    Ok(picture)
}

/// Value noise in 0..=1 with a cell of 1.
fn noise(x: f32, y: f32) -> f32 {
    let (left, top) = (x.floor(), y.floor());
    let at = |dx: f32, dy: f32| {
        let key = ((left + dx) as i32 as u32).wrapping_mul(0x9e37_79b9)
            ^ ((top + dy) as i32 as u32).wrapping_mul(0x85eb_ca6b);
        let key = (key ^ (key >> 15)).wrapping_mul(0x2c1b_3c6d);
        ((key ^ (key >> 13)) & 0xffff) as f32 / 65535.0
    };
    let smooth = |f: f32| f * f * (3.0 - 2.0 * f);
    let (fx, fy) = (smooth(x - left), smooth(y - top));
    let above = at(0.0, 0.0) + (at(1.0, 0.0) - at(0.0, 0.0)) * fx;
    let below = at(0.0, 1.0) + (at(1.0, 1.0) - at(0.0, 1.0)) * fx;
    above + (below - above) * fy
}
