//! The frame generator on the CPU.
//!
//! A frame at phase t is generated in these steps, each a module of its own:
//!
//! 1. `cut`: detects a cut between the anchors, across which the nearer one is shown. `letterbox` finds the bars;
//!    `static_mask` combines them with the caller's mask of static pixels.
//! 2. `field`: the current anchor's motion as splat keys, in tiles of 8x8 pixels. A tile with uniform motion has one
//!    key, a mixed tile one per pixel. A key's depth decides which surface is in front.
//! 3. `splat`: forward warp of the field to the previous anchor. Pixels that it does not cover are visible in the
//!    previous anchor only. `hole_filling` gives them the motion of a neighbouring surface. `reprojection` makes that
//!    exact where the previous anchor's depth and the camera motion are known.
//! 4. `camera_fit`: estimates the camera's motion, from which the perspective-correct phase of every pixel follows.
//!    `splat` then warps the field, and the pixels that only the previous anchor shows, to phase t: uniform tiles as a
//!    whole, others pixel by pixel. The nearest key wins, cracks are closed, and `hole_filling` fills the rest.
//! 5. `render`: samples both anchors at the displaced positions with a 6x6 Lanczos kernel and takes the sample nearer
//!    in time where they agree, the visible one where one anchor is occluded, and a blend otherwise. Pixels beside a
//!    foreground edge use the foreground's motion if the anchors then agree better. `static_overlay` keeps static
//!    content in place, and `edge_antialiasing` blends edges that no depth confirms.
//! 6. `inpaint`: fills pixels that neither anchor shows from the colours around them.
//!
//! Positions, keys and samples of bytes are integers; everything else is single precision in one order without fused
//! operations, and ties are broken by a total order. The result has the same bits for every number of threads and every
//! instruction set. `tests/reference.rs` is a plain implementation that all of them must equal.

mod camera_fit;
mod colour;
mod cut;
mod edge_antialiasing;
mod field;
mod hole_filling;
mod inpaint;
#[doc(hidden)]
pub mod kernels;
mod key_buffer;
mod letterbox;
mod render;
mod reprojection;
mod rules;
mod splat;
mod splat_key;
mod static_mask;
mod static_overlay;
#[cfg(test)]
mod tests;
mod warp;

use camera_fit::CameraFit;
use colour::Colour;
use cut::CutDetector;
#[cfg(windows)]
pub(super) use cut::{BLOCK as CUT_BLOCK, REDUCED_SIDE, TINY_FACTOR};
use field::FieldBuilder;
use hole_filling::{FillInputs, HoleFiller};
use inpaint::Inpainter;
use kernels::{SimdLevel, Source};
use key_buffer::KeyBuffer;
use letterbox::ActiveArea;
use render::Interpolation;
use reprojection::Reprojection;
#[doc(hidden)]
pub use rules::Rule;
use rules::Rules;
use splat::{KeyOrigin, SplatPass, Splatter};
#[cfg(windows)]
pub(super) use splat_key::HOLE;
pub(super) use splat_key::{PHASE_ONE, PREVIOUS_ONLY};
use static_mask::StaticMask;
use static_overlay::StaticPixels;
use warp::{DepthChange, Warp, WarpTime};

use super::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome, Phases, pair::check_size};
use crate::tasks::PoolLease;
use crate::{Error, ErrorKind, Raster, Result};

/// Generates frames on the CPU, in parallel rows, with the best instruction set of the processor. Keeps about 45 bytes
/// of working memory per pixel; after the first frame it allocates only for another picture size or more threads.
#[derive(Debug)]
pub struct CpuGenerator {
    level: SimdLevel,
    rules: Rules,
    cut: CutDetector,
    field_builder: FieldBuilder,
    field: KeyBuffer,
    previous_keys: KeyBuffer,
    frame_keys: KeyBuffer,
    splatter: Splatter,
    hole_filler: HoleFiller,
    static_pixels: StaticPixels,
    inpainter: Inpainter,
    hidden: Vec<u64>,
    _threads: PoolLease,
}

