//! Compares the upscaler with a plain two-dimensional resampler in f64, and checks properties of any resampler.

use super::*;
use crate::tasks::Pool;

const FILTERS: [Filter; 2] = [Filter::Lanczos3, Filter::CatmullRom];

fn draw(width: u32, height: u32, rule: impl Fn(usize, usize) -> [u8; 4]) -> Picture {
    let mut picture = Picture::new(width, height).unwrap();
    for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
        *pixel = rule(i % width as usize, i / width as usize);
    }
    picture
}

fn noise(x: usize, y: usize) -> [u8; 4] {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b9) ^ (y as u32).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    (h ^ (h >> 13)).to_le_bytes()
}

fn resampled(source: &Picture, to: (u32, u32), filter: Filter) -> Picture {
    let mut out = Picture::new(to.0, to.1).unwrap();
    Upscaler::new(source.size(), to, filter).unwrap().upscale(source, &mut out).unwrap();
    out
}

/// Computes every output pixel directly from the definition: the 2D kernel over all positions it reaches, with the edge pixels
/// repeated outside the picture.
fn reference(source: &Picture, to: (u32, u32), filter: Filter) -> Vec<[f64; 4]> {
    let (width, height) = source.size();
    let axis = |i: u32, from: u32, to: u32| {
        let ratio = f64::from(from) / f64::from(to);
        let stretch = ratio.max(1.0);
        let centre = (f64::from(i) + 0.5) * ratio - 0.5;
        let reach = 3.0 * stretch + 1.0;
        let taps = ((centre - reach) as i64 - 1..=(centre + reach) as i64 + 1)
            .map(|at| (at.clamp(0, i64::from(from) - 1) as usize, filter.weight((at as f64 - centre) / stretch)))
            .collect::<Vec<_>>();
        let total: f64 = taps.iter().map(|tap| tap.1).sum();
        taps.into_iter().map(move |(at, weight)| (at, weight / total)).collect::<Vec<_>>()
    };
    let columns: Vec<_> = (0..to.0).map(|x| axis(x, width, to.0)).collect();
    let mut out = Vec::new();
    for y in 0..to.1 {
        let rows = axis(y, height, to.1);
        for column in &columns {
            let mut sum = [0.0; 4];
            for &(j, down) in &rows {
                for &(i, across) in column {
                    let pixel = source.pixels()[j * width as usize + i];
                    sum.iter_mut().zip(pixel).for_each(|(s, v)| *s += down * across * f64::from(v));
                }
            }
            out.push(sum);
        }
    }
    out
}

#[test]
fn every_ratio_matches_the_definition() {
    for filter in FILTERS {
        for (from, to) in [
            ((16, 9), (24, 13)),
            ((16, 9), (16, 27)),
            ((17, 11), (5, 4)),
            ((30, 20), (7, 41)),
            ((5, 4), (5, 4)),
            ((1, 1), (3, 4)),
            ((13, 9), (1, 1)),
            ((2, 40), (31, 2)),
        ] {
            let source = draw(from.0, from.1, noise);
            let out = resampled(&source, to, filter);
            for (i, (have, want)) in out.pixels().iter().zip(reference(&source, to, filter)).enumerate() {
                for (&have, want) in have.iter().zip(want) {
                    // Half a level of rounding, plus f32 rounding near a boundary.
                    let apart = (f64::from(have) - want.clamp(0.0, 255.0)).abs();
                    assert!(apart < 0.502, "{filter:?} {from:?} to {to:?}: {have} for {want} at {i}");
                }
            }
        }
    }
}

#[test]
fn one_to_one_changes_nothing() {
    let source = draw(19, 14, noise);
    for filter in FILTERS {
        assert_eq!(resampled(&source, (19, 14), filter), source);
    }
}

#[test]
fn a_constant_stays_a_constant() {
    for level in [0, 1, 100, 127, 254, 255] {
        let source = draw(23, 15, |_, _| [level, 255 - level, level / 2, 255]);
        for filter in FILTERS {
            for to in [(64, 48), (7, 5), (23, 60), (1, 1), (101, 3)] {
                let out = resampled(&source, to, filter);
                assert!(out.pixels().iter().all(|p| *p == source.pixels()[0]), "{level}, {filter:?}, {to:?}");
            }
        }
    }
}

