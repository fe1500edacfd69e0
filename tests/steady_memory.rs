//! After the first frame, making frames allocates nothing: measured by an allocator that counts.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use cairn::Picture;
use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{Guidance, LatentView, paper, picture_flow};
use cairn::present::upscale::{Filter, Upscaler};

struct Counting;

thread_local! {
    // Of this thread: the harness and threads that end allocate when they please. Needs no set-up and no tear-down, so the
    // allocator may use it at any time.
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

fn count() {
    ALLOCATIONS.set(ALLOCATIONS.get() + 1);
}

// SAFETY: every call goes to the system's allocator unchanged; only a counter is kept beside it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs `work` on one worker thread, twice to warm up, and counts the allocations of the next five times.
fn allocations_when_warm(mut work: impl FnMut() + Send) -> usize {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    pool.install(|| {
        work();
        work();
        let before = ALLOCATIONS.get();
        for _ in 0..5 {
            work();
        }
        ALLOCATIONS.get() - before
    })
}

#[test]
fn frames_are_made_without_allocating() {
    let latents: Vec<f32> = (0..4 * 8 * 16).map(|i| (i as f32 * 0.7).sin()).collect();
    let view = |values| LatentView::new(2, 8, 16, values).expect("a latent");
    let (z0, z1) = latents.split_at(latents.len() / 2);
    let mut guidance = Guidance::new(128, 72, paper::PROJECTION).expect("guidance");
    let mut extractor = paper::Extractor::new();
    assert_eq!(
        allocations_when_warm(|| {
            extractor.extract(view(z0), view(z1), (128, 72), &mut guidance).expect("motion and depth");
        }),
        0,
        "guidance"
    );

    let mut previous = Picture::new(128, 72).expect("a picture");
    for (i, value) in previous.rgba_mut().iter_mut().enumerate() {
        *value = ((i * i) >> 7) as u8;
    }
    let mut current = previous.clone();
    current.rgba_mut().rotate_right(8);
    let mut flow = Guidance::new(128, 72, picture_flow::PROJECTION).expect("guidance");
    let mut extractor = picture_flow::Extractor::new();
    assert_eq!(
        allocations_when_warm(|| {
            extractor.extract(&previous, &current, &mut flow).expect("motion");
            extractor.extract_next(&previous, &mut flow).expect("motion");
        }),
        0,
        "motion from pictures"
    );

    let mut out = previous.clone();
    let mut generator = CpuGenerator::new();
    assert_eq!(
        allocations_when_warm(|| {
            let pair = AnchorPair::new(&previous, &current, &guidance).expect("a pair");
            let report = generator.generate(&pair, 0.5, &mut out).expect("a frame");
            assert_eq!(report.outcome, Outcome::Generated);
            // Some places must be filled, or that part would go unwatched.
            assert!(report.uncovered > 0.0);
            generator
                .extrapolate(&Anchor::new(&current, &guidance).expect("an anchor"), 0.5, &mut out)
                .expect("a frame");
        }),
        0,
        "frame generation"
    );

    let mut upscaler = Upscaler::new((128, 72), (192, 108), Filter::Lanczos3).expect("tables");
    let mut large = Picture::new(192, 108).expect("a picture");
    assert_eq!(allocations_when_warm(|| upscaler.upscale(&previous, &mut large).expect("a picture")), 0, "upscaling");
}
