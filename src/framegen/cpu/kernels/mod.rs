//! Inner loops of the generator, each for several instruction sets.
//!
//! Every kernel has a scalar version that defines its result, a version over arrays that compilers vectorise (SSE2,
//! NEON), and versions for newer x86 processors. All give the same bits: pictures of bytes are computed in integers,
//! pictures of half floats in single precision in one fixed order without fused operations. The instruction set is
//! detected at run time; tests and benchmarks select others.
//!
//! Positions are in 1/64 of a pixel, (0, 0) is the centre of the first pixel, and reads outside a picture are clamped
//! to its border. Nothing panics for any position, vector or depth, and nothing allocates.
//!
//! Public for benchmarks only; not part of the library's interface.

mod bytes;
pub(super) mod candidates;
mod halves;
mod lanczos;
mod ranges;
mod sampling;
mod scalar;
#[cfg(test)]
mod tests;
pub(super) mod tile_keys;

#[cfg(test)]
pub(super) const SHADER_CONSTANTS: [crate::shader_constants::Constants; 2] =
    [sampling::SHADER_CONSTANTS, lanczos::SHADER_CONSTANTS];

pub use ranges::{DepthKeyRange, VectorRange, WarpedRow, depth_ranges, motion_ranges, pack_tile, warp_row};
pub use sampling::{BLOCK, Block, MergeRule, Positions, Sampled, TILE, TileSource};

/// An instruction set. A value proves that this processor has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SimdLevel(pub(in crate::framegen::cpu) Set);

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(in crate::framegen::cpu) enum Set {
    Scalar,
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// F, BW, DQ, VL, VBMI and VNNI: Ice Lake, Zen 4 and later.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl SimdLevel {
    /// Plain loops over pixels: the reference.
    pub const SCALAR: Self = Self(Set::Scalar);
    /// The instructions that every processor of the target has.
    pub const PORTABLE: Self = Self(Set::Portable);

    /// The best instruction set of this processor.
    pub fn detect() -> Self {
        Self::available().max().unwrap_or(Self::PORTABLE)
    }

    /// All instruction sets of this processor, the lowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        let sets: &[Set] = &[
            Set::Scalar,
            Set::Portable,
            #[cfg(target_arch = "x86_64")]
            Set::Avx2,
            #[cfg(target_arch = "x86_64")]
            Set::Avx512,
        ];
        sets.iter().copied().filter(|set| set.is_available()).map(Self)
    }

    /// A short lower-case name, e.g. `avx2`.
    pub fn name(self) -> &'static str {
        match self.0 {
            Set::Scalar => "scalar",
            Set::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "avx512",
        }
    }
}

impl Set {
    fn is_available(self) -> bool {
        match self {
            Self::Scalar | Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512vbmi")
                    && is_x86_feature_detected!("avx512vnni")
            }
        }
    }
}

/// Defines a function for every [`SimdLevel`]: `$scalar`, or `$portable`, which is `#[inline(always)]` and compiled
/// once per instruction set.
macro_rules! at_every_level {
    ($(#[$attribute:meta])* $vis:vis fn $name:ident $(<$generic:ident: $bound:path>)? ($($arg:ident: $type:ty),* $(,)?)
        $(-> $result:ty)? = $scalar:path | $portable:path) => {
        $(#[$attribute])*
        $vis fn $name $(<$generic: $bound>)? (level: $crate::framegen::cpu::kernels::SimdLevel, $($arg: $type),*) $(-> $result)? {
            use $crate::framegen::cpu::kernels::Set;
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn avx2 $(<$generic: $bound>)? ($($arg: $type),*) $(-> $result)? {
                $portable($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512vnni")]
            fn avx512 $(<$generic: $bound>)? ($($arg: $type),*) $(-> $result)? {
                $portable($($arg),*)
            }
            match level.0 {
                Set::Scalar => $scalar($($arg),*),
                Set::Portable => $portable($($arg),*),
                #[cfg(target_arch = "x86_64")]
                // SAFETY: a value of this level proves that the processor has AVX2.
                Set::Avx2 => unsafe { avx2($($arg),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: a value of this level proves that the processor has these features.
                Set::Avx512 => unsafe { avx512($($arg),*) },
            }
        }
    };
}
pub(in crate::framegen::cpu) use at_every_level;

/// Prefetches a value.
#[inline(always)]
pub(super) fn prefetch<T>(value: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a hint, which reads nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(value).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

/// A view of a picture's pixels, row by row without padding.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a, P> {
    /// `width * height` pixels.
    pub pixels: &'a [P],
    /// Pixels per row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
}

impl<P: Copy> Source<'_, P> {
    /// Prefetches the tile at a position (1/64 px) with `around` more pixels on each side, clipped to the picture.
    /// Hardware prefetchers follow neither that many rows nor positions that jump.
    #[inline(always)]
    pub(super) fn prefetch_tile(&self, at: [i32; 2], around: i32) {
        let [x, y] = at.map(|v| (v >> 6) - around);
        let side = TILE as i32 + 2 * around;
        for row in y.max(0)..(y + side).min(self.height as i32) {
            // A negative x starts in the row above, which is as good for a prefetch.
            let start = (row as usize * self.width).saturating_add_signed(x as isize);
            for at in [start, start + side as usize - 1] {
                self.pixels.get(at).into_iter().for_each(prefetch);
            }
        }
    }

    /// Copies the pixels at (x, y), clamped to the border.
    fn clamped<const W: usize, const H: usize>(&self, [x, y]: [i32; 2], patch: &mut [[P; W]; H]) {
        let on_axis = |at: i32, len: usize| at.clamp(0, len as i32 - 1) as usize;
        for (j, to) in patch.iter_mut().enumerate() {
            let row = &self.pixels[on_axis(y + j as i32, self.height) * self.width..][..self.width];
            match usize::try_from(x).ok().and_then(|x| row.get(x..)).and_then(|rest| rest.first_chunk::<W>()) {
                Some(pixels) => *to = *pixels,
                None => (x..).zip(to).for_each(|(x, to)| *to = row[on_axis(x, self.width)]),
            }
        }
    }
}
