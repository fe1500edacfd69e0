//! Walks through scenes, finds motion with every source, and scores it and the generated frames against the truth.

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{Guidance, LatentView, MotionField};
use cairn::world::{ControlScript, Rollout};
use cairn::{Error, Picture, Result};
use scenes::Frame;
use scenes::camera::view_distance;

use super::sources::{ControlTracker, Depth, Extractors, MOTIONS, Motion, Pair, ROWS, Row};
use crate::experiment::{Bench, missing_frame};
use crate::metrics::Score;
use crate::progress::check_stop;
use crate::reconstruct::walk::{Walk, write_guidance};
use crate::scene_id::SceneId;

/// Anchors a second, and frames per anchor.
const RATE: [u32; 2] = [15, 2];
/// Anchors that end the scored intervals: every 1.85 seconds of the script, independent of its content.
const TARGETS: [u64; 8] = [14, 41, 69, 97, 125, 152, 180, 208];
/// Number of [`TARGETS`] used by `--quick`.
const FEW: usize = 2;
/// Number of earlier anchors decoded first, because the decoder has memory.
const BEFORE: u64 = 3;
/// Maximum end-point error in pixels of a motion that counts as near.
const NEAR: f64 = 1.0;

/// Source of the pictures at the ends of an interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchors {
    /// The renderer.
    Drawn,
    /// The renderer's pictures, encoded and decoded by the world's autoencoder.
    Decoded,
}

/// Error of a motion field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EndPoint {
    /// Mean end-point error in pixels, over pixels visible in both anchors.
    pub(super) mean: f64,
    /// Share of them with an error of at most one pixel.
    pub(super) near: f64,
}

/// Score of one frame of one row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Record {
    pub(super) scene: SceneId,
    pub(super) anchors: Anchors,
    pub(super) row: Row,
    /// The anchor that ends the interval.
    pub(super) anchor: u64,
    pub(super) end_point: EndPoint,
    pub(super) score: Score,
    /// Whether the generator detected a cut and showed the nearer anchor.
    pub(super) cut: bool,
}

/// Pictures of one interval, for the figure.
pub(super) struct IntervalPictures {
    pub(super) scene: SceneId,
    pub(super) anchor: u64,
    pub(super) truth: Picture,
    pub(super) rows: Vec<(Motion, MotionField, Picture)>,
}

/// The walks through the scenes.
pub(super) struct Walks<'a> {
    pub(super) bench: &'a Bench<'a>,
}

/// The two anchors of an interval, the true frame between them, and their guidance.
struct Interval {
    number: u64,
    frames: [Frame; 2],
    between: Picture,
    latents: [Vec<f32>; 2],
    decoded: [Picture; 2],
    /// True motion and depth of the second anchor, and of the first.
    truth: [Guidance; 2],
    controls: Guidance,
    /// Which pixels of the second anchor are visible in the first.
    seen: Vec<bool>,
}

