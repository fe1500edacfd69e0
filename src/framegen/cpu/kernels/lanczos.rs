//! Lanczos kernel with three lobes, in fixed point.
//!
//! Most samples of generated frames lie half way between pixels, where short filters lose contrast. With six taps a
//! generated frame looks as sharp as the anchors; with four it does not.

use std::f64::consts::PI;

/// Subpixel positions.
pub(super) const PHASES: usize = 64;
/// Taps per row or column.
pub(super) const TAPS: usize = 6;
/// Taps before the pixel at or just before the position.
pub(super) const BEFORE: i32 = 2;
/// Sum of the weights.
pub(super) const ONE: i16 = 128;

/// Pairs of taps that kernels of bytes add in 16 bits: never both large ones in the middle.
pub(super) const PAIRS: [[usize; 2]; TAPS / 2] = [[1, 2], [3, 4], [0, 5]];

/// Weights of six pixels for a position `phase / 64` after the third; their sum is [`ONE`].
pub(super) static SINC: [[i16; TAPS]; PHASES] = {
    let mut table = [[0; TAPS]; PHASES];
    let mut phase = 0;
    while phase < PHASES {
        let (near, mirrored) = if phase <= PHASES / 2 { (phase, false) } else { (PHASES - phase, true) };
        let weights = weights(near as f64 / PHASES as f64);
        let mut tap = 0;
        while tap < TAPS {
            table[phase][tap] = weights[if mirrored { TAPS - 1 - tap } else { tap }];
            tap += 1;
        }
        phase += 1;
    }
    table
};

#[cfg(test)]
crate::shader_constants::shader_constants!("LANCZOS_": [int] SINC.flattened);

/// Weights for a position up to half a pixel after the third, rounded to the nearest; the rest of the sum goes to those
/// that rounding changed most.
const fn weights(after: f64) -> [i16; TAPS] {
    let mut exact = [0.0; TAPS];
    let (mut sum, mut tap) = (0.0, 0);
    while tap < TAPS {
        exact[tap] = lanczos(tap as f64 - BEFORE as f64 - after);
        sum += exact[tap];
        tap += 1;
    }
    let mut weights = [0; TAPS];
    let mut rest = ONE;
    tap = 0;
    while tap < TAPS {
        exact[tap] *= ONE as f64 / sum;
        weights[tap] = (if exact[tap] < 0.0 { exact[tap] - 0.5 } else { exact[tap] + 0.5 }) as i16;
        rest -= weights[tap];
        tap += 1;
    }
    while rest != 0 {
        let step = rest.signum();
        let mut most = 0;
        tap = 1;
        while tap < TAPS {
            if (exact[tap] - weights[tap] as f64) * step as f64 > (exact[most] - weights[most] as f64) * step as f64 {
                most = tap;
            }
            tap += 1;
        }
        weights[most] += step;
        rest -= step;
    }
    weights
}

/// sinc(x) sinc(x / 3) for |x| < 3.
const fn lanczos(x: f64) -> f64 {
    if x == 0.0 {
        1.0
    } else if x <= -3.0 || x >= 3.0 {
        0.0
    } else {
        3.0 * sine(x) * sine(x / 3.0) / (PI * PI * x * x)
    }
}

/// Sine of pi `x` for |x| up to 3: reduced to half a pi, then its Taylor series.
const fn sine(x: f64) -> f64 {
    let (mut x, mut sign) = (x, 1.0);
    while x > 0.5 {
        x -= 1.0;
        sign = -sign;
    }
    while x < -0.5 {
        x += 1.0;
        sign = -sign;
    }
    let (angle, mut term, mut sum, mut n) = (PI * x, PI * x, PI * x, 1.0);
    while n < 12.0 {
        term *= -angle * angle / (2.0 * n * (2.0 * n + 1.0));
        sum += term;
        n += 1.0;
    }
    sign * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_lanczos_and_sum_to_one() {
        let sinc = |x: f64| if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) };
        for (phase, weights) in SINC.iter().enumerate() {
            let after = phase as f64 / PHASES as f64;
            let exact: [f64; TAPS] = std::array::from_fn(|tap| {
                let x = tap as f64 - 2.0 - after;
                if x.abs() < 3.0 { sinc(x) * sinc(x / 3.0) } else { 0.0 }
            });
            let sum: f64 = exact.iter().sum();
            assert_eq!(weights.iter().sum::<i16>(), ONE);
            for (&weight, exact) in weights.iter().zip(exact) {
                assert!((f64::from(weight) / f64::from(ONE) - exact / sum).abs() < 1.0 / f64::from(ONE), "{phase}");
            }
        }
        assert_eq!(SINC[0], [0, 0, 128, 0, 0, 0]);
        assert_eq!(SINC[32], [3, -17, 78, 78, -17, 3]);
        for phase in 1..PHASES {
            assert!(SINC[phase].iter().eq(SINC[PHASES - phase].iter().rev()));
        }
    }

    #[test]
    fn sums_fit_the_integers_of_the_kernels() {
        for weights in SINC {
            // Negated weights fit 8 bits, pairs of weighted bytes fit 16, and so do all six after subtracting 128.
            assert!(weights.iter().all(|&w| i8::try_from(-w).is_ok()));
            let reach = |taps: &[usize], sign: i32| {
                taps.iter().map(|&tap| (sign * i32::from(weights[tap])).max(0) * 255).sum::<i32>()
            };
            for pair in PAIRS.iter().chain(&[[0, 3], [1, 2], [4, 5]]) {
                assert!(reach(pair, 1) <= 32_768 && reach(pair, -1) <= 32_767);
            }
            assert!(weights.iter().map(|w| i32::from(w.abs()) * 128).sum::<i32>() <= 32_767);
            // The first four with the whole bias.
            let (bias, taps) = (128 * i32::from(ONE) - 64, [0, 1, 2, 3]);
            assert!(reach(&taps, 1) - bias <= 32_768 && reach(&taps, -1) + bias <= 32_767);
        }
    }
}
