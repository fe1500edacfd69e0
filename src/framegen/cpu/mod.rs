//! The generator that needs nothing but a CPU.
//!
//! A picture at phase t comes about in these steps, each a module of its own:
//!
//! 1. `cut`: if the two anchors have nothing to do with each other, the nearer one is shown and the rest is left out.
//!    `bars`: letterbox bars stand still, whatever their vectors say; `standing`: so does what the caller says lies over the anchor.
//! 2. `field`: the motion of the current anchor, in tiles of 8 x 8 pixels. Where it is smooth a tile has one vector;
//!    elsewhere every pixel has its own, with a rank that says who is in front.
//! 3. `landing`: the vectors go to phase 0, where they tell which pixels of the previous anchor have an owner in the
//!    current one. The rest is what only the previous anchor shows; `fill` gives it the motion of the surface beside it.
//!    `leaving`: what passed over an edge in front of all else moves at least so far. `past`: with the previous anchor's
//!    depth, and where the way of the camera is known (see 4), none of that is a guess.
//! 4. `perspective`: what comes nearer moves faster on the screen. Where motion and depth of most of the picture are those of
//!    a world at rest, each claim has a phase of its own for t.
//!    `landing` once more: both go to phase t. Tiles are carried whole where that is smooth, pixel by pixel where
//!    surfaces meet, the nearest first; cracks are closed, and places nothing lands on are filled.
//! 5. `render`: both anchors are sampled by six pixels to a side at the displaced places. Where they agree, the nearer in time is
//!    taken as it is; where one does not show the surface, the other; where both do and differ, a mixture. A pixel beside
//!    what is in front goes with that if so the anchors agree better.
//!    `overlay`: what stands still in front of a moving world stays where it is. `foreign`: what only the previous anchor
//!    knows of is left out. `soften`: edges that depth does not tell are a little soft.
//! 6. `inpaint`: what neither shows takes the colours around it.
//!
//! Places, claims and samples of bytes are computed in whole numbers, the rest in single precision in one order without
//! fused steps, and every step settles conflicts by a total order: the result is the same to the bit for every number of
//! threads and every instruction set. `tests/reference.rs` describes it plainly, and is what all of them must equal.

mod bars;
mod colour;
mod cut;
mod field;
mod fill;
mod foreign;
mod inpaint;
#[doc(hidden)]
pub mod kernels;
mod landing;
mod layer;
mod leaving;
mod overlay;
mod past;
mod perspective;
mod render;
mod rules;
mod soften;
mod standing;
#[cfg(test)]
mod tests;

use bars::Inside;
use colour::Colour;
use cut::CutDetector;
use field::Preparation;
use fill::{Evidence, Filler};
use inpaint::Inpainter;
use kernels::{Level, Source};
use landing::{Bands, Carried, Pass};
use layer::{HOLE, Layer, ORPHAN, WHOLE};
use leaving::Leaving;
use overlay::Stills;
use past::Past;
use perspective::{Moment, Perspective, Seen, Way};
use render::Between;
use standing::Standing;

#[doc(hidden)]
pub use rules::Rule;
use rules::Rules;

use super::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome, Phases, pair::check_size};
use crate::tasks::PoolLease;
use crate::{Error, ErrorKind, Raster, Result};

/// Generates frames on the CPU, its rows in parallel, with the best instructions that the
/// processor has. Keeps working memory of about 45 bytes per pixel from call to call, and after the first allocates
/// nothing more until a picture of another size comes or more threads share its work.
#[derive(Debug)]
pub struct CpuGenerator {
    level: Level,
    rules: Rules,
    cut: CutDetector,
    preparation: Preparation,
    field: Layer,
    owners: Layer,
    places: Layer,
    bands: Bands,
    leaving: Leaving,
    filler: Filler,
    stills: Stills,
    inpainter: Inpainter,
    hidden: Vec<u64>,
    _threads: PoolLease,
}

impl Default for CpuGenerator {
    fn default() -> Self {
        Self::at(Level::detect())
    }
}