impl Walks<'_> {
    fn targets(&self) -> &'static [u64] {
        if self.bench.quick { &TARGETS[..FEW] } else { &TARGETS }
    }

    /// Walks through a scene and passes its intervals on.
    fn walk(&self, scene: SceneId, each: &mut dyn FnMut(&Interval) -> Result<()>) -> Result<()> {
        let size = self.bench.world.render_size();
        let targets = self.targets();
        let frames = targets.iter().max().map_or(0, |last| last * u64::from(RATE[1])) + 1;
        let walk = Walk::new(scene.family, scene.seed, size, RATE, frames)?;
        let script = ControlScript::parse(scene.family.script())?;
        let start = walk.start().ok_or_else(missing_frame)?;
        let mut tracker = ControlTracker::new(script, start, RATE[0], size)?;
        let mut rollout = Rollout::new(self.bench.world, self.bench.point, scene.seed)?;
        let mut controls = walk.guidance()?;
        for &number in targets {
            check_stop(self.bench.stop)?;
            tracker.advance_to(number, &mut controls)?;
            each(&self.interval(&walk, number, &mut rollout, controls.clone())?)?;
        }
        Ok(())
    }

    fn interval(&self, walk: &Walk, number: u64, rollout: &mut Rollout, controls: Guidance) -> Result<Interval> {
        let anchor = |number| walk.anchor(number).ok_or_else(missing_frame);
        let frames = [anchor(number - 1)?, anchor(number)?];
        let middle = (number - 1) * u64::from(RATE[1]) + 1;
        let between = walk.truth(middle).ok_or_else(missing_frame)?;
        let mut truth = [walk.guidance()?, walk.guidance()?];
        truth.iter_mut().zip(&frames).for_each(|(truth, frame)| write_guidance(frame, truth));
        let mut latents = [Vec::new(), Vec::new()];
        let mut decoded = frames.each_ref().map(|frame| frame.picture.clone());
        rollout.reset()?;
        for n in number.saturating_sub(1 + BEFORE)..=number {
            let drawn = if n + 1 < number { Some(anchor(n)?) } else { None };
            let at = usize::from(n == number);
            let latent = rollout.encode(&drawn.as_ref().unwrap_or(&frames[at]).picture)?;
            rollout.append_latent(&latent)?;
            if drawn.is_none() {
                rollout.read_picture(self.bench.point.pictures_per_latent - 1, &mut decoded[at])?;
                latents[at] = latent;
            }
        }
        let seen = seen_in_both(&frames[1], &frames[0], frames[1].picture.size());
        Ok(Interval { number, frames, between, latents, decoded, truth, controls, seen })
    }

    /// The least-squares scale of the paper's extractor against the true motion, over the scenes' pixels.
    ///
    /// # Errors
    /// Errors of making latents; `Cancelled` when `stop` was set.
    pub(super) fn calibrate(&self, scenes: &[SceneId]) -> Result<f32> {
        let (mut product, mut square) = (0.0, 0.0);
        for &scene in scenes {
            self.bench.progress.phase(&format!("calibrating in {scene}"));
            let mut extractors = Extractors::new(0.0, self.bench.world.render_size())?;
            self.walk(scene, &mut |interval| {
                let paper = extractors.motion(Motion::Paper, &self.pair(interval, Anchors::Drawn)?)?;
                let both = paper.vectors().iter().zip(&interval.frames[1].motion).zip(&interval.seen);
                for ((found, truth), _) in both.filter(|(_, seen)| **seen) {
                    let [x, y] = found.map(f64::from);
                    product += x * f64::from(truth.x) + y * f64::from(truth.y);
                    square += x * x + y * y;
                }
                Ok(())
            })?;
        }
        let published = f64::from(cairn::guidance::paper::COMPRESSION);
        Ok(if square > 0.0 { (published * product / square) as f32 } else { 0.0 })
    }

    /// Scores every row in a scene.
    ///
    /// # Errors
    /// As [`calibrate`](Self::calibrate).
    pub(super) fn score(&self, scene: SceneId, scale: f32) -> Result<Vec<Record>> {
        let mut extractors = Extractors::new(scale, self.bench.world.render_size())?;
        let mut generator = CpuGenerator::new();
        let mut records = Vec::new();
        self.walk(scene, &mut |interval| {
            let features = self.bench.lpips.map(|lpips| Ok::<_, Error>((lpips, lpips.features(&interval.between)?)));
            let features = features.transpose()?;
            for anchors in [Anchors::Drawn, Anchors::Decoded] {
                let pair = self.pair(interval, anchors)?;
                for row in ROWS {
                    let motion = extractors.motion(row.motion, &pair)?;
                    let end_point = interval.end_point(&motion);
                    let (made, outcome) = interval.make(&mut generator, &mut extractors, row, motion, &pair)?;
                    let lpips = features.as_ref().map(|(lpips, truth)| lpips.distance_to(truth, &made)).transpose()?;
                    let score = Score::new(&interval.between, &made, lpips)?;
                    let cut = outcome == Outcome::CutFallback;
                    records.push(Record { scene, anchors, row, anchor: interval.number, end_point, score, cut });
                }
            }
            Ok(())
        })?;
        Ok(records)
    }

    /// Makes an interval with the renderer's anchors again, for the figure.
    ///
    /// # Errors
    /// As [`calibrate`](Self::calibrate).
    pub(super) fn pictures(&self, scene: SceneId, anchor: u64, scale: f32) -> Result<Option<IntervalPictures>> {
        let mut extractors = Extractors::new(scale, self.bench.world.render_size())?;
        let mut generator = CpuGenerator::new();
        let mut pictures = None;
        self.walk(scene, &mut |interval| {
            if interval.number != anchor {
                return Ok(());
            }
            let pair = self.pair(interval, Anchors::Drawn)?;
            let rows = ROWS.iter().take(MOTIONS.len()).map(|row| {
                let motion = extractors.motion(row.motion, &pair)?;
                let (made, _) = interval.make(&mut generator, &mut extractors, *row, motion.clone(), &pair)?;
                Ok((row.motion, motion, made))
            });
            let rows = rows.collect::<Result<_>>()?;
            pictures = Some(IntervalPictures { scene, anchor, truth: interval.between.clone(), rows });
            Ok(())
        })?;
        Ok(pictures)
    }

    fn pair<'a>(&self, interval: &'a Interval, anchors: Anchors) -> Result<Pair<'a>> {
        let shape = self.bench.world.manifest().geometry.latent;
        let [c, h, w] = [shape.channels, shape.height, shape.width].map(|n| n as usize);
        let [before, now] = &interval.latents;
        let pictures = match anchors {
            Anchors::Drawn => interval.frames.each_ref().map(|frame| &frame.picture),
            Anchors::Decoded => interval.decoded.each_ref(),
        };
        let latents = [LatentView::new(c, h, w, before)?, LatentView::new(c, h, w, now)?];
        Ok(Pair { pictures, latents, truth: &interval.truth[1], controls: &interval.controls })
    }
}

