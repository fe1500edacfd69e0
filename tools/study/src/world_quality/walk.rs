//! One walk three times: as it is, as the world makes it from the first picture and the controls, and as if nothing moved.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::guidance::{Guidance, paper, picture_flow};
use cairn::world::{ControlScript, OperatingPoint, Rollout, World, WorldTime};
use cairn::{Picture, Result};
use glam::Vec2;
use scenes::{ClipFrame, Frame, LANDSCAPES, Moment};
use serde::{Deserialize, Serialize};

use super::endurance::PictureStatistics;
use super::gallery::{Gallery, PATCH_COUNT, Pose, SIZE, patch};
use super::memory::MemoryScore;
use super::place::{Course, Recognised, TestWalk, kind};
use super::probe::Probe;
use super::response::{MeanMotion, Response};
use crate::metrics::{Lpips, Score};
use crate::picture::shrink;
use crate::progress::{Progress, check_stop};

/// Horizons in seconds after the last true picture at which pictures are scored and shown.
pub(super) const HORIZONS: [f64; 7] = [0.5, 1.0, 2.0, 5.0, 15.0, 30.0, 60.0];
/// Horizons in seconds at which the pose is searched for.
const POSE_HORIZONS: [f64; 3] = [5.0, 15.0, 60.0];
/// Latent steps from one picture that is classified to the next.
pub(super) const SAMPLING: u64 = 5;

/// Scores at one horizon of a walk.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Horizon {
    /// World time since the last true picture, in seconds.
    pub(super) seconds: f64,
    pub(super) world: Score,
    /// Score of repeating the last true picture.
    pub(super) repeat: Score,
    /// Score of the autoencoder's reconstruction of the last true picture.
    pub(super) reconstruction: Score,
}

/// What the classifiers and the network say about a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Sample {
    /// Latent step, from 1.
    pub(super) step: u64,
    /// Of the world's picture, and of the true one.
    pub(super) recognised: [Recognised; 2],
    /// Patch in which the true walker is.
    pub(super) patch: usize,
    /// Channel means of LPIPS's network for the world's picture and the true one, in units of 1/65535.
    pub(super) features: [Vec<u16>; 2],
}

/// Where the world's picture is, by the true pose whose picture is nearest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct PoseScore {
    /// World time since the last true picture, in seconds.
    pub(super) seconds: f64,
    /// Metres and degrees from the commanded walk to the pose found for the world's picture.
    pub(super) world: [f64; 2],
    /// The same for the true picture: the search's own error.
    pub(super) truth: [f64; 2],
    /// From the commanded walk to its start.
    pub(super) repeat: [f64; 2],
    /// PSNR in dB of the world's picture against the true picture of the pose found for it, and of the true picture likewise.
    pub(super) psnr: [f64; 2],
}

/// Result of one walk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct WalkScores {
    pub(super) horizons: Vec<Horizon>,
    /// World's pictures with the stock schedule.
    pub(super) few_steps: Vec<(f64, Score)>,
    /// One per latent step.
    pub(super) responses: Vec<Response>,
    /// Global properties of every picture from the first on: the world's and the truth's.
    pub(super) statistics: Vec<[PictureStatistics; 2]>,
    /// Those of the first true picture and of its reconstruction.
    pub(super) still: [PictureStatistics; 2],
    /// What the first true picture and its reconstruction are taken for; `None` without classifiers.
    pub(super) still_recognised: Option<[Recognised; 2]>,
    pub(super) samples: Vec<Sample>,
    pub(super) poses: Vec<PoseScore>,
    pub(super) remembered: Vec<MemoryScore>,
}

impl WalkScores {
    /// A walk without steps, of pictures that all look like `still`.
    #[cfg(test)]
    pub(super) fn empty(still: PictureStatistics) -> Self {
        Self {
            horizons: Vec::new(),
            few_steps: Vec::new(),
            responses: Vec::new(),
            statistics: Vec::new(),
            still: [still; 2],
            still_recognised: None,
            samples: Vec::new(),
            poses: Vec::new(),
            remembered: Vec::new(),
        }
    }
}

/// The world's picture above which stands the true one, at each of the walk's horizons.
pub(super) type Shown = Vec<[Picture; 2]>;

/// Settings and tools for all walks.
#[derive(Clone, Copy)]
pub(super) struct Tools<'a> {
    pub(super) point: &'a OperatingPoint,
    pub(super) lpips: Option<&'a Lpips>,
    pub(super) judges: &'a Judges,
    pub(super) stop: &'a AtomicBool,
}

/// Galleries of all levels, and classifiers that learnt from them.
pub(super) struct Judges {
    /// In the order of [`LANDSCAPES`].
    galleries: Vec<Gallery>,
    /// The kind of place, and for each level the patch; `None` without LPIPS's network.
    probes: Option<(Probe, Vec<Probe>)>,
}

