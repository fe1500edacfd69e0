//! Floors: two dozen fixed frames may not become worse than the committed scores.
//!
//! The table of [`quality`](super) takes many minutes and other programs; the floors take two or three, so that every change of the generator is held
//! against them. Their scenes have the seed that the generator is tuned on: they show that quality was lost, not how good it is.

mod footage;

use std::fmt;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::{Error, ErrorKind, Picture, Result};

use super::claims::MEASURES;
use super::clips::{Clip, Phase, Scale, SceneClip};
use super::measure::{Record, guidance};
use super::published::Evidence;
use super::rows::{Interval, Kind, program::not_provided};
use super::store::Store;
use super::table::{Table, is_better, measures};
use super::{figure, open_lpips_of, published};
use crate::experiment::files::write_all;
use crate::metrics::Score;
use crate::picture::paste;
use crate::progress::Progress;
use footage::FOOTAGE;
use media::{describe_io, encode_png};

/// The committed scores, relative to the repository's root.
const FILE: &str = "tools/study/floors.csv";
/// Its first line.
const HEAD: &str = "frame,row,least_psnr,least_ssim,greatest_lpips";
/// Scene seed for tuning the generator.
const SEED: u64 = 4;
/// The phase of the scored frame in each of a clip's intervals. Phases other than the middle show motion that is applied to the wrong side.
const PHASES: [Phase; 3] = [Phase::HALF, Phase::QUARTER, Phase::THREE_QUARTERS];
/// Rows that are measured: those with floors, and those that the claims compare them with.
const ROWS: [Kind; 4] = [Kind::Repeat, Kind::Blend, Kind::Flow, Kind::Truth];
/// Inputs of the landscapes' frames, with the rows that make them.
const LANDSCAPE_INPUTS: [Input; 2] = [Input::Flow, Input::Truth];
/// How much worse than the written score a frame may be: PSNR in dB, SSIM, LPIPS. For other systems' sine and cosine, which the scenes are drawn with.
/// On one machine nothing varied: no score changed in a second run, on one thread, or with the C library's functions for processors without AVX2
/// and FMA, which drew all pictures anew.
const MARGINS: [f64; 3] = [0.001, 0.000_01, 0.000_01];
/// Decimal places of the file, by measure.
const PLACES: [usize; 3] = [4, 6, 6];

/// Motion and depth that a frame is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Input {
    /// Optical flow between the anchors.
    Flow,
    /// True motion and depth.
    Truth,
    /// Motion and depth as an engine gives them: quantised, dilated, composed over two frames, of the camera alone for skinned meshes.
    Engine,
    /// True motion of one pixel in 16 x 16, and true depth.
    Tiles,
}

impl Input {
    const ALL: [Self; 4] = [Self::Flow, Self::Truth, Self::Engine, Self::Tiles];

    /// Name in the file, and of the row that makes the frame.
    fn name(self) -> &'static str {
        match self {
            Self::Flow => Kind::Flow.name(),
            Self::Truth => Kind::Truth.name(),
            Self::Engine => "cairn-engine",
            Self::Tiles => "cairn-tiles",
        }
    }

    /// The row that makes a frame of it: every given motion goes the way of the true one.
    fn kind(self) -> Kind {
        if self == Self::Flow { Kind::Flow } else { Kind::Truth }
    }
}

/// Settings of the comparison with the floors.
#[derive(Debug, Clone)]
pub struct FloorSettings {
    /// Write the file of floors from what is measured, instead of comparing.
    pub write: bool,
    /// Folder for the pictures of frames that became worse.
    pub out: PathBuf,
    /// Whether missing weights of LPIPS may be fetched.
    pub fetch: bool,
}

/// Result of the comparison with the floors.
#[derive(Debug)]
pub struct FloorsOutcome {
    /// A line for each frame and row, and for each claim of the published page that these frames can decide: it starts with `held`,
    /// `FAILED`, or `close` for a claim whose rows are too near to each other for so few frames.
    pub lines: Vec<String>,
    /// Number of frames below their floors, of missing floors and of claims that do not hold.
    pub failed: usize,
    /// The written files: floors or pictures.
    pub files: Vec<PathBuf>,
    /// Whether `stop` ended the measurement.
    pub interrupted: bool,
}

/// The floors of one frame of one row: the least PSNR and SSIM, the greatest LPIPS.
#[derive(Debug, Clone, PartialEq)]
struct Floor {
    frame: String,
    row: Input,
    bounds: [f64; 3],
}

/// One measured frame.
struct ScoredFrame {
    frame: String,
    row: Input,
    score: Score,
    truth: Picture,
    made: Picture,
}

