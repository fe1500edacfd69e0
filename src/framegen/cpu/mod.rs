//! The generator that needs nothing but a CPU.
//!
//! One picture at phase t comes about in five steps, each a module of its own:
//!
//! 1. `cut`: if the two anchors have nothing to do with each other, the nearer one is shown and the rest is left out.
//! 2. `surface`: every pixel of the current anchor gets a motion vector that can be trusted and a rank, which says who
//!    is in front where several land on one place.
//! 3. `splat`: the vectors go to phase t, and once to phase 0, where they tell which pixels of the previous anchor have
//!    an owner in the current one.
//! 4. `fill`: places nothing landed on borrow the vector of a surface beside them.
//! 5. `blend`: both anchors are sampled at the displaced places; a mixture by t where both show the surface, the one
//!    that shows it elsewhere.
//!
//! The result is the same to the bit for every number of threads: each pixel is computed by itself, and conflicts are
//! settled by a total order.

mod bars;
mod blend;
mod cut;
mod fill;
#[doc(hidden)]
pub mod kernels;
mod sample;
mod splat;
mod surface;
#[cfg(test)]
mod tests;

use cut::CutDetector;
use fill::Filler;
use splat::Splat;
use surface::Surfaces;

use super::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome, Phases, pair::check_size};
use crate::{Error, ErrorKind, Picture, Result};

/// Generates frames on the CPU, its rows in parallel on the current rayon pool. Keeps working memory of about 40 bytes
/// per pixel from call to call, and allocates nothing more until a larger picture comes.
#[derive(Debug, Default)]
pub struct CpuGenerator {
    cut: CutDetector,
    surfaces: Surfaces,
    at_phase: Splat,
    at_previous: Splat,
    filler: Filler,
}

impl CpuGenerator {
    /// A generator without working memory yet.
    pub fn new() -> Self {
        Self::default()
    }
}

impl FrameGenerator for CpuGenerator {
    fn name(&self) -> &str {
        "cpu"
    }

    fn phases(&self) -> Phases {
        Phases::Any
    }

    fn generate(&mut self, pair: &AnchorPair<'_>, t: f32, out: &mut Picture) -> Result<GenerateReport> {
        check_size(out.size(), pair.size(), "out")?;
        if !self.phases().contains(t) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a phase of {t} is not inside (0, 1)"))
                .field("t")
                .remedy("Show an anchor itself at phases 0 and 1"));
        }
        let (previous, current, guidance) = (pair.previous(), pair.current(), pair.guidance());

        let unexplained = if pair.is_cut() {
            1.0
        } else {
            self.cut.unexplained(kernels::Level::detect(), previous, current, guidance.motion())?
        };
        if pair.is_cut() || self.cut.is_cut() {
            let nearer = if t < 0.5 { previous } else { current };
            out.rgba_mut().copy_from_slice(nearer.rgba());
            return Ok(GenerateReport { outcome: Outcome::CutFallback, uncovered: 0.0, unexplained });
        }

        self.surfaces.prepare_pair(previous, current, guidance)?;
        self.at_previous.splat(&self.surfaces, pair.size(), 1.0)?;
        self.at_phase.splat(&self.surfaces, pair.size(), 1.0 - t)?;
        let uncovered =
            self.filler.fill(&self.surfaces, &self.at_phase, 1.0 - t, Some(&self.at_previous), pair.size())?;
        blend::between(previous, current, t, &self.surfaces, &self.filler, &self.at_previous, out);
        Ok(GenerateReport { outcome: Outcome::Generated, uncovered, unexplained })
    }

    fn extrapolate(&mut self, anchor: &Anchor<'_>, t: f32, out: &mut Picture) -> Result<GenerateReport> {
        let picture = anchor.picture();
        check_size(out.size(), picture.size(), "out")?;
        if !(t > 0.0 && t.is_finite()) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("{t} intervals after an anchor"))
                .field("t")
                .remedy("Pass a positive number of anchor intervals"));
        }
        if anchor.is_after_cut() {
            out.rgba_mut().copy_from_slice(picture.rgba());
            return Ok(GenerateReport { outcome: Outcome::Held, uncovered: 0.0, unexplained: 0.0 });
        }

        let bounded = t.min(1.0);
        self.surfaces.prepare_anchor(anchor.guidance())?;
        self.at_phase.splat(&self.surfaces, picture.size(), -bounded)?;
        let uncovered = self.filler.fill(&self.surfaces, &self.at_phase, -bounded, None, picture.size())?;
        blend::beyond(picture, bounded, &self.surfaces, &self.filler, out);
        let outcome = if t > 1.0 { Outcome::Held } else { Outcome::Generated };
        Ok(GenerateReport { outcome, uncovered, unexplained: 0.0 })
    }

    /// Nothing to forget: every picture depends on its arguments alone, and only working memory is kept.
    fn reset(&mut self) {}
}

/// Brings `buffer` to `len` values, keeping what it has reserved. New values are `value`, old ones stay as they are.
fn sized<T: Clone>(buffer: &mut Vec<T>, len: usize, value: T) -> Result<()> {
    buffer.truncate(len);
    reserve(buffer, len)?;
    buffer.resize(len, value);
    Ok(())
}

/// Makes room for `len` values in all, with refusal instead of an abort where memory is short.
fn reserve<T>(buffer: &mut Vec<T>, len: usize) -> Result<()> {
    buffer
        .try_reserve_exact(len.saturating_sub(buffer.len()))
        .map_err(|_| Error::new(ErrorKind::OutOfMemory, format!("working memory for {len} pixels cannot be allocated")))
}