impl Judges {
    /// Renders the galleries, with a grid of positions `spacing` times as sparse as usual, and trains the classifiers.
    ///
    /// # Errors
    /// As [`Gallery::new`] and [`Probe::train`]; `Cancelled` when `stop` was set.
    pub(super) fn new(lpips: Option<&Lpips>, spacing: f32, progress: &Progress, stop: &AtomicBool) -> Result<Self> {
        let (mut galleries, mut features) = (Vec::new(), Vec::new());
        for family in LANDSCAPES {
            check_stop(stop)?;
            progress.phase(&format!("true pictures from everywhere in the level of {family}"));
            let (gallery, of_level) = Gallery::new(family, lpips, spacing)?;
            galleries.push(gallery);
            features.push(of_level);
        }
        if lpips.is_none() {
            return Ok(Self { galleries, probes: None });
        }
        let all: Vec<&[f32]> = features.iter().flatten().map(Vec::as_slice).collect();
        let kinds = features.iter().enumerate().flat_map(|(kind, of_level)| of_level.iter().map(move |_| kind));
        let kinds: Vec<usize> = kinds.collect();
        let kind = Probe::train(&all, &kinds, LANDSCAPES.len())?;
        let patches = galleries.iter().zip(&features).map(|(gallery, of_level)| {
            let rows: Vec<&[f32]> = of_level.iter().map(Vec::as_slice).collect();
            Probe::train(&rows, &gallery.patches(), PATCH_COUNT)
        });
        let patches = patches.collect::<Result<_>>()?;
        Ok(Self { galleries, probes: Some((kind, patches)) })
    }

    /// What a picture of `place` is taken for; `None` without classifiers.
    fn recognise(&self, place: TestWalk, picture: &Picture, lpips: Option<&Lpips>) -> Result<Option<Recognised>> {
        let (Some((kinds, patches)), Some(lpips)) = (&self.probes, lpips) else { return Ok(None) };
        let features = lpips.channel_means(&shrink(picture, SIZE)?)?;
        let patch = match place {
            TestWalk::Level(family, _) => patches[kind(family)].classify(&features),
            TestWalk::Unseen(..) => 0,
        };
        Ok(Some(Recognised { kind: kinds.classify(&features), patch }))
    }
}

/// The latent step nearest to the given time.
pub(super) fn step_at(point: &OperatingPoint, seconds: f64) -> u64 {
    (seconds * f64::from(point.latents_per_second)).round() as u64
}

/// Position, direction and tilt of a walker.
fn pose_of(moment: &Moment) -> Pose {
    let camera = moment.camera;
    Pose { at: Vec2::new(camera.position.x, camera.position.z), yaw: camera.yaw, pitch: camera.pitch }
}

/// A rollout of a walk that starts from its first picture.
pub(super) fn begin(place: TestWalk, first: &Picture, world: &Arc<World>, point: &OperatingPoint) -> Result<Rollout> {
    let mut rollout = Rollout::new(world, point, place.noise())?;
    rollout.append(first)?;
    Ok(rollout)
}

/// The world's latest picture.
pub(super) fn picture_of(rollout: &mut Rollout, world: &World, point: &OperatingPoint) -> Result<Picture> {
    let (width, height) = world.render_size();
    let mut picture = Picture::new(width, height)?;
    rollout.read_picture(point.pictures_per_latent - 1, &mut picture)?;
    Ok(picture)
}

/// Makes latent `q` with the controls of its time span.
pub(super) fn step(rollout: &mut Rollout, script: &ControlScript, point: &OperatingPoint, q: u64) -> Result<()> {
    let (start, end): (WorldTime, WorldTime) = point.span_of_latent(q);
    rollout.step(&script.span(start, end)?).map(drop)
}

