//! The generator that needs nothing but a CPU.
//!
//! A picture at phase t comes about in these steps, each a module of its own:
//!
//! 1. `cut`: if the two anchors have nothing to do with each other, the nearer one is picture and the rest is left out.
//!    `bars`: letterbox bars stand still, whatever their vectors say; `static_mask`: so does what the caller says lies over the anchor.
//! 2. `field`: the motion of the current anchor, in tiles of 8 x 8 pixels. Where it is smooth a tile has one vector;
//!    elsewhere every pixel has its own, with a rank that says who is in front.
//! 3. `landing`: the vectors go to phase 0, where they tell which pixels of the previous anchor have an owner in the
//!    current one. The rest is what only the previous anchor shows; `fill` gives it the motion of the surface beside it.
//!    `border`: what passed over an edge in front of all else moves at least so far. `reprojection`: with the previous anchor's
//!    depth, and where the warp of the camera is known (see 4), none of that is a guess.
//! 4. `perspective`: what comes nearer moves faster on the screen. Where motion and depth of most of the picture are those of
//!    a world at rest, each claim has a phase of its own for t.
//!    `landing` once more: both go to phase t. Tiles are carried whole where that is smooth, pixel by pixel where
//!    surfaces meet, the nearest first; cracks are closed, and frame_keys nothing lands on are filled.
//! 5. `render`: both anchors are sampled by six pixels to a side at the displaced frame_keys. Where they agree, the nearer in time is
//!    taken as it is; where one does not show the surface, the other; where both do and differ, a mixture. A pixel beside
//!    what is in front goes with that if so the anchors agree better.
//!    `overlay`: what stands still in front of a moving world stays where it is. `foreign`: what only the previous anchor
//!    knows of is left out. `soften`: edges that depth does not tell are a little soft.
//! 6. `inpaint`: what neither shows takes the colours around it.
//!
//! Places, claims and samples of bytes are computed in whole numbers, the rest in single precision in one order without
//! fused steps, and every step settles conflicts by a total order: the result is the same to the bit for every number of
//! threads and every instruction set. `tests/reference.rs` describes it plainly, and is what all of them must equal.

mod border_foreground;
mod camera_fit;
mod colour;
mod colour_outlier;
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
mod splat;
mod splat_key;
mod static_mask;
mod static_overlay;
#[cfg(test)]
mod tests;

use border_foreground::BorderForeground;
use camera_fit::{CameraFit, Warp, WarpTime};
use colour::Colour;
use cut::CutDetector;
use field::FieldBuilder;
use hole_filling::{FillInputs, HoleFiller};
use inpaint::Inpainter;
use kernels::{SimdLevel, Source};
use key_buffer::KeyBuffer;
use letterbox::ActiveArea;
use render::Interpolation;
use reprojection::Reprojection;
use splat::{KeyOrigin, SplatPass, Splatter};
use splat_key::{HOLE, PHASE_ONE, PREVIOUS_ONLY};
use static_mask::StaticMask;
use static_overlay::StaticPixels;

use super::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome, Phases, pair::check_size};
use crate::tasks::PoolLease;
use crate::{Error, ErrorKind, Raster, Result};

/// Generates frames on the CPU, its rows in parallel, with the best instructions that the
/// processor has. Keeps working memory of about 45 bytes per pixel from call to call, and after the first allocates
/// nothing more until a picture of another size comes or more threads share its work.
#[derive(Debug)]
pub struct CpuGenerator {
    level: SimdLevel,
    cut: CutDetector,
    field_builder: FieldBuilder,
    field: KeyBuffer,
    previous_keys: KeyBuffer,
    frame_keys: KeyBuffer,
    splatter: Splatter,
    border: BorderForeground,
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
    /// A generator without working memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn at(level: SimdLevel) -> Self {
        Self {
            level,
            cut: CutDetector::default(),
            field_builder: FieldBuilder::default(),
            field: KeyBuffer::default(),
            previous_keys: KeyBuffer::default(),
            frame_keys: KeyBuffer::default(),
            splatter: Splatter::default(),
            border: BorderForeground::default(),
            hole_filler: HoleFiller::default(),
            static_pixels: StaticPixels::default(),
            inpainter: Inpainter::default(),
            hidden: Vec::new(),
            _threads: PoolLease::new(),
        }
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

