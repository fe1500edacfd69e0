//! Frame generation on tile segments.
//!
//! 1. `field`: the current anchor's motion becomes segments.
//! 2. `warp` to the previous anchor; what has no segment there is visible in the previous anchor only, and `holes` finds its motion.
//! 3. `warp` of both to phase t; `holes` once more.
//! 4. `render`: colours from the two anchors. `extrapolate`: colours from the current one alone, for a time after it.
//!
//! Segments are whole numbers and independent of the order in which threads find them, so that a picture is the same for every number of threads.

mod extrapolate;
mod field;
mod holes;
mod render;
#[cfg(test)]
mod tests;
mod tiles;
mod warp;

use extrapolate::After;
use field::{Given, Ranges};
use holes::{Covers, Evidence};
use render::Between;
use tiles::Segments;
use warp::{Bands, Pass, warp};

use super::colour::Colour;
use super::cut::CutDetector;
use super::inpaint::Inpainter;
use super::kernels::Level;
use super::layer::{EMPTY, ORPHAN, WHOLE};
use super::leaving::Leaving;
use super::overlay::Stills;
use super::past::Past;
use super::perspective::{Moment, Seen, Way};
use super::standing::Standing;
use super::{bars::Inside, foreign, sized, source};
use crate::framegen::pair::check_size;
use crate::framegen::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome, Phases};
use crate::tasks::PoolLease;
use crate::{Error, ErrorKind, Raster, Result};

/// Generates frames on tile segments.
#[derive(Debug)]
pub struct SegmentGenerator {
    level: Level,
    cut: CutDetector,
    ranges: Ranges,
    field: Segments,
    added: Segments,
    owners: Segments,
    shown: Segments,
    bands: Bands,
    covers: Covers,
    leaving: Leaving,
    stills: Stills,
    inpainter: Inpainter,
    hidden: Vec<u64>,
    _threads: PoolLease,
}

impl Default for SegmentGenerator {
    fn default() -> Self {
        Self {
            level: Level::detect(),
            cut: CutDetector::default(),
            ranges: Ranges::default(),
            field: Segments::default(),
            added: Segments::default(),
            owners: Segments::default(),
            shown: Segments::default(),
            bands: Bands::default(),
            covers: Covers::default(),
            leaving: Leaving::default(),
            stills: Stills::default(),
            inpainter: Inpainter::default(),
            hidden: Vec::new(),
            _threads: PoolLease::new(),
        }
    }
}