/// Runs `seconds` of a walk and scores it. Horizons after the end of the walk are left out.
///
/// # Errors
/// Errors of making latents; `Cancelled` when `tools.stop` was set.
pub(super) fn score(
    place: TestWalk,
    course: &Course,
    seconds: f64,
    world: &Arc<World>,
    tools: &Tools<'_>,
) -> Result<(WalkScores, Shown)> {
    let (point, lpips) = (tools.point, tools.lpips);
    let size = world.render_size();
    let mut truth = course.clip(size, point.latents_per_second)?;
    let ClipFrame { frame: Frame { picture: first, .. }, now, .. } = truth.next_frame()?;
    let start = pose_of(&now);
    let mut rollout = begin(place, &first, world, point)?;
    let reconstruction = picture_of(&mut rollout, world, point)?;
    let mut before = reconstruction.clone();

    let mut guidance = Guidance::new(size.0, size.1, paper::PROJECTION)?;
    let mut flow = picture_flow::Extractor::new();
    let still = [&first, &reconstruction].map(PictureStatistics::of);
    let recognise = |picture: &Picture| tools.judges.recognise(place, picture, lpips);
    let mut walked = WalkScores {
        horizons: Vec::new(),
        few_steps: Vec::new(),
        responses: Vec::new(),
        statistics: vec![[still[1], still[0]]],
        still,
        still_recognised: recognise(&first)?.zip(recognise(&reconstruction)?).map(<[Recognised; 2]>::from),
        samples: Vec::new(),
        poses: Vec::new(),
        remembered: Vec::new(),
    };
    let mut shown = Vec::new();
    let compare = |truth: &Picture, picture: &Picture| {
        Score::new(truth, picture, lpips.map(|lpips| lpips.compare(truth, picture)).transpose()?)
    };
    let is_at = |horizon: &f64, q: u64| step_at(point, *horizon) == q;
    for q in 1..=step_at(point, seconds) {
        check_stop(tools.stop)?;
        step(&mut rollout, &course.script, point, q)?;
        let picture = picture_of(&mut rollout, world, point)?;
        let ClipFrame { frame: Frame { picture: true_picture, motion, .. }, now, .. } = truth.next_frame()?;
        let pose = pose_of(&now);
        flow.extract(&before, &picture, &mut guidance)?;
        let seen = guidance.motion().vectors().iter().map(|[x, y]| [f64::from(x.to_f32()), f64::from(y.to_f32())]);
        let meant = motion.iter().map(|m| [f64::from(m.x), f64::from(m.y)]);
        walked.responses.push(Response { seen: MeanMotion::new(seen, size), meant: MeanMotion::new(meant, size) });
        walked.statistics.push([&picture, &true_picture].map(PictureStatistics::of));
        if q.is_multiple_of(SAMPLING)
            && let Some(lpips) = lpips
            && let (Some(made), Some(real)) = (recognise(&picture)?, recognise(&true_picture)?)
        {
            let features =
                [quantised(&lpips.channel_means(&picture)?), quantised(&lpips.channel_means(&true_picture)?)];
            walked.samples.push(Sample { step: q, recognised: [made, real], patch: patch(pose.at), features });
        }
        for &seconds in HORIZONS.iter().filter(|horizon| is_at(horizon, q)) {
            walked.horizons.push(Horizon {
                seconds,
                world: compare(&true_picture, &picture)?,
                repeat: compare(&true_picture, &first)?,
                reconstruction: compare(&true_picture, &reconstruction)?,
            });
            shown.push([true_picture.clone(), picture.clone()]);
        }
        let gallery = match place {
            TestWalk::Level(family, _) => Some(&tools.judges.galleries[kind(family)]),
            TestWalk::Unseen(..) => None,
        };
        if let (Some(gallery), Some(&seconds)) = (gallery, POSE_HORIZONS.iter().find(|horizon| is_at(horizon, q))) {
            let [made, real] = [&picture, &true_picture].map(|picture| {
                let found = gallery.nearest_pose(picture)?;
                let psnr = compare_psnr(&gallery.picture(&found, size), picture)?;
                Ok::<_, cairn::Error>((found.error(&pose), psnr))
            });
            let ((world, made), (truth, real)) = (made?, real?);
            walked.poses.push(PoseScore { seconds, world, truth, repeat: start.error(&pose), psnr: [made, real] });
        }
        before = picture;
    }
    Ok((walked, shown))
}

fn compare_psnr(truth: &Picture, picture: &Picture) -> Result<f64> {
    Ok(Score::new(truth, picture, None)?.psnr)
}

/// Runs the first `seconds` of a walk with the operating point of `tools`. Returns the score of the world's picture at each horizon.
///
/// # Errors
/// As [`score`].
pub(super) fn scores_alone(
    place: TestWalk,
    course: &Course,
    seconds: f64,
    world: &Arc<World>,
    tools: &Tools<'_>,
) -> Result<Vec<(f64, Score)>> {
    let point = tools.point;
    let mut truth = course.clip(world.render_size(), point.latents_per_second)?;
    let first = truth.frame()?.picture;
    let mut rollout = begin(place, &first, world, point)?;
    let horizons: BTreeMap<u64, f64> = HORIZONS.iter().map(|seconds| (step_at(point, *seconds), *seconds)).collect();
    let mut scores = Vec::new();
    for q in 1..=step_at(point, seconds) {
        check_stop(tools.stop)?;
        step(&mut rollout, &course.script, point, q)?;
        let Some(&seconds) = horizons.get(&q) else {
            truth.advance()?;
            continue;
        };
        let (real, made) = (truth.frame()?.picture, picture_of(&mut rollout, world, point)?);
        let lpips = tools.lpips.map(|lpips| lpips.compare(&real, &made)).transpose()?;
        scores.push((seconds, Score::new(&real, &made, lpips)?));
    }
    Ok(scores)
}

/// Features of 0 to 1 in units of 1/65535.
fn quantised(features: &[f32]) -> Vec<u16> {
    features.iter().map(|value| (value.clamp(0.0, 1.0) * 65535.0).round() as u16).collect()
}
