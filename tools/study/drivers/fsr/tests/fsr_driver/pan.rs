//! A picture that pans.

use std::io::{BufReader, BufWriter, Write};
use std::process::{Command, Stdio};

use cairn::Picture;
use cairn::framegen::AnchorPair;
use cairn::guidance::{DepthEncoding, DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use fsr_driver::{Request, read_frame, read_greeting};
use half::f16;
use libtest_mimic::Trial;
use test_support::trials;

const SIZE: (u32, u32) = (640, 360);
/// Pixels between two anchors.
const STEP: i32 = 16;

/// An endless pattern, moved to the right.
fn moved(by: i32) -> Picture {
    let wave = |phase: f32| (128.0 + 100.0 * phase.sin()) as u8;
    let pixel = |i: u32| {
        let (x, y) = (((i % SIZE.0) as i32 - by) as f32, (i / SIZE.0) as f32);
        [wave(x * 0.05), wave(y * 0.07 + x * 0.02), wave(x * 0.03 - y * 0.04), 255]
    };
    Picture::from_rgba(SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).flat_map(pixel).collect()).expect("a picture")
}

fn guidance() -> Guidance {
    let pixels = (SIZE.0 * SIZE.1) as usize;
    let vectors = vec![[f16::from_f32(-STEP as f32), f16::ZERO]; pixels];
    let motion = MotionField::from_vectors(SIZE.0, SIZE.1, vectors).expect("motion");
    let camera = Projection::new(0.1, 100.0, 1.0).expect("a camera");
    let depth = DepthMap::from_host(SIZE.0, SIZE.1, vec![0.5; pixels], DepthEncoding::default(), camera);
    Guidance::from_parts(motion, depth.expect("depth"), MotionOrigin::Geometry).expect("of one size")
}

/// PSNR in dB of the inner part, which no content enters from an edge.
fn psnr(a: &Picture, b: &Picture) -> f64 {
    let is_inner = |i: usize| {
        let (x, y) = (i % SIZE.0 as usize, i / SIZE.0 as usize);
        (60..SIZE.0 as usize - 60).contains(&x) && (20..SIZE.1 as usize - 20).contains(&y)
    };
    let pixels = a.pixels().iter().zip(b.pixels()).enumerate().filter(|(i, _)| is_inner(*i));
    let squares = pixels.flat_map(|(_, (a, b))| (0..3).map(|c| f64::from(a[c].abs_diff(b[c])).powi(2)));
    let squares: Vec<f64> = squares.collect();
    10.0 * (255.0 * 255.0 / (squares.iter().sum::<f64>() / squares.len() as f64 + 1e-9)).log10()
}

fn frames_are_halfway_at_the_start_of_a_clip_and_within_it() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fsr-driver"));
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
    let mut from = BufReader::new(child.stdout.take().expect("a pipe"));
    let mut to = BufWriter::new(child.stdin.take().expect("a pipe"));
    println!("provider {}", read_greeting(&mut from).expect("a provider"));
    let guidance = guidance();
    // Two clips of one pair each, which have nothing in common, and a clip of three pairs.
    for (number, starts) in [(1, true), (9, true), (4, true), (5, false), (6, false)] {
        let (previous, current) = (moved(STEP * (number - 1)), moved(STEP * number));
        let pair = AnchorPair::new(&previous, &current, &guidance).expect("a pair");
        Request::write(&pair, starts, &mut to).expect("written");
        let frame = read_frame(&mut from, SIZE).expect("a frame");
        let half = moved(STEP * number - STEP / 2);
        let [before, half, after] = [&previous, &half, &current].map(|picture| psnr(&frame, picture));
        println!("anchor {number}: {before:.1} dB to the one before, {half:.1} dB to the truth, {after:.1} dB to it");
        assert!(half > 40.0 && before < 30.0 && after < 30.0, "anchor {number}: {before} {half} {after} dB");
    }
    // Pictures too small for AMD's libraries are refused, and the driver goes on.
    let tiny = Picture::new(32, 32).expect("a picture");
    let still = Guidance::new(32, 32, Projection::new(0.1, 100.0, 1.0).expect("a camera")).expect("guidance");
    Request::write(&AnchorPair::new(&tiny, &tiny, &still).expect("a pair"), true, &mut to).expect("written");
    let refused = read_frame(&mut from, (32, 32)).expect_err("too small");
    assert!(refused.to_string().contains("32 x 32"), "{refused}");
    to.flush().expect("flushed");
    drop(to);
    assert!(child.wait().expect("it ends").success());
}

/// The tests of this program.
pub(crate) fn trials() -> Vec<Trial> {
    trials![with_amd: frames_are_halfway_at_the_start_of_a_clip_and_within_it]
}
