//! What each rule of the generator and of `picture_flow` gains: frames made without it, against frames made with all rules.
//!
//! Only what a rule changes is scored: where a frame is the same without it, its loss is zero.

mod page;
mod rules;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator};
use cairn::guidance::{Guidance, picture_flow};
use cairn::{Error, ErrorKind, Picture, Result};

use super::clips::{self, Clip, Phase, Scale};
use super::measure::{Truth, Unavailable, engine_guidance, guidance};
use super::rows::program::not_provided;
use super::store::Store;
use super::{net, open_lpips_of};
use crate::experiment::files::Files;
use crate::metrics::{Lpips, Score};
use crate::progress::Progress;
use crate::sets;
use rules::Rule;

/// The page's file name.
const PAGE: &str = "generator-rules.md";
/// Every rule's losses, clip by clip.
const TABLE: &str = "generator-rules.csv";
/// Scored intervals of a clip: every second one of those of the quality table.
const STRIDE: usize = 2;

/// Settings of the measurement, as texts from the command line.
#[derive(Debug, Clone)]
pub struct AblationSettings {
    /// The clips, as a list of names.
    pub clips: String,
    /// Scene seeds.
    pub seeds: Vec<u64>,
    /// The network of LPIPS: alex, vgg or none.
    pub lpips: String,
    /// Small clips, to see that everything works.
    pub smoke: bool,
    /// Also write the page into the repository's docs.
    pub publish: bool,
    /// The output folder.
    pub out: PathBuf,
}