impl SegmentGenerator {
    /// A generator without working memory yet.
    pub fn new() -> Self {
        Self::default()
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
        let level = self.level;
        let (previous, current) = (source(pair.previous()), source(pair.current()));
        let guidance = pair.guidance();
        let is_optical_flow = guidance.origin().is_optical_flow();
        let is_tiled = guidance.motion().tile() > 1;
        let inside = Inside::find(level, previous, current);
        let standing = Standing::new(Some(&inside), pair.overlay(), current.width);
        let is_flat = super::field::is_flat(level, guidance.depth());
        let given = Given { level, guidance, anchors: Some([previous, current]), standing, is_flat };
        let can_widen = !is_flat && guidance.motion().tile() == 1;
        if can_widen {
            given.segment(&mut self.ranges, &mut self.shown)?;
            given.widen(&self.shown, &mut self.field)?;
        } else {
            given.segment(&mut self.ranges, &mut self.field)?;
        }
        let grid = self.field.grid;
        self.bands.reserve(grid)?;
        self.inpainter.reserve(grid)?;

        let way = Way::from_current(Moment::previous());
        let pass = Pass { segments: &self.field, way, is_of_pass: |_| true };
        warp(&[pass], is_tiled, &self.bands, &mut self.owners)?;
        let seen = Seen::find(guidance, &standing);
        let past = Past::new(&seen, pair.previous_depth(), guidance.depth());
        let margin = foreign::margin(previous, current);
        if past.is_none() {
            let owners = &self.owners;
            let owner = |x, y| owners.at([x, y]).map_or(EMPTY, |segment| segment.key());
            self.leaving.look(&owner, [previous, current], margin, is_optical_flow.into())?;
            let (leaving, owners) = (&self.leaving, &mut self.owners);
            leaving.each(|x, y| owners.remove(x, y));
        }
        let leaving = if past.is_none() { Some(&self.leaving) } else { None };
        let shown = Some(previous);
        let evidence =
            Evidence { field: &self.field, way, depth: guidance.depth(), shown, past: past.as_ref(), leaving, level };
        if let Some(past) = &past {
            evidence.uncover(past, &mut self.owners);
        }
        self.covers.find(&self.owners)?;
        evidence.fill(&mut self.owners, &self.covers, &mut self.added)?;

        let moment = Moment::new(phase, seen.perspective);
        let way = Way::from_current(moment);
        let orphans = Pass { segments: &self.added, way: Way::from_previous(moment), is_of_pass: |s| s.mark == ORPHAN };
        let passes = [Pass { segments: &self.field, way, is_of_pass: |_| true }, orphans];
        warp(&passes[..if self.covers.holes() > 0 { 2 } else { 1 }], is_tiled, &self.bands, &mut self.shown)?;
        self.covers.find(&self.shown)?;
        let evidence = Evidence::<P> {
            field: &self.field,
            way,
            depth: guidance.depth(),
            shown: None,
            past: None,
            leaving: None,
            level,
        };
        evidence.fill(&mut self.shown, &self.covers, &mut self.added)?;

        sized(&mut self.hidden, grid.tiles(), 0)?;
        self.stills.reserve(grid)?;
        let (shown, field, owners, stills) = (&self.shown, &self.field, &self.owners, &self.stills);
        let between = Between {
            level,
            previous,
            current,
            shown,
            field,
            owners,
            phase,
            moment,
            margin,
            stills,
            is_optical_flow,
            is_tiled,
        };
        let rendered = between.render(out, &mut self.hidden);
        if rendered.hidden > 0 {
            self.inpainter.paint(grid, &self.hidden, out)?;
        }
        Ok(rendered.uncovered as f32 / (grid.width * grid.height) as f32)
    }

    fn after<P: Colour>(&mut self, anchor: &Anchor<'_, P>, phase: i32, out: &mut Raster<P>) -> Result<f32> {
        let level = self.level;
        let (current, guidance) = (source(anchor.picture()), anchor.guidance());
        let standing = Standing::new(None, anchor.overlay(), current.width);
        let is_flat = super::field::is_flat(level, guidance.depth());
        let given = Given::<P> { level, guidance, anchors: None, standing, is_flat };
        given.segment(&mut self.ranges, &mut self.field)?;
        let grid = self.field.grid;
        self.bands.reserve(grid)?;
        self.inpainter.reserve(grid)?;
        let moment = Moment::new(WHOLE + phase, Seen::find(guidance, &standing).perspective);
        let way = Way::from_current(moment);
        let pass = Pass { segments: &self.field, way, is_of_pass: |_| true };
        warp(&[pass], guidance.motion().tile() > 1, &self.bands, &mut self.shown)?;
        self.covers.find(&self.shown)?;
        let (depth, field) = (guidance.depth(), &self.field);
        let evidence = Evidence::<P> { field, way, depth, shown: None, past: None, leaving: None, level };
        evidence.fill(&mut self.shown, &self.covers, &mut self.added)?;
        sized(&mut self.hidden, grid.tiles(), 0)?;
        let after = After { level, current, shown: &self.shown, field: &self.field, way };
        let rendered = after.render(out, &mut self.hidden);
        if rendered.hidden > 0 {
            self.inpainter.paint(grid, &self.hidden, out)?;
        }
        Ok(rendered.uncovered as f32 / (grid.width * grid.height) as f32)
    }
}

impl<P: Colour> FrameGenerator<P> for SegmentGenerator {
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
        } else {
            self.cut.unexplained(self.level, previous, current, pair.guidance().motion())?
        };
        if pair.is_cut() || self.cut.is_cut() {
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
        let uncovered = self.after(anchor, phase, out)?;
        let outcome = if t > 1.0 { Outcome::Held } else { Outcome::Generated };
        Ok(GenerateReport { outcome, uncovered, unexplained: 0.0 })
    }

    fn reset(&mut self) {
        Self::reset(self);
    }
}