/// Makes and scores the fixed frames, and compares them with the committed floors or writes these.
///
/// # Errors
/// `NotFound` without the weights of LPIPS or the file of floors, `InvalidArgument` for a damaged one, `Io`.
pub fn floors(settings: &FloorSettings, progress: &Progress, stop: &AtomicBool) -> Result<FloorsOutcome> {
    let path = provision::repository().join(FILE);
    let floors = if settings.write { Vec::new() } else { read(&path)? };
    let (frames, records) = measure(settings, progress, stop)?;
    if stop.load(Ordering::SeqCst) {
        return Ok(FloorsOutcome { lines: Vec::new(), failed: 0, files: Vec::new(), interrupted: true });
    }
    let mut outcome = FloorsOutcome { lines: Vec::new(), failed: 0, files: Vec::new(), interrupted: false };
    if settings.write {
        let floors: Vec<Floor> = frames.iter().map(Floor::of).collect::<Result<_>>()?;
        outcome.files = write_all(vec![(path, csv(&floors).into_bytes())])?;
    } else {
        for frame in &frames {
            let failure = match floors.iter().find(|floor| floor.is_of(frame)) {
                Some(floor) => floor.broken_by(&frame.score),
                None => Some(format!("{FILE} has no floor of it")),
            };
            outcome.judge(
                &format!("{} {}", frame.row.name(), frame.frame),
                failure.as_ref().map(|why| {
                    let look = settings.out.join(frame.file_name());
                    format!("{why}. {} shows the truth, the frame, and its error", look.display())
                }),
            );
            if failure.is_some() {
                let picture = frame.comparison()?;
                outcome.files.extend(write_all(vec![(settings.out.join(frame.file_name()), encode_png(&picture)?)])?);
            }
        }
        let unknown = floors.iter().filter(|floor| !frames.iter().any(|frame| floor.is_of(frame)));
        for floor in unknown {
            let why = format!("{FILE} has a floor of it, and no such frame is made");
            outcome.judge(&format!("{} {}", floor.row.name(), floor.frame), Some(why));
        }
    }
    for (what, evidence) in published::evidence(&Table::new(&records))? {
        match evidence {
            Evidence::Agrees => outcome.judge(&what, None),
            Evidence::TooClose(figures) => outcome.lines.push(format!("close  {what}: {figures}")),
            Evidence::Contradicts(why) => outcome.judge(&what, Some(why)),
        }
    }
    let disagreements = published::disagreements()?;
    outcome.judge(
        "docs/quality.md and docs/quality.csv agree",
        (!disagreements.is_empty()).then(|| disagreements.join("; ")),
    );
    Ok(outcome)
}

impl FloorsOutcome {
    /// Adds the line of a frame or claim, which failed if there is a `failure`.
    fn judge(&mut self, what: &str, failure: Option<String>) {
        self.failed += usize::from(failure.is_some());
        self.lines.push(match failure {
            None => format!("held   {what}"),
            Some(failure) => format!("FAILED {what}: {failure}"),
        });
    }
}