#[test]
fn a_ramp_stays_a_ramp() {
    let source = draw(40, 4, |x, _| [(x * 6) as u8; 4]);
    for (filter, tolerance) in [(Filter::CatmullRom, 0.51), (Filter::Lanczos3, 1.0)] {
        for width in [100, 93, 60] {
            let out = resampled(&source, (width, 4), filter);
            for (x, pixel) in out.pixels()[..width as usize].iter().enumerate() {
                let position = (x as f64 + 0.5) * 40.0 / f64::from(width) - 0.5;
                // Away from the ends, where edge pixels are repeated.
                if (3.0..36.0).contains(&position) {
                    assert!((f64::from(pixel[0]) - position * 6.0).abs() <= tolerance, "{filter:?} {width} at {x}");
                }
            }
        }
    }
}

#[test]
fn an_impulse_shows_the_kernel() {
    // On mid grey, so that the negative lobes are not cut. Three times as wide: the centre pixel stays, its neighbours
    // are a third away.
    let source = draw(15, 15, |x, y| if (x, y) == (7, 7) { [228; 4] } else { [128; 4] });
    for filter in FILTERS {
        let out = resampled(&source, (45, 45), filter);
        for y in 0..45_i32 {
            for x in 0..45_i32 {
                let weight = |at: i32| {
                    let taps = |i: i32| filter.weight(f64::from(i) - f64::from(at - 22) / 3.0);
                    taps(0) / (-10..=10).map(taps).sum::<f64>()
                };
                let expected = 128.0 + 100.0 * weight(x) * weight(y);
                let have = f64::from(out.pixels()[(y * 45 + x) as usize][0]);
                assert!((have - expected).abs() < 0.502, "{filter:?}: {have} for {expected} at ({x}, {y})");
            }
        }
    }
}

#[test]
fn the_mean_is_preserved() {
    let source = draw(60, 48, |x, y| noise(x, y).map(|v| 64 + v / 2));
    let mean = |p: &Picture| p.rgba().iter().map(|&v| f64::from(v)).sum::<f64>() / p.rgba().len() as f64;
    for filter in FILTERS {
        for to in [(120, 96), (90, 72), (30, 24), (20, 12)] {
            let apart = mean(&resampled(&source, to, filter)) - mean(&source);
            assert!(apart.abs() < 0.6, "{filter:?} {to:?}: {apart}");
        }
    }
}

#[test]
fn detail_too_fine_for_the_new_size_is_averaged_not_aliased() {
    // Columns alternate. Every fourth of them alone would be all black or all white.
    let source = draw(128, 8, |x, _| if x % 2 == 0 { [0; 4] } else { [255; 4] });
    for filter in FILTERS {
        for width in [32, 33, 43] {
            let out = resampled(&source, (width, 8), filter);
            let inside = out.pixels()[..width as usize].iter().skip(2).take(width as usize - 4);
            assert!(
                inside.clone().all(|p| p[0].abs_diff(128) <= 8),
                "{filter:?} {width}: {:?}",
                inside.collect::<Vec<_>>()
            );
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let source = draw(50, 37, noise);
    for filter in FILTERS {
        let of_threads = |threads| {
            let pool = Pool::new(threads).unwrap();
            pool.install(|| resampled(&source, (81, 64), filter))
        };
        assert_eq!(of_threads(1), of_threads(3));
    }
}

#[test]
fn wrong_sizes_are_refused() {
    let field = |e: Error| (e.kind(), e.offending_field().map(str::to_owned));
    let bad = |name: &str| (ErrorKind::InvalidArgument, Some(name.to_owned()));
    for size in [(0, 4), (4, 0), (16_385, 4), (4, u32::MAX)] {
        assert_eq!(field(Upscaler::new(size, (4, 4), Filter::Lanczos3).unwrap_err()), bad("from"));
        assert_eq!(field(Upscaler::new((4, 4), size, Filter::Lanczos3).unwrap_err()), bad("to"));
    }
    let mut upscaler = Upscaler::new((4, 3), (8, 6), Filter::CatmullRom).unwrap();
    assert_eq!((upscaler.from_size(), upscaler.to_size()), ((4, 3), (8, 6)));
    let (small, mut large) = (draw(4, 3, noise), draw(8, 6, noise));
    assert_eq!(field(upscaler.upscale(&large.clone(), &mut large).unwrap_err()), bad("source"));
    let mut wrong = small.clone();
    assert_eq!(field(upscaler.upscale(&small, &mut wrong).unwrap_err()), bad("out"));
}

#[test]
fn the_longest_picture_still_has_small_tables() {
    let source = draw(MAX_SIDE, 1, |_, _| [9, 8, 7, 255]);
    assert_eq!(resampled(&source, (1, 1), Filter::Lanczos3).pixels(), [[9, 8, 7, 255]]);
    assert!(resampled(&draw(1, 1, |_, _| [5; 4]), (MAX_SIDE, 1), Filter::Lanczos3).rgba().iter().all(|&v| v == 5));
}
