//! The generator against the reference implementation: the same bits for every instruction set and number of threads.

use half::f16;

use super::reference;
use crate::Raster;
use crate::framegen::cpu::CpuGenerator;
use crate::framegen::cpu::colour::Colour;
use crate::framegen::cpu::kernels::SimdLevel;
use crate::framegen::cpu::splat_key::PHASE_ONE;
use crate::framegen::{Anchor, AnchorPair, FrameGenerator, Outcome};
use crate::tasks::Pool;
use cases::{Random, guidance, overlay, pictures, previous_depth};

// The compute shaders are compared on the same cases. The crate `test-support` cannot be used here: its types are those
// of another copy of this library.
#[path = "../../../../tests/gpu-testing/src/frame_cases.rs"]
#[allow(unreachable_pub, reason = "the crate exports it")]
mod cases;

/// Largest difference, in levels, for a pixel beside foreground that is assigned to it. A copy of the generator's
/// constant, so that a change of that is noticed.
pub(super) const EDGE_TOLERANCE: f32 = 45.0;

fn raster<P: Colour>(size: (u32, u32), levels: &[[f32; 4]]) -> Raster<P> {
    let mut picture = Raster::new(size.0, size.1).unwrap();
    picture.pixels_mut().iter_mut().zip(levels).for_each(|(pixel, &levels)| *pixel = P::from_levels(levels));
    picture
}

/// Compares many random cases of one pixel type with the reference.
fn compare<P: Colour>(cases: u64) {
    let pool = |threads| Pool::new(threads).unwrap();
    let pools: Vec<Pool> = [1, 2, 5].map(pool).into();
    let mut generators: Vec<_> = SimdLevel::available().map(|level| (level, CpuGenerator::at(level))).collect();
    let mut generated = 0;
    for seed in 0..cases {
        let mut random = Random(seed);
        let sizes = [(1, 1), (1, 40), (40, 1), (8, 8), (16, 24), (33, 17), (64, 40), (95, 70), (130, 81)];
        let size = sizes[random.below(sizes.len() as u64) as usize];
        let guidance = guidance(&mut random, size);
        let [previous, current] = pictures(&mut random, size).map(|levels| raster::<P>(size, &levels));
        let t = [0.5, 1.0 / 3.0, 0.25, 0.75, f32::MIN_POSITIVE, 1.0 - f32::EPSILON, 0.1, 0.9][random.below(8) as usize];
        let phase = ((t * PHASE_ONE as f32).round() as i32).max(1);
        let pair = AnchorPair::new(&previous, &current, &guidance).unwrap();
        let depth = previous_depth(&mut random, guidance.depth());
        let mut pair = if random.below(3) == 0 { pair } else { pair.with_previous_depth(&depth).unwrap() };
        let mut anchor = Anchor::new(&current, &guidance).unwrap();
        let mask = overlay(&mut random, size);
        if random.below(2) == 0 {
            (pair, anchor) = (pair.with_overlay(&mask).unwrap(), anchor.with_overlay(&mask).unwrap());
        }
        let (mut interpolated, extrapolated) = (None, reference::extrapolated(&anchor, phase));
        let mut out = previous.clone();
        for (level, generator) in &mut generators {
            let pool = &pools[random.below(3) as usize];
            let what = || format!("case {seed}, {size:?}, t = {t}, {}", level.name());
            let report = pool.install(|| generator.generate(&pair, t, &mut out)).unwrap();
            if report.outcome == Outcome::Generated {
                let (picture, uncovered) =
                    interpolated.get_or_insert_with(|| reference::interpolated(&pair, phase.min(PHASE_ONE - 1)));
                assert_same(&out, picture, &what);
                assert_eq!(report.uncovered, *uncovered, "{}", what());
                generated += 1;
            } else {
                assert!(out == if t < 0.5 { previous.clone() } else { current.clone() }, "{}", what());
            }
            let report = pool.install(|| generator.extrapolate(&anchor, t, &mut out)).unwrap();
            assert_same(&out, &extrapolated.0, &what);
            assert_eq!(report.uncovered, extrapolated.1, "{}", what());
        }
    }
    assert!(generated > cases * generators.len() as u64 / 2, "most cases are no cuts");
}

fn assert_same<P: Colour>(picture: &Raster<P>, truth: &Raster<P>, what: &dyn Fn() -> String) {
    let mut pixels = picture.pixels().iter().zip(truth.pixels());
    let bits = |pixel: &P| bytemuck::bytes_of(pixel).to_vec();
    let first = pixels.position(|(a, b)| bits(a) != bits(b));
    let place = first.map(|i| [i as u32 % picture.width(), i as u32 / picture.width()]);
    assert_eq!(
        place,
        None,
        "{}: {:?} is not {:?}",
        what(),
        first.map(|i| picture.pixels()[i]),
        first.map(|i| truth.pixels()[i])
    );
}

#[test]
fn pictures_of_bytes_equal_the_reference() {
    compare::<[u8; 4]>(150);
}

#[test]
fn pictures_of_half_floats_equal_the_reference() {
    compare::<[f16; 4]>(60);
}