/// The frames of the rows with floors, and the scores of all rows.
fn measure(
    settings: &FloorSettings,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<(Vec<ScoredFrame>, Vec<Record>)> {
    let cache = provision::cache_dir().map_err(|e| not_provided(&e))?;
    let store = Store::new(cache.join("quality"), true);
    let lpips = open_lpips_of(crate::metrics::Net::Alex, settings.fetch, progress)?;
    let mut rows = ROWS.into_iter().map(|kind| Ok((kind, kind.open(progress)?))).collect::<Result<Vec<_>>>()?;
    let (mut frames, mut records) = (Vec::new(), Vec::new());
    let landscapes = scenes::LANDSCAPES.len() * PHASES.len();
    progress.begin((landscapes + FOOTAGE.len()) as u64);
    for (done, (family, number)) in
        scenes::LANDSCAPES.into_iter().flat_map(|family| (0..PHASES.len()).map(move |i| (family, i))).enumerate()
    {
        if stop.load(Ordering::SeqCst) {
            break;
        }
        let mut clip = SceneClip::new(family, SEED, Scale::Floors)?;
        let (anchor, phase) = (clip.targets()[number].anchor, PHASES[number]);
        let anchors = [clip.anchor(anchor - 1, &store)?, clip.anchor(anchor, &store)?];
        let [before, given] = guidance(&mut clip, anchor, &store)?;
        let truth = clip.truth(anchor, phase, &store)?;
        let features = lpips.features(&truth)?;
        let interval = Interval {
            anchors: &anchors,
            at: 0,
            guidance: given.as_ref(),
            before: before.as_ref(),
            overlay: None,
            history: &[],
        };
        for (kind, row) in &mut rows {
            let made = row.make(&interval, &[phase])?.pop();
            let made = made.ok_or_else(|| Error::new(ErrorKind::InvalidState, "a row made no picture"))?;
            let score = Score::new(&truth, &made, Some(lpips.distance_to(&features, &made)?))?;
            records.push(Record {
                clip: clip.name().into(),
                group: clip.group().into(),
                is_rendered: true,
                row: *kind,
                anchor,
                phase,
                // The claims are about twice the anchors' rate; a scene's three frames stand for it here.
                multipliers: vec![2],
                score,
            });
            if let Some(row) = LANDSCAPE_INPUTS.into_iter().find(|input| input.kind() == *kind) {
                let frame = format!("{} {anchor} {phase}", clip.name());
                frames.push(ScoredFrame { frame, row, score, truth: truth.clone(), made });
            }
        }
        progress.frames(done as u64 + 1);
    }
    for (done, footage) in FOOTAGE.iter().enumerate() {
        if stop.load(Ordering::SeqCst) {
            break;
        }
        let walk = footage.walk()?;
        let (anchors, truth) = (walk.anchors(&store)?, walk.truth(&store)?);
        let features = lpips.features(&truth)?;
        for &input in footage.inputs {
            let [before, given] = walk.guidance(input, &store)?;
            // Without the mask of a head-up display, so that the floors see the rule that finds it.
            let interval = Interval {
                anchors: &anchors,
                at: 0,
                guidance: given.as_ref(),
                before: before.as_ref(),
                overlay: None,
                history: &[],
            };
            let row = rows.iter_mut().find(|(kind, _)| *kind == input.kind());
            let made =
                row.map(|(_, row)| row.make(&interval, &[footage.phase])).transpose()?.and_then(|mut all| all.pop());
            let made = made.ok_or_else(|| Error::new(ErrorKind::InvalidState, "a row made no picture"))?;
            let score = Score::new(&truth, &made, Some(lpips.distance_to(&features, &made)?))?;
            let frame = format!("{} {}", footage.name, footage.phase);
            frames.push(ScoredFrame { frame, row: input, score, truth: truth.clone(), made });
        }
        progress.frames((landscapes + done) as u64 + 1);
    }
    progress.end();
    Ok((frames, records))
}

impl ScoredFrame {
    fn file_name(&self) -> String {
        format!("{}-{}.png", self.frame.replace([' ', '/'], "-"), self.row.name())
    }

    /// The truth, the frame and its error, side by side.
    fn comparison(&self) -> Result<Picture> {
        let (width, height) = self.truth.size();
        let mut out = Picture::new(3 * width, height)?;
        let error = figure::error(&self.truth, &self.made)?;
        for (at, picture) in (0..).zip([&self.truth, &self.made, &error]) {
            paste(&mut out, picture, (at * width, 0));
        }
        Ok(out)
    }
}

impl Floor {
    /// The floors for a frame that is made as it is now: its scores, worse by [`MARGINS`] and rounded to the worse side.
    fn of(frame: &ScoredFrame) -> Result<Self> {
        let mut bounds = [0.0; 3];
        for (i, value) in measures(&frame.score).into_iter().enumerate() {
            let value = value.ok_or_else(|| Error::new(ErrorKind::InvalidState, "LPIPS was not measured"))?;
            let unit = 10_f64.powi(PLACES[i] as i32);
            bounds[i] = if is_better(i, 0.0, 1.0) {
                ((value + MARGINS[i]) * unit).ceil() / unit
            } else {
                ((value - MARGINS[i]) * unit).floor() / unit
            };
        }
        Ok(Self { frame: frame.frame.clone(), row: frame.row, bounds })
    }

    fn is_of(&self, frame: &ScoredFrame) -> bool {
        self.frame == frame.frame && self.row == frame.row
    }

    /// The measures in which `score` is worse than the floors; `None` if it is in none.
    fn broken_by(&self, score: &Score) -> Option<String> {
        let broken = measures(score).into_iter().enumerate().filter_map(|(i, value)| {
            let (bound, places) = (self.bounds[i], PLACES[i] + 1);
            let side = if is_better(i, 0.0, 1.0) { "above" } else { "below" };
            match value {
                // A score that is no number is worse than any.
                Some(value) if value == bound || is_better(i, value, bound) => None,
                Some(value) => Some(format!("{} {value:.places$} is {side} its floor {bound}", MEASURES[i])),
                None => Some(format!("{} was not measured", MEASURES[i])),
            }
        });
        let broken: Vec<String> = broken.collect();
        (!broken.is_empty()).then(|| broken.join("; "))
    }
}

impl fmt::Display for Floor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [psnr, ssim, lpips] = self.bounds;
        write!(f, "{},{},{psnr:.4},{ssim:.6},{lpips:.6}", self.frame, self.row.name())
    }
}

