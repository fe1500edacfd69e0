//! One walk three times: as it is, as the world makes it from the first picture and the controls, and as if nothing moved.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::guidance::{Guidance, paper, picture_flow};
use cairn::world::{ControlScript, OperatingPoint, Rollout, World, WorldTime};
use cairn::{Error, ErrorKind, Picture, Result};
use scenes::{Clip, ClipOptions, Frame, Scene};

use super::endurance::PictureStatistics;
use super::response::Response;
use crate::metrics::{Lpips, Score, psnr, ssim};
use crate::progress::check_stop;
use crate::scene_id::SceneId;

/// Scores a picture; equal pictures have an infinite PSNR.
fn score(truth: &Picture, picture: &Picture, lpips: Option<&Lpips>) -> Result<Score> {
    let lpips = lpips.map(|lpips| lpips.compare(truth, picture)).transpose()?;
    Ok(Score { psnr: psnr(truth, picture)?, ssim: ssim(truth, picture)?, lpips })
}

/// Scores at one horizon of a walk.
#[derive(Debug, Clone)]
pub(super) struct Horizon {
    /// World time since the last true picture, in seconds.
    pub(super) seconds: f64,
    pub(super) world: Score,
    /// Score of repeating the last true picture.
    pub(super) repeat: Score,
    /// Score of the autoencoder's reconstruction of the last true picture.
    pub(super) reconstruction: Score,
    pub(super) truth_picture: Picture,
    pub(super) picture: Picture,
}

/// Result of one walk.
#[derive(Debug, Clone)]
pub(super) struct WalkScores {
    pub(super) horizons: Vec<Horizon>,
    /// One per latent step.
    pub(super) responses: Vec<Response>,
    /// Global properties of every picture from the first on: the world's and the truth's.
    pub(super) statistics: Vec<[PictureStatistics; 2]>,
}

/// A scene and the settings of the walk through it.
pub(super) struct Walk<'a> {
    pub(super) scene: SceneId,
    pub(super) script: &'a ControlScript,
    /// Length of the walk in seconds of world time.
    pub(super) seconds: f64,
}

/// Settings and tools for all walks.
#[derive(Clone, Copy)]
pub(super) struct Tools<'a> {
    pub(super) point: &'a OperatingPoint,
    pub(super) lpips: Option<&'a Lpips>,
    pub(super) stop: &'a AtomicBool,
}

/// The latent step nearest to the given time.
pub(super) fn step_at(point: &OperatingPoint, seconds: f64) -> u64 {
    (seconds * f64::from(point.latents_per_second)).round() as u64
}

impl Walk<'_> {
    /// The true walk with one frame per latent step, and a rollout that starts from its first picture, which is rendered here.
    fn start<'s>(
        &'s self,
        scene: &'s Scene,
        world: &Arc<World>,
        point: &OperatingPoint,
    ) -> Result<(Clip<'s>, Rollout, Picture)> {
        let ((width, height), rate) = (world.render_size(), point.latents_per_second);
        let options = ClipOptions { width, height, rate, ..ClipOptions::default() };
        let mut truth = Clip::new(scene, self.script, options).ok_or_else(|| {
            Error::new(ErrorKind::InvalidArgument, format!("a scene cannot be walked at {rate} frames a second"))
        })?;
        let first = truth.frame()?.picture;
        let mut rollout = Rollout::new(world, point, self.scene.seed)?;
        rollout.append(&first)?;
        Ok((truth, rollout, first))
    }

    /// Runs the walk and scores it. Horizons after the end of the walk are left out.
    ///
    /// # Errors
    /// Errors of making latents; `Cancelled` when `tools.stop` was set.
    pub(super) fn score(&self, world: &Arc<World>, tools: &Tools<'_>, horizons: &[f64]) -> Result<WalkScores> {
        let point = tools.point;
        let scene = Scene::new(self.scene.family, self.scene.seed);
        let (mut truth, mut rollout, first) = self.start(&scene, world, point)?;
        let last = point.pictures_per_latent - 1;
        let mut before = first.clone();
        rollout.read_picture(last, &mut before)?;
        let reconstruction = before.clone();

        let (width, height) = world.render_size();
        let mut guidance = Guidance::new(width, height, paper::PROJECTION)?;
        let mut flow = picture_flow::Extractor::new();
        let mut walked = WalkScores { horizons: Vec::new(), responses: Vec::new(), statistics: Vec::new() };
        walked.statistics.push([PictureStatistics::of(&before)?, PictureStatistics::of(&first)?]);
        let mut picture = before.clone();
        for q in 1..=step_at(point, self.seconds) {
            check_stop(tools.stop)?;
            step(&mut rollout, self.script, point, q)?;
            rollout.read_picture(last, &mut picture)?;
            let Frame { picture: true_picture, motion, .. } = truth.frame()?;
            flow.extract(&before, &picture, &mut guidance)?;
            let seen = guidance.motion().vectors().iter().map(|[x, y]| [f64::from(x.to_f32()), f64::from(y.to_f32())]);
            let meant = motion.iter().map(|m| [f64::from(m.x), f64::from(m.y)]);
            walked.responses.push(Response::new(seen, meant));
            walked.statistics.push([PictureStatistics::of(&picture)?, PictureStatistics::of(&true_picture)?]);
            for &seconds in horizons.iter().filter(|&&seconds| step_at(point, seconds) == q) {
                walked.horizons.push(Horizon {
                    seconds,
                    world: score(&true_picture, &picture, tools.lpips)?,
                    repeat: score(&true_picture, &first, tools.lpips)?,
                    reconstruction: score(&true_picture, &reconstruction, tools.lpips)?,
                    truth_picture: true_picture.clone(),
                    picture: picture.clone(),
                });
            }
            std::mem::swap(&mut before, &mut picture);
        }
        Ok(walked)
    }

    /// Runs the walk. Returns the world's picture and the true one after each of the steps `at`, which must be ascending.
    ///
    /// # Errors
    /// As [`score`](Self::score).
    pub(super) fn pictures(&self, world: &Arc<World>, tools: &Tools<'_>, at: &[u64]) -> Result<Vec<[Picture; 2]>> {
        let point = tools.point;
        let scene = Scene::new(self.scene.family, self.scene.seed);
        let (mut truth, mut rollout, first) = self.start(&scene, world, point)?;
        let mut kept = Vec::new();
        for q in 0..=at.last().copied().unwrap_or(0) {
            check_stop(tools.stop)?;
            if q > 0 {
                step(&mut rollout, self.script, point, q)?;
            }
            if !at.contains(&q) {
                // Advances without rendering. The first frame was rendered already.
                if q > 0 {
                    truth.advance()?;
                }
                continue;
            }
            let mut picture = first.clone();
            rollout.read_picture(point.pictures_per_latent - 1, &mut picture)?;
            kept.push([picture, if q == 0 { first.clone() } else { truth.frame()?.picture }]);
        }
        Ok(kept)
    }
}

/// Makes latent `q` with the controls of its time span.
fn step(rollout: &mut Rollout, script: &ControlScript, point: &OperatingPoint, q: u64) -> Result<()> {
    let (start, end): (WorldTime, WorldTime) = point.span_of_latent(q);
    rollout.step(&script.span(start, end)?).map(drop)
}
