//! Times of the metrics: `cargo bench -p study --bench metrics`, or with `-- --threads N`; the default is two threads.
//!
//! Each line is a metric at a size, the least of several turns, all of them in one run and interleaved, and how many pairs of pictures
//! a second that is. `tools/study/benches/metrics.py` runs this beside the usual Python implementations and prints the ratios.
//! Without `--bench`, as under `cargo test`, everything runs once at a small size and nothing is measured.

use std::hint::black_box;
use std::time::{Duration, Instant};

use cairn::Picture;
use study::metrics::{Lpips, Net, ms_ssim, psnr, ssim};

/// Turns of each line.
const TURNS: usize = 7;
/// Working sizes: of the paper's presentation, and of the study.
const SIZES: [(u32, u32); 2] = [(1920, 1080), (640, 360)];
const SMALL: [(u32, u32); 1] = [(176, 162)];

struct Line<'a> {
    name: &'static str,
    size: (u32, u32),
    work: Box<dyn FnMut() -> f64 + Send + 'a>,
    least: Duration,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let is_measured = words.iter().any(|word| word == "--bench");
    let threads = words.iter().skip_while(|word| *word != "--threads").nth(1);
    let threads: usize = threads.map_or(2, |n| n.parse().expect("--threads takes a number"));
    let sizes: &[(u32, u32)] = if is_measured { &SIZES } else { &SMALL };
    // Its weights are fetched by `study score`; where they are not there, its lines are left out.
    let lpips = if is_measured { Lpips::find(Net::Alex).ok() } else { None };
    let pairs: Vec<[Picture; 2]> = sizes.iter().map(|&size| [picture(size, 0), picture(size, 3)]).collect();

    let mut lines = Vec::new();
    for [a, b] in &pairs {
        let size = a.size();
        let mut add = |name, work: Box<dyn FnMut() -> f64 + Send>| {
            lines.push(Line { name, size, work, least: Duration::MAX });
        };
        add("psnr", Box::new(|| psnr(a, b).expect("one size")));
        add("ssim", Box::new(|| ssim(a, b).expect("one size")));
        add("ms_ssim", Box::new(|| ms_ssim(a, b).expect("one size")));
        if let Some(lpips) = &lpips {
            add("lpips_alex", Box::new(|| lpips.compare(a, b).expect("one size")));
            // Time per frame of a video, where the features of the previous frame are known.
            let before = lpips.features(a).expect("large enough");
            add("lpips_alex_next", Box::new(move || lpips.distance_to(&before, b).expect("one size")));
        }
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    // The first turn warms up.
    for turn in 0..=if is_measured { TURNS } else { 0 } {
        for line in &mut lines {
            let start = Instant::now();
            black_box(pool.install(|| (line.work)()));
            if turn > 0 {
                line.least = line.least.min(start.elapsed());
            }
        }
    }
    if is_measured {
        println!("metric,width,height,threads,ms,per_second");
        for Line { name, size: (width, height), least, .. } in lines {
            let seconds = least.as_secs_f64();
            println!("{name},{width},{height},{threads},{:.3},{:.2}", 1e3 * seconds, 1.0 / seconds);
        }
    }
}

/// A texture that is neither flat nor noise.
fn picture((width, height): (u32, u32), shift: u32) -> Picture {
    let mut picture = Picture::new(width, height).expect("memory");
    for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
        let (x, y) = ((i as u32 % width + shift) as f32, (i as u32 / width) as f32);
        let value =
            |c: f32| (127.0 + 80.0 * (x * 0.031 + c).sin() * (y * 0.047).cos() + 40.0 * (x * y * 0.003).sin()) as u8;
        *px = [value(0.0), value(1.0), value(2.0), 255];
    }
    picture
}