/// The file of floors.
fn csv(floors: &[Floor]) -> String {
    let mut text = format!("{HEAD}\n");
    for floor in floors {
        _ = writeln!(text, "{floor}");
    }
    text
}

fn read(path: &Path) -> Result<Vec<Floor>> {
    let remedy = "Write it with `study quality --floors --write`";
    let text = fs::read_to_string(path).map_err(|e| describe_io("cannot be read", path, &e).remedy(remedy))?;
    parse(&text).map_err(|cause| Error::new(ErrorKind::InvalidArgument, cause).field(FILE).remedy(remedy))
}

fn parse(text: &str) -> std::result::Result<Vec<Floor>, String> {
    let mut lines = text.lines();
    if lines.next() != Some(HEAD) {
        return Err(format!("its first line is not \"{HEAD}\""));
    }
    let floor = |line: &str| {
        let [frame, row, psnr, ssim, lpips] = line.split(',').collect::<Vec<_>>().try_into().ok()?;
        let row = Input::ALL.into_iter().find(|input| input.name() == row)?;
        Some(Floor {
            frame: frame.to_owned(),
            row,
            bounds: [psnr.parse().ok()?, ssim.parse().ok()?, lpips.parse().ok()?],
        })
    };
    lines.map(|line| floor(line).ok_or_else(|| format!("\"{line}\" is no floor"))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(psnr: f64, ssim: f64, lpips: f64) -> ScoredFrame {
        let picture = Picture::new(16, 16).unwrap();
        ScoredFrame {
            frame: "forest-4 41 1/4".into(),
            row: Input::Flow,
            score: Score { psnr, ssim, lpips: Some(lpips) },
            truth: picture.clone(),
            made: picture,
        }
    }

    #[test]
    fn a_frame_holds_its_own_floor_and_a_worse_one_fails_in_the_measure_that_is_worse() {
        let floor = Floor::of(&frame(38.127_951, 0.987_654_4, 0.012_345_6)).unwrap();
        assert_eq!(floor.to_string(), "forest-4 41 1/4,cairn-flow,38.1269,0.987644,0.012356");
        assert_eq!(parse(&csv(std::slice::from_ref(&floor))).unwrap(), std::slice::from_ref(&floor));
        let broken = |psnr, ssim, lpips| floor.broken_by(&frame(psnr, ssim, lpips).score);
        assert_eq!(broken(38.127_951, 0.987_654_4, 0.012_345_6), None);
        assert_eq!(broken(38.1269, 0.987_644, 0.012_356), None);
        assert_eq!(broken(38.126, 0.99, 0.01).unwrap(), "PSNR 38.12600 is below its floor 38.1269");
        assert_eq!(broken(39.0, 0.9876, 0.01).unwrap(), "SSIM 0.9876000 is below its floor 0.987644");
        assert_eq!(broken(39.0, 0.99, 0.0124).unwrap(), "LPIPS 0.0124000 is above its floor 0.012356");
        assert!(broken(f64::NAN, 0.99, 0.01).is_some());
        assert!(floor.broken_by(&Score { psnr: 39.0, ssim: 0.99, lpips: None }).unwrap().contains("not measured"));
    }

    #[test]
    fn the_committed_floors_are_of_every_frame_and_input() {
        let floors = read(&provision::repository().join(FILE)).unwrap();
        let of = |input: Input| floors.iter().filter(|f| f.row == input).map(|f| f.frame.as_str()).collect::<Vec<_>>();
        for input in Input::ALL {
            let mut frames = of(input);
            frames.sort_unstable();
            frames.dedup();
            let landscapes =
                if LANDSCAPE_INPUTS.contains(&input) { scenes::LANDSCAPES.len() * PHASES.len() } else { 0 };
            let footage = FOOTAGE.iter().filter(|footage| footage.inputs.contains(&input)).count();
            assert_eq!(frames.len(), landscapes + footage, "{}", input.name());
        }
        // Floors that anything would hold bound nothing.
        assert!(floors.iter().all(|f| f.bounds[0] > 18.0 && f.bounds[1] > 0.6 && f.bounds[2] < 0.3), "{floors:?}");
    }

    #[test]
    fn a_damaged_file_is_refused_by_line() {
        assert!(parse("frame,row").is_err());
        for line in ["a,cairn-flow,1,2", "a,blend,1,2,3", "a,cairn-flow,1,x,3"] {
            assert!(parse(&format!("{HEAD}\n{line}\n")).unwrap_err().contains(line));
        }
    }
}
