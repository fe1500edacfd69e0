//! A cubic in fixed point: that of Keys with a = -3/4.
//!
//! Halfway between pixels, where most samples of generated frames lie, a cubic takes contrast away. With -3/4 instead of
//! the -1/2 of Catmull and Rom it takes less, as much as sharp edges allow.

/// Positions between two pixels.
pub(super) const PHASES: usize = 64;
/// What the weights of a position add up to.
pub(super) const ONE: i16 = 128;

/// Weights of four pixels for a position `phase / 64` after the second; they add up to [`ONE`].
pub(super) static CUBIC: [[i16; 4]; PHASES] = {
    let mut table = [[0; 4]; PHASES];
    let mut phase = 0;
    while phase < PHASES {
        let (near, mirrored) = if phase <= PHASES / 2 { (phase, false) } else { (PHASES - phase, true) };
        let weights = cubic(near as i32);
        let mut tap = 0;
        while tap < 4 {
            table[phase][tap] = weights[if mirrored { 3 - tap } else { tap }];
            tap += 1;
        }
        phase += 1;
    }
    table
};

/// The weights for k / 64 up to a half, rounded to the nearest; what rounding leaves goes to the largest, which feels
/// it least.
const fn cubic(k: i32) -> [i16; 4] {
    // 2 * 64^3 times the polynomials of R. Keys, 1981, with a = -3/4, over 64; 2 * 64^3 / 64 = 8192.
    let (k2, k3) = (k * k, k * k * k);
    let outer = nearest(-3 * k3 + 384 * k2 - 12288 * k);
    let second = nearest(-5 * k3 + 384 * k2 + 12288 * k);
    let last = nearest(3 * k3 - 192 * k2);
    [outer, ONE - outer - second - last, second, last]
}

/// `v / 8192`, halves away from zero.
const fn nearest(v: i32) -> i16 {
    (if v < 0 { -((4096 - v) / 8192) } else { (v + 4096) / 8192 }) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_add_up_and_are_those_of_the_cubic() {
        for (phase, weights) in CUBIC.iter().enumerate() {
            let f = phase as f64 / PHASES as f64;
            let exact = [
                0.75 * (-f.powi(3) + 2.0 * f * f - f),
                1.25 * f.powi(3) - 2.25 * f * f + 1.0,
                -1.25 * f.powi(3) + 1.5 * f * f + 0.75 * f,
                0.75 * (f.powi(3) - f * f),
            ];
            assert_eq!(weights.iter().sum::<i16>(), ONE);
            for (&weight, exact) in weights.iter().zip(exact) {
                assert!((f64::from(weight) / f64::from(ONE) - exact).abs() < 1.5 / f64::from(ONE), "{phase}");
            }
        }
        assert_eq!(CUBIC[0], [0, 128, 0, 0]);
        assert_eq!(CUBIC[32], [-12, 76, 76, -12]);
        for phase in 1..PHASES {
            assert!(CUBIC[phase].iter().eq(CUBIC[PHASES - phase].iter().rev()));
        }
    }

    #[test]
    fn sums_fit_the_numbers_that_kernels_use() {
        for weights in CUBIC {
            // Minus the weight fits 8 bits, pairs of weighted bytes fit 16, and so do all four once 128 is taken off.
            assert!(weights.iter().all(|&w| i8::try_from(-w).is_ok()));
            for pair in weights.chunks(2) {
                let reach = |sign: i32| pair.iter().map(|&w| (sign * i32::from(w)).max(0) * 255).sum::<i32>();
                assert!(reach(1) <= 32_768 && reach(-1) <= 32_767);
            }
            assert!(weights.iter().map(|w| i32::from(w.abs()) * 128).sum::<i32>() <= 32_767);
        }
    }
}
