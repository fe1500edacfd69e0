//! The cost of the `cpu` generator's inner loops at each instruction set, relative to the plain average of two pictures:
//! `cargo bench --bench kernels`, or `cargo bench --bench kernels -- WORD` for the lines whose names contain that word.
//!
//! Each line processes a whole picture. All are measured in the same run, in interleaved turns, and the result is the ratio of the
//! shortest times. Without `--bench`, as under `cargo test`, everything runs once at a
//! tiny size and nothing is measured.

use std::hint::black_box;
use std::time::{Duration, Instant};

use cairn::framegen::cpu::kernels::{
    BLOCK, Block, DepthKeyRange, MergeRule, Positions, Sampled, SimdLevel, Source, TILE, TileSource, VectorRange,
    depth_ranges, motion_ranges,
};
use half::f16;
use rayon::prelude::*;

/// Turns of each line.
const TURNS: usize = 15;
/// Displacement of a tile in the previous anchor, in 1/64 px, between pixel centres; the current anchor's is its negative.
const DISPLACEMENT: [i32; 2] = [345, -83];

fn main() {
    let is_measured = std::env::args().any(|arg| arg == "--bench");
    let (width, height) = if is_measured { (1920, 1080) } else { (67, 29) };
    let turns = if is_measured { TURNS } else { 1 };

    let bytes = |seed: usize| -> Vec<[u8; 4]> {
        let level = |i: usize, c: usize| (127.0 + 60.0 * ((i * (c + 3) + seed) as f32 * 0.013).sin()) as u8;
        (0..width * height).map(|i| [level(i, 0), level(i, 1), level(i, 2), 255]).collect()
    };
    let (previous, current) = (bytes(0), bytes(2));
    let halves = |bytes: &[[u8; 4]]| -> Vec<[f16; 4]> {
        bytes.iter().map(|pixel| pixel.map(|v| f16::from_f32(f32::from(v) / 255.0))).collect()
    };
    let (previous_half, current_half) = (halves(&previous), halves(&current));
    let motion: Vec<[f16; 2]> =
        (0..width * height).map(|i| [(i as f32 * 0.01).sin(), i as f32 * 1e-5].map(f16::from_f32)).collect();
    let depth: Vec<f32> = (0..width * height).map(|i| 0.9 + 0.1 * (i as f32 * 0.001).sin()).collect();

    let mut lines = vec![average(&previous, &current)];
    // The scalar versions are references for correctness only.
    for level in SimdLevel::available().filter(|&level| level != SimdLevel::SCALAR || !is_measured) {
        pictures(&mut lines, level, "bytes", [&previous, &current], width);
        pictures(&mut lines, level, "halves", [&previous_half, &current_half], width);
        ranges(&mut lines, level, &motion, &depth, width);
    }
    let words: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let average = lines.remove(0);
    lines.retain(|line| words.iter().all(|word| line.name.contains(word)));
    lines.insert(0, average);
    for turn in 0..=turns {
        for line in &mut lines {
            let start = Instant::now();
            (line.work)();
            // The first turn warms up.
            if turn > 0 {
                line.times.push(start.elapsed());
            }
        }
    }
    if is_measured {
        println!("{width} x {height}, {} threads, least of {turns}", rayon::current_num_threads());
        let average = lines[0].shortest();
        for line in &lines {
            println!("{:36} {:8.2} ms {:8.2} x", line.name, line.shortest() * 1e3, line.shortest() / average);
        }
    }
}

/// A measurement.
struct Line<'a> {
    name: String,
    work: Box<dyn FnMut() + 'a>,
    times: Vec<Duration>,
}

impl<'a> Line<'a> {
    fn new(name: impl Into<String>, work: impl FnMut() + 'a) -> Self {
        Self { name: name.into(), work: Box::new(work), times: Vec::new() }
    }

    /// In seconds.
    fn shortest(&self) -> f64 {
        self.times.iter().min().map_or(0.0, Duration::as_secs_f64)
    }
}