impl Default for CpuGenerator {
    fn default() -> Self {
        Self::at(SimdLevel::detect())
    }
}

impl CpuGenerator {
    /// Creates a generator without working memory.
    pub fn new() -> Self {
        Self::default()
    }

    fn at(level: SimdLevel) -> Self {
        Self {
            level,
            rules: Rules::default(),
            cut: CutDetector::default(),
            field_builder: FieldBuilder::default(),
            field: KeyBuffer::default(),
            previous_keys: KeyBuffer::default(),
            frame_keys: KeyBuffer::default(),
            splatter: Splatter::default(),
            hole_filler: HoleFiller::default(),
            static_pixels: StaticPixels::default(),
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

    /// The generator's name, `cpu`.
    pub fn name(&self) -> &str {
        "cpu"
    }

    /// Every phase.
    pub fn phases(&self) -> Phases {
        Phases::Any
    }

    /// Does nothing: a picture depends on its arguments only, and no state but working memory is kept.
    pub fn reset(&mut self) {}

    /// Generates the frame at `phase` between two anchors without a cut; returns the share of uncovered pixels.
    fn interpolate_pair<P: Colour>(
        &mut self,
        pair: &AnchorPair<'_, P>,
        phase: i32,
        out: &mut Raster<P>,
    ) -> Result<f32> {
        let (previous, current) = (source(pair.previous()), source(pair.current()));
        let is_optical_flow = pair.guidance().origin().is_optical_flow();
        let rules = self.rules;
        let active_area = rules.has(Rule::LetterboxBars).then(|| ActiveArea::find(self.level, previous, current));
        let static_mask = StaticMask::new(active_area.as_ref(), pair.overlay(), current.width);
        self.field_builder.build(
            self.level,
            rules,
            pair.guidance(),
            Some((previous, current)),
            static_mask,
            &mut self.field,
        )?;
        let grid = self.field.grid;
        self.splatter.reserve(grid)?;
        self.inpainter.reserve(grid)?;

        let warp = Warp::from_current(WarpTime::previous_anchor());
        self.splatter.splat(
            self.level,
            self.rules,
            &[SplatPass { source: &self.field, warp, origin: KeyOrigin::Own }],
            &mut self.previous_keys,
        )?;
        let camera = CameraFit::fit(pair.guidance(), &static_mask);
        let previous_depth = pair.previous_depth().filter(|_| rules.has(Rule::PreviousDepth));
        let reprojection = Reprojection::new(&camera, previous_depth, pair.guidance().depth());
        if let Some(reprojection) = &reprojection {
            reprojection.clear_occluded(self.level, &mut self.previous_keys, &self.field);
        }
        let fill_inputs = FillInputs {
            field: &self.field,
            warp,
            picture: rules.has(Rule::FillByLikeness).then_some(previous),
            reprojection: reprojection.as_ref(),
            follows_neighbours: rules.has(Rule::NeighboursMotion),
            tag: PREVIOUS_ONLY,
        };
        let holes = self.hole_filler.fill(self.level, &mut self.previous_keys, &fill_inputs)?;

        let depth_change = if rules.has(Rule::CameraFit) { camera.depth_change } else { DepthChange::default() };
        let time = WarpTime::new(phase, depth_change);
        let warp = Warp::from_current(time);
        let passes = [
            SplatPass { source: &self.field, warp, origin: KeyOrigin::Own },
            SplatPass { source: &self.previous_keys, warp: Warp::from_previous(time), origin: KeyOrigin::Inherited },
        ];
        self.splatter.splat(self.level, rules, &passes[..if holes > 0 { 2 } else { 1 }], &mut self.frame_keys)?;
        let fill_inputs = FillInputs::<P>::in_frame(&self.field, warp);
        self.hole_filler.fill(self.level, &mut self.frame_keys, &fill_inputs)?;

        resize(&mut self.hidden, grid.tiles(), 0)?;
        // With a mask it is known where an overlay is.
        let finds_overlays = pair.overlay().is_none() && rules.has(Rule::StaticOverlays);
        self.static_pixels.reserve(grid, finds_overlays)?;
        let interpolation = Interpolation {
            level: self.level,
            rules,
            previous,
            current,
            frame_keys: &self.frame_keys,
            field: &self.field,
            previous_keys: &self.previous_keys,
            phase,
            time,
            static_pixels: &self.static_pixels,
            is_optical_flow,
        };
        let rendered = interpolation.render(out, &mut self.hidden);
        if rendered.hidden > 0 && rules.has(Rule::Inpainting) {
            self.inpainter.paint(grid, &self.hidden, out)?;
        }
        Ok(rendered.uncovered as f32 / (grid.width * grid.height) as f32)
    }

    /// Extrapolates an anchor by `phase`; returns the share of uncovered pixels.
    fn extrapolate_anchor<P: Colour>(
        &mut self,
        anchor: &Anchor<'_, P>,
        phase: i32,
        out: &mut Raster<P>,
    ) -> Result<f32> {
        let current = source(anchor.picture());
        let static_mask = StaticMask::new(None, anchor.overlay(), current.width);
        self.field_builder.build::<P>(self.level, self.rules, anchor.guidance(), None, static_mask, &mut self.field)?;
        let grid = self.field.grid;
        self.splatter.reserve(grid)?;
        self.inpainter.reserve(grid)?;
        let time = WarpTime::new(PHASE_ONE + phase, CameraFit::fit(anchor.guidance(), &static_mask).depth_change);
        let warp = Warp::from_current(time);
        self.splatter.splat(
            self.level,
            self.rules,
            &[SplatPass { source: &self.field, warp, origin: KeyOrigin::Own }],
            &mut self.frame_keys,
        )?;
        let fill_inputs = FillInputs::<P>::in_frame(&self.field, warp);
        self.hole_filler.fill(self.level, &mut self.frame_keys, &fill_inputs)?;
        resize(&mut self.hidden, grid.tiles(), 0)?;
        let rendered =
            render::extrapolate(self.level, current, &self.frame_keys, &self.field, time, out, &mut self.hidden);
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
        let phase = ((t * PHASE_ONE as f32 + 0.5) as i32).clamp(1, PHASE_ONE - 1);
        let uncovered = self.interpolate_pair(pair, phase, out)?;
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
        let phase = ((t.min(1.0) * PHASE_ONE as f32 + 0.5) as i32).clamp(1, PHASE_ONE);
        let uncovered = self.extrapolate_anchor(anchor, phase, out)?;
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

/// Resizes `buffer` to `len` values. Existing values stay, new ones are `value`.
fn resize<T: Clone>(buffer: &mut Vec<T>, len: usize, value: T) -> Result<()> {
    buffer.truncate(len);
    reserve(buffer, len)?;
    buffer.resize(len, value);
    Ok(())
}

/// Reserves capacity for `len` values in all; fails instead of aborting if there is not enough memory.
fn reserve<T>(buffer: &mut Vec<T>, len: usize) -> Result<()> {
    buffer
        .try_reserve_exact(len.saturating_sub(buffer.len()))
        .map_err(|_| Error::new(ErrorKind::OutOfMemory, format!("working memory for {len} pixels cannot be allocated")))
}

/// The constants of these modules that shaders have too, for `constants.hlsli`.
#[cfg(test)]
pub(crate) fn shader_constants() -> Vec<crate::shader_constants::Constants> {
    let own = [
        splat_key::SHADER_CONSTANTS,
        cut::SHADER_CONSTANTS,
        letterbox::SHADER_CONSTANTS,
        field::SHADER_CONSTANTS,
        camera_fit::SHADER_CONSTANTS,
        splat::SHADER_CONSTANTS,
        reprojection::SHADER_CONSTANTS,
        hole_filling::SHADER_CONSTANTS,
        render::SHADER_CONSTANTS,
        static_overlay::SHADER_CONSTANTS,
        edge_antialiasing::SHADER_CONSTANTS,
        inpaint::SHADER_CONSTANTS,
    ];
    [&kernels::SHADER_CONSTANTS[..], &own].concat()
}