impl Interval {
    fn end_point(&self, found: &MotionField) -> EndPoint {
        let (mut sum, mut near, mut count) = (0.0, 0_u32, 0_u32);
        let all = found.vectors().iter().zip(&self.frames[1].motion).zip(&self.seen);
        for ((found, truth), _) in all.filter(|(_, seen)| **seen) {
            let [x, y] = found.map(f64::from);
            let off = (x - f64::from(truth.x)).hypot(y - f64::from(truth.y));
            sum += off;
            near += u32::from(off <= NEAR);
            count += 1;
        }
        let count = f64::from(count.max(1));
        EndPoint { mean: sum / count, near: f64::from(near) / count }
    }

    /// The frame in the middle, generated with `motion` and the depth of `row`.
    fn make(
        &self,
        generator: &mut CpuGenerator,
        extractors: &mut Extractors,
        row: Row,
        motion: MotionField,
        pair: &Pair<'_>,
    ) -> Result<(Picture, Outcome)> {
        let guidance = Guidance::from_parts(motion, extractors.depth(row.depth, pair)?, row.origin())?;
        let mut anchors = AnchorPair::new(pair.pictures[0], pair.pictures[1], &guidance)?;
        if row.depth == Depth::Truth {
            anchors = anchors.with_previous_depth(self.truth[0].depth())?;
        }
        let mut made = pair.pictures[1].clone();
        let report = generator.generate(&anchors, 0.5, &mut made)?;
        Ok((made, report.outcome))
    }
}

/// For each pixel of `current`, whether its point is visible in `previous`: the true motion ends inside the picture, and one of the four pixels
/// around the end point has the same distance, to within 5 % plus the walk of one anchor interval.
fn seen_in_both(current: &Frame, previous: &Frame, (width, height): (u32, u32)) -> Vec<bool> {
    let (width, height) = (width as usize, height as usize);
    let is_seen = |k: usize| {
        let motion = current.motion[k];
        let (x, y) = ((k % width) as f32 + motion.x, (k / width) as f32 + motion.y);
        if !(x >= 0.0 && y >= 0.0 && x.is_finite() && y.is_finite()) {
            return false;
        }
        let (left, top) = (x as usize, y as usize);
        if left + 1 >= width || top + 1 >= height {
            return false;
        }
        let now = view_distance(current.depth[k]);
        [0, 1, width, width + 1].iter().any(|step| {
            let before = view_distance(previous.depth[top * width + left + step]);
            (before - now).abs() <= 0.05 * now + 0.3
        })
    };
    (0..width * height).map(is_seen).collect()
}