/// The per-value average of two pictures: the cheapest frame between them.
fn average<'a>(previous: &'a [[u8; 4]], current: &'a [[u8; 4]]) -> Line<'a> {
    let (previous, current) = (previous.as_flattened(), current.as_flattened());
    let mut out = vec![0_u8; current.len()];
    Line::new("average of two pictures", move || {
        out.par_chunks_mut(1 << 16).enumerate().for_each(|(i, out)| {
            let (a, b) = (&previous[i << 16..], &current[i << 16..]);
            for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
                *out = (u16::from(a) + u16::from(b)).div_ceil(2) as u8;
            }
        });
        black_box(&mut out);
    })
}

/// Lines that make whole pictures, in tiles and in blocks of pixels.
fn pictures<'a, P: Sampled>(
    lines: &mut Vec<Line<'a>>,
    level: SimdLevel,
    pixels: &str,
    pictures: [&'a [P]; 2],
    width: usize,
) {
    let [previous, current] = pictures.map(|pixels| Source { pixels, width, height: pixels.len() / width });
    let rule = MergeRule { weight: 64, nearer_is_current: true, max_equal_difference: 4, doubt_threshold: 40 };
    let name = |what: &str| format!("{what} of {pixels}, {}", level.name());
    let position = move |tile: usize, band: usize, sign: i32| {
        [(64 * TILE * tile) as i32 + sign * DISPLACEMENT[0], (64 * TILE * band) as i32 + sign * DISPLACEMENT[1]]
    };

    let mut out = vec![current.pixels[0]; current.pixels.len()];
    lines.push(Line::new(name("tiles"), move || {
        out.par_chunks_exact_mut(TILE * width).enumerate().for_each(|(band, out)| {
            for tile in 0..width / TILE {
                let previous = TileSource { picture: previous, at: position(tile, band, 1) };
                let current = TileSource { picture: current, at: position(tile, band, -1) };
                black_box(P::merge_tile(level, previous, current, &rule, &mut out[tile * TILE..], width));
            }
        });
    }));
    let mut out = vec![current.pixels[0]; current.pixels.len()];
    lines.push(Line::new(name("tiles of one"), move || {
        out.par_chunks_exact_mut(TILE * width).enumerate().for_each(|(band, out)| {
            for tile in 0..width / TILE {
                P::sample_tile(
                    level,
                    TileSource { picture: current, at: position(tile, band, 1) },
                    &mut out[tile * TILE..],
                    width,
                );
            }
        });
    }));
    let tiles = current.height / TILE * (width / TILE);
    lines.push(Line::new(name("pixels"), move || {
        (0..tiles).into_par_iter().with_min_len(64).for_each(|tile| {
            let [a, b] = [1, -1].map(|sign| {
                let [x, y] = position(tile % (width / TILE), tile / (width / TILE), sign);
                Positions {
                    x: std::array::from_fn(|i| x + (64 * (i % TILE) + i) as i32),
                    y: std::array::from_fn(|i| y + (64 * (i / TILE) + 3 * i) as i32),
                }
            });
            let black = [current.pixels[0]; BLOCK];
            let mut out = Block { previous: black, current: black, merged: black };
            P::sample_pixels(level, previous, &a, u64::MAX, &mut out.previous);
            P::sample_pixels(level, current, &b, u64::MAX, &mut out.current);
            black_box(P::merge_block(level, &rule, &mut out));
            black_box(out);
        });
    }));
}

/// Lines that compute the ranges of motion and depth of all tiles.
fn ranges<'a>(lines: &mut Vec<Line<'a>>, level: SimdLevel, motion: &'a [[f16; 2]], depth: &'a [f32], width: usize) {
    let mut out = vec![VectorRange::default(); width.div_ceil(TILE) * (motion.len() / width).div_ceil(TILE)];
    lines.push(Line::new(format!("ranges of motion, {}", level.name()), move || {
        let bands = out.par_chunks_mut(width.div_ceil(TILE)).zip(motion.par_chunks(TILE * width));
        bands.for_each(|(out, motion)| motion_ranges(level, motion, width, [64 * 1920, 64 * 1080], out));
        black_box(&mut out);
    }));
    let mut out = vec![DepthKeyRange::default(); width.div_ceil(TILE) * (depth.len() / width).div_ceil(TILE)];
    lines.push(Line::new(format!("ranges of depth, {}", level.name()), move || {
        let bands = out.par_chunks_mut(width.div_ceil(TILE)).zip(depth.par_chunks(TILE * width));
        bands.for_each(|(out, depth)| depth_ranges(level, depth, width, out));
        black_box(&mut out);
    }));
}
