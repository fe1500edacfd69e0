//! Checks of values for NaN and infinity.

use crate::bundle::Precision;

/// Exponent masks for a 32-bit word. All bits of a mask are set in the word if a value in it is NaN or infinite: for f32 its one
/// value (both masks are equal), for f16 the low and the high half.
pub(super) const fn exponents(precision: Precision) -> [u32; 2] {
    match precision {
        Precision::F32 => [0x7f80_0000; 2],
        Precision::F16 => [0x7c00, 0x7c00_0000],
    }
}

/// Whether every value of `bytes`, whole values of `precision` in native byte order at any address, is finite.
pub(crate) fn all_finite(bytes: &[u8], precision: Precision) -> bool {
    // All exponent bits are set for NaN and infinity. Without an early exit the loop runs at memory bandwidth.
    match precision {
        Precision::F32 => {
            let (words, _) = bytes.as_chunks::<4>();
            let [mask, _] = exponents(precision);
            !words.iter().fold(false, |bad, w| bad | (u32::from_ne_bytes(*w) & mask == mask))
        }
        Precision::F16 => {
            let (words, _) = bytes.as_chunks::<2>();
            !words.iter().fold(false, |bad, w| bad | (u16::from_ne_bytes(*w) & 0x7c00 == 0x7c00))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_value_that_is_not_finite_is_found_at_any_position() {
        for at in [0, 500, 1022] {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut wide = vec![f32::MAX; 1023];
                let mut narrow = vec![half::f16::MIN; 1023];
                assert!(all_finite(bytemuck::cast_slice(&wide), Precision::F32));
                assert!(all_finite(bytemuck::cast_slice(&narrow), Precision::F16));
                wide[at] = bad;
                narrow[at] = half::f16::from_f32(bad);
                assert!(!all_finite(bytemuck::cast_slice(&wide), Precision::F32), "{bad} at {at}");
                assert!(!all_finite(bytemuck::cast_slice(&narrow), Precision::F16), "{bad} at {at}");
            }
        }
    }
}