impl CpuGenerator {
    /// A generator without working memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn at(level: Level) -> Self {
        Self {
            level,
            rules: Rules::default(),
            cut: CutDetector::default(),
            preparation: Preparation::default(),
            field: Layer::default(),
            owners: Layer::default(),
            places: Layer::default(),
            bands: Bands::default(),
            leaving: Leaving::default(),
            filler: Filler::default(),
            stills: Stills::default(),
            inpainter: Inpainter::default(),
            hidden: Vec::new(),
            _threads: PoolLease::new(),
        }
    }

    /// This generator without one of its rules, for measurements.
    #[doc(hidden)]
    pub fn without(self, rule: Rule) -> Self {
        Self { rules: self.rules.without(rule), ..self }
    }

    /// `cpu`.
    pub fn name(&self) -> &str {
        "cpu"
    }

    /// Every phase.
    pub fn phases(&self) -> Phases {
        Phases::Any
    }

    /// Nothing to forget: every picture depends on its arguments alone, and only working memory is kept.
    pub fn reset(&mut self) {}

    fn between<P: Colour>(&mut self, pair: &AnchorPair<'_, P>, phase: i32, out: &mut Raster<P>) -> Result<f32> {
        let (previous, current) = (source(pair.previous()), source(pair.current()));
        let is_optical_flow = pair.guidance().origin().is_optical_flow();
        let rules = self.rules;
        let inside = rules.has(Rule::LetterboxBars).then(|| Inside::find(self.level, previous, current));
        let standing = Standing::new(inside.as_ref(), pair.overlay(), current.width);
        self.preparation.prepare(
            self.level,
            rules,
            pair.guidance(),
            Some((previous, current)),
            standing,
            &mut self.field,
        )?;
        let grid = self.field.grid;
        self.bands.reserve(grid)?;
        self.inpainter.reserve(grid)?;

        let way = Way::from_current(Moment::previous());
        self.owners.land(self.level, rules, &[Pass { layer: &self.field, way, of: Carried::Own }], &self.bands)?;
        let margin = foreign::margin(previous, current);
        let mut seen = Seen::find(pair.guidance(), &standing);
        let previous_depth = pair.previous_depth().filter(|_| rules.has(Rule::PreviousDepth));
        let past = Past::new(&seen, previous_depth, pair.guidance().depth());
        match &past {
            Some(past) => past.uncover(self.level, &mut self.owners, &self.field),
            None if rules.has(Rule::BorderExits) => {
                self.leaving.find(&mut self.owners, previous, current, margin, is_optical_flow.into())?;
            }
            None => {}
        }
        let leaving = (past.is_none() && rules.has(Rule::BorderExits)).then_some(&self.leaving);
        let shown = rules.has(Rule::FillByLikeness).then_some(previous);
        let carries = rules.has(Rule::CarriedSurfaces);
        let evidence = Evidence { field: &self.field, way, shown, past: past.as_ref(), carries, leaving, mark: ORPHAN };
        let orphans = self.filler.fill(self.level, &mut self.owners, &evidence)?;

        if !rules.has(Rule::CameraFit) {
            seen.perspective = Perspective::default();
        }
        let moment = Moment::new(phase, seen.perspective);
        let way = Way::from_current(moment);
        let passes = [
            Pass { layer: &self.field, way, of: Carried::Own },
            Pass { layer: &self.owners, way: Way::from_previous(moment), of: Carried::Borrowed },
        ];
        self.places.land(self.level, rules, &passes[..if orphans > 0 { 2 } else { 1 }], &self.bands)?;
        let evidence = Evidence::<P> {
            field: &self.field,
            way,
            shown: None,
            past: None,
            carries: false,
            leaving: None,
            mark: HOLE,
        };
        self.filler.fill(self.level, &mut self.places, &evidence)?;

        sized(&mut self.hidden, grid.tiles(), 0)?;
        self.stills.reserve(grid, rules.has(Rule::StaticOverlays))?;
        let between = Between {
            level: self.level,
            rules,
            previous,
            current,
            places: &self.places,
            field: &self.field,
            owners: &self.owners,
            phase,
            moment,
            margin: if rules.has(Rule::ColourOutliers) { margin } else { f32::INFINITY },
            stills: &self.stills,
            is_optical_flow,
        };
        let rendered = between.render(out, &mut self.hidden);
        if rendered.hidden > 0 && rules.has(Rule::Inpainting) {
            self.inpainter.paint(grid, &self.hidden, out)?;
        }
        Ok(rendered.uncovered as f32 / (grid.width * grid.height) as f32)
    }

    fn beyond<P: Colour>(&mut self, anchor: &Anchor<'_, P>, phase: i32, out: &mut Raster<P>) -> Result<f32> {
        let current = source(anchor.picture());
        let standing = Standing::new(None, anchor.overlay(), current.width);
        self.preparation.prepare::<P>(self.level, self.rules, anchor.guidance(), None, standing, &mut self.field)?;
        let grid = self.field.grid;
        self.bands.reserve(grid)?;
        self.inpainter.reserve(grid)?;
        let moment = Moment::new(WHOLE + phase, Seen::find(anchor.guidance(), &standing).perspective);
        let way = Way::from_current(moment);
        self.places.land(self.level, self.rules, &[Pass { layer: &self.field, way, of: Carried::Own }], &self.bands)?;
        let evidence = Evidence::<P> {
            field: &self.field,
            way,
            shown: None,
            past: None,
            carries: false,
            leaving: None,
            mark: HOLE,
        };
        self.filler.fill(self.level, &mut self.places, &evidence)?;
        sized(&mut self.hidden, grid.tiles(), 0)?;
        let rendered = render::beyond(self.level, current, &self.places, &self.field, moment, out, &mut self.hidden);
        if rendered.hidden > 0 {
            self.inpainter.paint(grid, &self.hidden, out)?;
        }
        Ok(rendered.uncovered as f32 / (grid.width * grid.height) as f32)
    }
}