    fn interpolated<P: Colour>(&mut self, pair: &AnchorPair<'_, P>, phase: i32, out: &mut Raster<P>) -> Result<f32> {
        let (previous, current) = (source(pair.previous()), source(pair.current()));
        let is_optical_flow = pair.guidance().origin().is_optical_flow();
        let active_area = ActiveArea::find(self.level, previous, current);
        let static_mask = StaticMask::new(Some(&active_area), pair.overlay(), current.width);
        self.field_builder.prepare(
            self.level,
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
            &[SplatPass { source: &self.field, warp, origin: KeyOrigin::Own }],
            &mut self.previous_keys,
        )?;
        let margin = colour_outlier::margin(previous, current);
        let camera = CameraFit::fit(pair.guidance(), &static_mask);
        let reprojection = Reprojection::new(&camera, pair.previous_depth(), pair.guidance().depth());
        match &reprojection {
            Some(reprojection) => reprojection.clear_occluded(self.level, &mut self.previous_keys, &self.field),
            None => self.border.detect(&mut self.previous_keys, previous, current, margin, is_optical_flow.into())?,
        }
        let border = if reprojection.is_none() { Some(&self.border) } else { None };
        let (picture, reprojection) = (Some(previous), reprojection.as_ref());
        let fill_inputs = FillInputs { field: &self.field, warp, picture, reprojection, border, tag: PREVIOUS_ONLY };
        let holes = self.hole_filler.fill(self.level, &mut self.previous_keys, &fill_inputs)?;

        let time = WarpTime::new(phase, camera.depth_change);
        let warp = Warp::from_current(time);
        let passes = [
            SplatPass { source: &self.field, warp, origin: KeyOrigin::Own },
            SplatPass { source: &self.previous_keys, warp: Warp::from_previous(time), origin: KeyOrigin::Inherited },
        ];
        self.splatter.splat(self.level, &passes[..if holes > 0 { 2 } else { 1 }], &mut self.frame_keys)?;
        let fill_inputs =
            FillInputs::<P> { field: &self.field, warp, picture: None, reprojection: None, border: None, tag: HOLE };
        self.hole_filler.fill(self.level, &mut self.frame_keys, &fill_inputs)?;

        resize(&mut self.hidden, grid.tiles(), 0)?;
        self.static_pixels.reserve(grid)?;
        let interpolation = Interpolation {
            level: self.level,
            previous,
            current,
            frame_keys: &self.frame_keys,
            field: &self.field,
            previous_keys: &self.previous_keys,
            phase,
            time,
            margin,
            static_pixels: &self.static_pixels,
            is_optical_flow,
        };
        let rendered = interpolation.render(out, &mut self.hidden);
        if rendered.hidden > 0 {
            self.inpainter.paint(grid, &self.hidden, out)?;
        }
        Ok(rendered.uncovered as f32 / (grid.width * grid.height) as f32)
    }

    fn extrapolated<P: Colour>(&mut self, anchor: &Anchor<'_, P>, phase: i32, out: &mut Raster<P>) -> Result<f32> {
        let current = source(anchor.picture());
        let static_mask = StaticMask::new(None, anchor.overlay(), current.width);
        self.field_builder.prepare::<P>(self.level, anchor.guidance(), None, static_mask, &mut self.field)?;
        let grid = self.field.grid;
        self.splatter.reserve(grid)?;
        self.inpainter.reserve(grid)?;
        let time = WarpTime::new(PHASE_ONE + phase, CameraFit::fit(anchor.guidance(), &static_mask).depth_change);
        let warp = Warp::from_current(time);
        self.splatter.splat(
            self.level,
            &[SplatPass { source: &self.field, warp, origin: KeyOrigin::Own }],
            &mut self.frame_keys,
        )?;
        let fill_inputs =
            FillInputs::<P> { field: &self.field, warp, picture: None, reprojection: None, border: None, tag: HOLE };
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
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a phase of {t} is not active_area (0, 1)"))
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
        let phase = ((t * PHASE_ONE as f32 + 0.5) as i32).clamp(1, PHASE_ONE - 1);
        let uncovered = self.interpolated(pair, phase, out)?;
        Ok(GenerateReport { outcome: Outcome::Generated, uncovered, unexplained })
    }

    fn extrapolate(&mut self, anchor: &Anchor<'_, P>, t: f32, out: &mut Raster<P>) -> Result<GenerateReport> {
        let picture = anchor.picture();
        check_size(out.size(), picture.size(), "out")?;
        if !(t > 0.0 && t.is_finite()) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("{t} intervals after an anchor"))
                .field("t")
                .remedy("SplatPass a positive number of anchor intervals"));
        }
        if anchor.is_after_cut() {
            out.pixels_mut().copy_from_slice(picture.pixels());
            return Ok(GenerateReport { outcome: Outcome::Held, uncovered: 0.0, unexplained: 0.0 });
        }
        let phase = ((t.min(1.0) * PHASE_ONE as f32 + 0.5) as i32).clamp(1, PHASE_ONE);
        let uncovered = self.extrapolated(anchor, phase, out)?;
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
fn resize<T: Clone>(buffer: &mut Vec<T>, len: usize, value: T) -> Result<()> {
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
