//! Many generated frames: no window of frames after the warm-up leaves memory behind.
#![cfg(target_os = "linux")] // The process's size is read from Linux's file system `/proc`.

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator};
use cairn::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, paper};
use cairn::{Picture, PictureF16};
use half::f16;
use test_support::process::MemoryBounds;

/// Frames of every kind, until all working memory is allocated.
const WARM_UP: u64 = 60;

const BOUNDS: MemoryBounds = MemoryBounds { window: 100, heap_per_item: 50, resident_per_window: 512 << 10 };

const SIZE: (u32, u32) = (160, 90);

/// `cargo xtask test --thorough` asks for 10,000.
fn frames() -> u64 {
    std::env::var("CAIRN_SOAK_FRAMES").map_or(300, |text| text.parse().expect("CAIRN_SOAK_FRAMES is a number"))
}

/// A stream of frames: bytes and half floats, interpolated and extrapolated, at changing phases, with changing motion.
struct Stream {
    bytes: [Picture; 2],
    halves: [PictureF16; 2],
    out: (Picture, PictureF16),
    guidance: Guidance,
    generator: CpuGenerator,
}

impl Stream {
    fn new() -> Self {
        let (width, height) = SIZE;
        let picture = |shift: u32| {
            let mut picture = Picture::new(width, height).expect("a picture");
            for (i, pixel) in (0..).zip(picture.pixels_mut()) {
                let (x, y) = (f64::from(i % width + 40 - shift), f64::from(i / width));
                let [r, g, b] = [0.31, 0.17, 0.43].map(|f| (127.0 + 100.0 * (x * f + y * 0.29).sin()) as u8);
                *pixel = [r, g, b, 255];
            }
            picture
        };
        let bytes = [picture(0), picture(6)];
        let halves = [0, 1].map(|i: usize| {
            let mut halves = PictureF16::new(width, height).expect("a picture");
            for (half, pixel) in halves.pixels_mut().iter_mut().zip(bytes[i].pixels()) {
                *half = pixel.map(|v| f16::from_f32(f32::from(v) / 255.0));
            }
            halves
        });
        let motion = MotionField::new(width, height).expect("motion");
        let depth = DepthMap::new(width, height, paper::PROJECTION).expect("depth");
        let guidance = Guidance::from_parts(motion, depth, MotionOrigin::Geometry).expect("guidance");
        Self { out: (bytes[0].clone(), halves[0].clone()), bytes, halves, guidance, generator: CpuGenerator::new() }
    }

    fn frame(&mut self, number: u64) {
        let left = (number * 7 % u64::from(SIZE.0)) as u32;
        let reach = (number % 30) as f32;
        for (i, vector) in (0..).zip(self.guidance.motion_mut().vectors_mut()) {
            let is_near = (left..left + 30).contains(&(i % SIZE.0));
            *vector = [if is_near { -reach } else { -6.0 }, if is_near { 3.0 } else { 0.0 }].map(f16::from_f32);
        }
        for (i, depth) in (0..).zip(self.guidance.depth_mut().depth_mut()) {
            *depth = if (left..left + 30).contains(&(i % SIZE.0)) { 0.2 } else { 0.9 };
        }
        let t = (number % 9 + 1) as f32 / 10.0;
        let Self { bytes: [a, b], halves: [c, d], out, guidance, generator } = self;
        let made = match number % 4 {
            0 | 1 => generator.generate(&AnchorPair::new(a, b, guidance).expect("a pair"), t, &mut out.0),
            2 => generator.generate(&AnchorPair::new(c, d, guidance).expect("a pair"), t, &mut out.1),
            _ => generator.extrapolate(&Anchor::new(b, guidance).expect("an anchor"), t, &mut out.0),
        };
        made.expect("a frame");
    }
}

#[test]
fn many_frames_use_constant_memory() {
    let mut stream = Stream::new();
    (0..WARM_UP).for_each(|number| stream.frame(number));
    let windows = BOUNDS.check(WARM_UP..WARM_UP + frames(), |number| stream.frame(number));
    println!("growth of heap and resident memory in each {} frames: {windows:?}", BOUNDS.window);
    // The bounds find a leak that is little larger than what they allow.
    let leak = || BOUNDS.check(0..BOUNDS.window, |_| std::mem::forget(std::hint::black_box(vec![1_u8; 64])));
    assert!(std::panic::catch_unwind(leak).is_err(), "a leak of 64 bytes per frame was not found");
}