impl AblationSettings {
    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument` for an unknown clip or network, and for a sealed clip or seed.
    pub fn check(&self) -> Result<()> {
        net(&self.lpips)?;
        sets::require_unsealed(&self.seeds, "--seeds")?;
        if clips::parse(&self.clips)?.is_empty() || self.seeds.is_empty() {
            return Err(Error::new(ErrorKind::InvalidArgument, "there is nothing to measure")
                .field("--clips")
                .remedy("Name clips and seeds"));
        }
        Ok(())
    }

    fn scale(&self) -> Scale {
        if self.smoke { Scale::Smoke } else { Scale::Full }
    }
}

/// Result of the measurement.
#[derive(Debug)]
pub struct AblationOutcome {
    /// The page.
    pub text: String,
    /// The written files.
    pub files: Vec<PathBuf>,
    /// Clips that are not available, with the reason.
    pub left_out: Vec<String>,
}

/// Motion and depth that a frame is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Input {
    /// Optical flow between the anchors.
    Flow,
    /// Motion and depth as an engine gives them.
    Engine,
    /// True motion and depth, the previous anchor's depth, and the mask of a head-up display where there is one.
    Truth,
    /// True motion and depth alone.
    Alone,
}

impl Input {
    const ALL: [Self; 4] = [Self::Flow, Self::Engine, Self::Truth, Self::Alone];

    fn label(self) -> &'static str {
        match self {
            Self::Flow => "of `picture_flow`",
            Self::Engine => "of an engine",
            Self::Truth => "true",
            Self::Alone => "true, without mask and previous depth",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Flow => "flow",
            Self::Engine => "engine",
            Self::Truth => "truth",
            Self::Alone => "alone",
        }
    }
}

/// What is lost without a rule in one frame, and the time that it takes.
#[derive(Debug, Clone, PartialEq)]
struct Loss {
    rule: Rule,
    input: Input,
    clip: String,
    /// dB, SSIM and LPIPS; positive where the frame is worse without the rule.
    lost: [f64; 3],
    /// Time with the rule over time without it, motion's extraction included where that is the rule's.
    time: f64,
}

/// Everything that a frame is made from besides the anchors.
struct FrameInputs<'a> {
    guidance: &'a Guidance,
    before: Option<&'a Guidance>,
    overlay: Option<&'a [u8]>,
}

/// A generator, and the working memory of the extraction that it follows, if that lacks a rule.
struct Variant {
    rule: Rule,
    generator: CpuGenerator,
    extractor: Option<picture_flow::Extractor>,
}

impl Variant {
    fn new(rule: Rule) -> Self {
        let (generator, extractor) = (CpuGenerator::new(), picture_flow::Extractor::new());
        match rule {
            Rule::Generator(left_out) => Self { rule, generator: generator.without(left_out), extractor: None },
            Rule::Flow(left_out) => Self { rule, generator, extractor: Some(extractor.without(left_out)) },
        }
    }
}

/// Makes the frames, and writes the page.
///
/// # Errors
/// Invalid settings, no clip at all, a full disk, `Cancelled` where `stop` is set.
pub fn ablate(settings: &AblationSettings, progress: &Progress, stop: &AtomicBool) -> Result<AblationOutcome> {
    settings.check()?;
    // Before the work of minutes: it fails where the sources are not at hand.
    let lines = Rule::all().into_iter().map(Rule::lines).collect::<Result<Vec<_>>>()?;
    let cache = provision::cache_dir().map_err(|e| not_provided(&e))?;
    let store = Store::new(cache.join("quality"), true);
    progress.phase("opening clips");
    let lpips = net(&settings.lpips)?.map(|net| open_lpips_of(net, !settings.smoke, progress)).transpose()?;
    let (mut open, mut left_out) = (Vec::new(), Vec::new());
    for kind in clips::parse(&settings.clips)? {
        match kind.open(&settings.seeds, settings.scale(), progress) {
            Ok(clips) => open.extend(clips),
            Err(error) => left_out.push(Unavailable { name: kind.name(), why: error.to_string() }.to_string()),
        }
    }
    if open.is_empty() {
        return Err(Error::new(ErrorKind::Unsupported, format!("no clip is left: {}", left_out.join("; "))));
    }
    let losses = measure(&mut open, lpips.as_ref(), &store, progress, stop)?;
    let text = page::text(settings, &losses, &lines, &open, &left_out);
    let mut files = Files::default();
    files.add(PAGE, text.clone());
    files.add(TABLE, page::csv(&losses));
    let mut written = files.write(&settings.out)?;
    if settings.publish {
        written.extend(files.publish(&[PAGE], None)?);
    }
    Ok(AblationOutcome { text, files: written, left_out })
}

/// The losses of every rule in every scored frame.
fn measure(
    open: &mut [Box<dyn Clip>],
    lpips: Option<&Lpips>,
    store: &Store,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<Vec<Loss>> {
    let mut variants: Vec<Variant> = Rule::all().into_iter().map(Variant::new).collect();
    let (mut generator, mut extractor) = (CpuGenerator::new(), picture_flow::Extractor::new());
    let intervals: usize = open.iter().map(|clip| clip.targets().len().div_ceil(STRIDE)).sum();
    progress.begin(intervals as u64);
    let (mut losses, mut done) = (Vec::new(), 0);
    for clip in open {
        let clip = clip.as_mut();
        let ends: Vec<usize> = clip.targets().iter().step_by(STRIDE).map(|target| target.anchor).collect();
        for end in ends {
            let anchors = [clip.anchor(end - 1, store)?, clip.anchor(end, store)?];
            let truth = Truth::new(clip, end, Phase::HALF, store)?;
            let overlay = clip.overlay(end, store)?;
            let (flow, extraction) = extract(&mut extractor, &anchors)?;
            let [engine, exact] = [engine_guidance(clip, end)?, guidance(clip, end, store)?];
            for input in Input::ALL {
                let [before, current] = match input {
                    Input::Flow => [None, Some(&flow)],
                    Input::Engine => engine.each_ref().map(Option::as_ref),
                    Input::Truth => exact.each_ref().map(Option::as_ref),
                    Input::Alone => [None, exact[1].as_ref()],
                };
                let Some(guidance) = current else { continue };
                let overlay = overlay.as_deref().filter(|_| matches!(input, Input::Engine | Input::Truth));
                let given = FrameInputs { guidance, before, overlay };
                let (made, _) = given.make(&mut generator, &anchors)?;
                let score = truth.score(made.clone(), lpips)?;
                for variant in &mut variants {
                    if stop.load(Ordering::SeqCst) {
                        return Err(Error::new(ErrorKind::Cancelled, "interrupted"));
                    }
                    if variant.extractor.is_some() && input != Input::Flow {
                        continue;
                    }
                    // Beside each other, so that the machine's load is the same for both.
                    let (_, with) = given.make(&mut generator, &anchors)?;
                    let (other, time) = match &mut variant.extractor {
                        None => {
                            let (other, without) = given.make(&mut variant.generator, &anchors)?;
                            (other, with / without)
                        }
                        Some(extractor) => {
                            let (found, took) = extract(extractor, &anchors)?;
                            let given = FrameInputs { guidance: &found, ..given };
                            let (other, without) = given.make(&mut variant.generator, &anchors)?;
                            (other, (extraction + with) / (took + without))
                        }
                    };
                    let without = if other == made { score } else { truth.score(other, lpips)? };
                    let lost = lost(&score, &without);
                    losses.push(Loss { rule: variant.rule, input, clip: clip.name().into(), lost, time });
                }
            }
            done += 1;
            progress.frames(done);
        }
    }
    progress.end();
    Ok(losses)
}

/// Optical flow between two anchors, and the seconds that it takes.
fn extract(extractor: &mut picture_flow::Extractor, anchors: &[Picture; 2]) -> Result<(Guidance, f64)> {
    let (width, height) = anchors[1].size();
    let mut found = Guidance::new(width, height, picture_flow::PROJECTION)?;
    let start = Instant::now();
    extractor.extract(&anchors[0], &anchors[1], &mut found)?;
    Ok((found, start.elapsed().as_secs_f64()))
}

impl FrameInputs<'_> {
    /// The frame in the middle, and the seconds that it takes.
    fn make(&self, generator: &mut CpuGenerator, anchors: &[Picture; 2]) -> Result<(Picture, f64)> {
        let mut pair = AnchorPair::new(&anchors[0], &anchors[1], self.guidance)?;
        if let Some(before) = self.before {
            pair = pair.with_previous_depth(before.depth())?;
        }
        if let Some(overlay) = self.overlay {
            pair = pair.with_overlay(overlay)?;
        }
        let mut out = Picture::new(pair.size().0, pair.size().1)?;
        let start = Instant::now();
        generator.generate(&pair, Phase::HALF.value(), &mut out)?;
        Ok((out, start.elapsed().as_secs_f64()))
    }
}

/// Loss of PSNR, SSIM and LPIPS by leaving rules out; NaN for an LPIPS that was not measured.
fn lost(with: &Score, without: &Score) -> [f64; 3] {
    let lpips = with.lpips.zip(without.lpips).map_or(f64::NAN, |(with, without)| without - with);
    [with.psnr - without.psnr, with.ssim - without.ssim, lpips]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worse_frame_is_a_loss_in_every_measure() {
        let score = |psnr, ssim, lpips| Score { psnr, ssim, lpips: Some(lpips) };
        let found = lost(&score(30.0, 0.9, 0.1), &score(29.0, 0.8, 0.25));
        assert!(found.iter().zip([1.0, 0.1, 0.15]).all(|(found, lost)| (found - lost).abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn frames_change_without_rules_that_their_input_meets() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(folder.path().to_owned(), false);
        let mut clips: Vec<Box<dyn Clip>> =
            vec![Box::new(clips::SceneClip::moving(scenes::Family::Forest, 4, Scale::Smoke).unwrap())];
        let losses = measure(&mut clips, None, &store, &Progress::quiet(), &AtomicBool::new(false)).unwrap();
        let changes = |rule: Rule, input| {
            let found: Vec<&Loss> = losses.iter().filter(|loss| loss.rule == rule && loss.input == input).collect();
            assert!(found.len() <= 1 && found.iter().all(|loss| loss.time > 0.0 && loss.lost[2].is_nan()));
            found.first().is_some_and(|loss| loss.lost[0] != 0.0)
        };
        use cairn::framegen::cpu::Rule as G;
        use cairn::guidance::picture_flow::Rule as F;
        for rule in [G::CrackClosing, G::ForegroundEdges, G::PreviousDepth, G::CameraFit] {
            assert!(changes(Rule::Generator(rule), Input::Truth), "{rule:?}");
        }
        for rule in [G::MatchAsDepth, G::EdgeAntialiasing, G::FillByLikeness] {
            assert!(changes(Rule::Generator(rule), Input::Flow), "{rule:?}");
        }
        for rule in [F::RepeatedSearch, F::ConsistencyCheck] {
            assert!(changes(Rule::Flow(rule), Input::Flow), "{rule:?}");
        }
        // There is no cut, depth orders surfaces, and motion that is given is not searched for.
        assert!(!changes(Rule::Generator(G::CutDetection), Input::Truth));
        assert!(!changes(Rule::Generator(G::MatchAsDepth), Input::Truth));
        assert!(losses.iter().all(|loss| loss.input == Input::Flow || matches!(loss.rule, Rule::Generator(_))));
    }

    #[test]
    fn sealed_clips_and_seeds_are_refused() {
        let settings = |clips: &str, seed| AblationSettings {
            clips: clips.into(),
            seeds: vec![seed],
            lpips: "none".into(),
            smoke: true,
            publish: false,
            out: PathBuf::new(),
        };
        assert!(settings("forest", 4).check().is_ok());
        for settings in [settings("forest", 901), settings("none", 4), settings("forrest", 4)] {
            assert_eq!(settings.check().unwrap_err().kind(), ErrorKind::InvalidArgument);
        }
    }
}