impl<P: Colour> FrameGenerator<P> for CpuGenerator {
    fn name(&self) -> &str {
        Self::name(self)
    }

    fn phases(&self) -> Phases {
        Self::phases(self)
    }

    fn generate(&mut self, pair: &AnchorPair<'_, P>, t: f32, out: &mut Raster<P>) -> Result<GenerateReport> {
        check_size(out.size(), pair.size(), "out")?;
        if !Self::phases(self).contains(t) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a phase of {t} is not inside (0, 1)"))
                .field("t")
                .remedy("Show an anchor itself at phases 0 and 1"));
        }
        let (previous, current) = (pair.previous(), pair.current());
        let unexplained = if pair.is_cut() {
            1.0
        } else if !self.rules.has(Rule::CutDetection) {
            0.0
        } else {
            self.cut.unexplained(self.level, previous, current, pair.guidance().motion())?
        };
        if pair.is_cut() || self.rules.has(Rule::CutDetection) && self.cut.is_cut() {
            let nearer = if t < 0.5 { previous } else { current };
            out.pixels_mut().copy_from_slice(nearer.pixels());
            return Ok(GenerateReport { outcome: Outcome::CutFallback, uncovered: 0.0, unexplained });
        }
        let phase = ((t * WHOLE as f32 + 0.5) as i32).clamp(1, WHOLE - 1);
        let uncovered = self.between(pair, phase, out)?;
        Ok(GenerateReport { outcome: Outcome::Generated, uncovered, unexplained })
    }

    fn extrapolate(&mut self, anchor: &Anchor<'_, P>, t: f32, out: &mut Raster<P>) -> Result<GenerateReport> {
        let picture = anchor.picture();
        check_size(out.size(), picture.size(), "out")?;
        if !(t > 0.0 && t.is_finite()) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("{t} intervals after an anchor"))
                .field("t")
                .remedy("Pass a positive number of anchor intervals"));
        }
        if anchor.is_after_cut() {
            out.pixels_mut().copy_from_slice(picture.pixels());
            return Ok(GenerateReport { outcome: Outcome::Held, uncovered: 0.0, unexplained: 0.0 });
        }
        let phase = ((t.min(1.0) * WHOLE as f32 + 0.5) as i32).clamp(1, WHOLE);
        let uncovered = self.beyond(anchor, phase, out)?;
        let outcome = if t > 1.0 { Outcome::Held } else { Outcome::Generated };
        Ok(GenerateReport { outcome, uncovered, unexplained: 0.0 })
    }

    fn reset(&mut self) {
        Self::reset(self);
    }
}

fn source<P: Colour>(picture: &Raster<P>) -> Source<'_, P> {
    Source { pixels: picture.pixels(), width: picture.width() as usize, height: picture.height() as usize }
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
