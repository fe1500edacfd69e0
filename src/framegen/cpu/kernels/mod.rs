//! The inner loops of the generator, each for several instruction sets.
//!
//! Every kernel has a plainly written scalar twin that says what is computed, a form over arrays that compilers turn
//! into vectors (SSE2, NEON), and forms for newer x86 processors. All of them give the same bits: pictures of bytes are
//! computed in whole numbers, pictures of half floats in single precision in one stated order without fused steps. The
//! level is found once, at run time; tests and benches take others.
//!
//! Common to all: positions are in 1/64 of a pixel, (0, 0) being the centre of the first one, and beyond the edges of a
//! picture its edge pixels go on. Nothing panics for any position, vector or depth, and nothing allocates.
//!
//! Public for the benches; not part of what the library promises.

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

pub use ranges::{DepthKeyRange, VectorRange, WarpedRow, depth_ranges, motion_ranges, pack_tile, warp_row};
pub use sampling::{BLOCK, Block, Positions, Rule, Sampled, TILE};

/// An instruction set that kernels are written for. That a value exists proves that this processor has it.
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
    /// Plain loops over pixels: the oracle.
    pub const SCALAR: Self = Self(Set::Scalar);
    /// What every processor of the target has.
    pub const PORTABLE: Self = Self(Set::Portable);

    /// The highest level that this processor has.
    pub fn detect() -> Self {
        Self::available().max().unwrap_or(Self::PORTABLE)
    }

    /// All levels that this processor has, the lowest first.
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

/// Defines a function that does its work at a [`SimdLevel`]: by `$scalar`, or by `$portable`, which is `#[inline(always)]`
/// and is compiled once for each instruction set.
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
                // SAFETY: that this level exists proves that the processor has AVX2.
                Set::Avx2 => unsafe { avx2($($arg),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: that this level exists proves that the processor has all that is asked for.
                Set::Avx512 => unsafe { avx512($($arg),*) },
            }
        }
    };
}
pub(in crate::framegen::cpu) use at_every_level;

/// Asks for what will be read soon.
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

/// Pixels of a picture, row by row without padding, to read from.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a, P> {
    /// `width * height` pixels.
    pub pixels: &'a [P],
    /// Pixels to a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
}

impl<P: Copy> Source<'_, P> {
    /// Asks for the rows of a tile at a position (1/64 px), and `around` more pixels on each side, as far as they are in
    /// the picture. Processors foresee neither so many rows nor where the next tile is that is not like its neighbours.
    #[inline(always)]
    pub(super) fn prefetch_tile(&self, at: [i32; 2], around: i32) {
        let [x, y] = at.map(|v| (v >> 6) - around);
        let side = TILE as i32 + 2 * around;
        for row in y.max(0)..(y + side).min(self.height as i32) {
            // What is negative is far beyond.
            let start = (row as usize * self.width).saturating_add_signed(x as isize);
            for at in [start, start + side as usize - 1] {
                self.pixels.get(at).into_iter().for_each(prefetch);
            }
        }
    }

    /// The pixels from (x, y) on, the edge pixels going on beyond the edges.
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
