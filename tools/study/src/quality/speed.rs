//! Cost of a generated frame at 1920x1080, relative to the plain average of two pictures and to ffmpeg's `minterpolate`.
//!
//! The timed generator, extractor and filter are those that are scored. Everything is measured in one run, in rounds that include the filter,
//! so that ratios are reliable even where times are not.

mod filter;

use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator};
use cairn::guidance::{DepthMap, Guidance, MotionField, picture_flow};
use cairn::tasks::Pool;
use cairn::{Error, ErrorKind, Picture, Result};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use scenes::Family;

use super::claims::{Claim, Verdict};
use super::clips::{Clip, Scale, SceneClip};
use super::rows::minterpolate::Minterpolate;
use super::store::Store;
use crate::generator::GeneratorChoice;
use crate::machine::Versions;
use crate::progress::Progress;
use filter::{Filter, intervals};

/// Timed rounds of our operations, after one for warming up.
const ROUNDS: usize = 12;
/// Rounds of ours for each run of `minterpolate`, because one run times each of its intervals.
const ROUNDS_PER_FILTER_RUN: usize = 2;
/// Number of anchors.
const ANCHORS: usize = 7;
/// Index of the anchor with given motion and depth.
const CURRENT: usize = 3;
/// Threads of the measurement.
const THREADS: usize = 2;
/// Family of the timed scene: the one with the most edges, in the middle of a walk with a turn.
const FAMILY: Family = Family::Forest;
/// Families where the same is timed, without `minterpolate`.
const OTHER_FAMILIES: [Family; 3] = [Family::Sword, Family::Desert, Family::Snow];
/// Scene seed for tuning the generator.
const SEED: u64 = 4;
/// Largest spread of the plain average's times with which claims are judged by it: the middle half over the median.
const MAX_SPREAD: f64 = 0.25;

/// A claim about times: a ratio is at most or at least so much.
struct SpeedBound {
    what: &'static str,
    bound: f64,
    at_most: bool,
    /// Whether the ratio is to the plain average's time.
    is_of_average: bool,
}

impl SpeedBound {
    fn verdict(&self, figure: f64) -> Verdict {
        Verdict::of(if self.at_most { figure <= self.bound } else { figure >= self.bound })
    }
}

/// The claims about times, in the order of [`Speed::judge`].
const BOUNDS: [SpeedBound; 5] = [
    SpeedBound {
        what: "motion in tiles: at most 8 times the plain average's time at 1920x1080",
        bound: 8.0,
        at_most: true,
        is_of_average: true,
    },
    SpeedBound {
        what: "motion to every pixel: at most 24 times the plain average's time at 1920x1080",
        bound: 24.0,
        at_most: true,
        is_of_average: true,
    },
    SpeedBound {
        what: "`picture_flow` and generation: at least 10 times as fast as minterpolate",
        bound: 10.0,
        at_most: false,
        is_of_average: false,
    },
    SpeedBound {
        what: "generation: a second core makes it at least 1.7 times as fast",
        bound: 1.7,
        at_most: false,
        is_of_average: false,
    },
    SpeedBound {
        what: "`picture_flow` and generation: a second core makes it at least 1.7 times as fast",
        bound: 1.7,
        at_most: false,
        is_of_average: false,
    },
];

/// Start of the figures of a claim that is not judged.
const NO_MEASURE: &str = "the plain average is no measure: ";

/// The verdict on a claim about times by its figure in a page, such as `12.16 times`; `None` for another claim or figure.
pub(super) fn verdict(what: &str, figure: &str) -> Option<Verdict> {
    let bound = BOUNDS.iter().find(|bound| bound.what == what)?;
    if figure.starts_with(NO_MEASURE) {
        return bound.is_of_average.then_some(Verdict::NotJudged);
    }
    figure.strip_suffix(" times")?.parse().ok().map(|figure| bound.verdict(figure))
}

/// Timed operations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Operation {
    Average,
    Tiles(u32),
    Pixels,
    Flow,
    Minterpolate,
}

impl Operation {
    fn label(self) -> String {
        match self {
            Self::Average => "plain average of both anchors".into(),
            Self::Tiles(tile) => format!("**Cairn**, motion and depth given in tiles of {tile}x{tile}"),
            Self::Pixels => "**Cairn**, motion and depth given to every pixel".into(),
            Self::Flow => "**Cairn**, `picture_flow` and generation".into(),
            Self::Minterpolate => "ffmpeg minterpolate".into(),
        }
    }
}

/// Time of a line.
#[derive(Debug, Clone, PartialEq)]
struct Line {
    operation: Operation,
    /// Seconds per frame on two threads, or with the other program's own threads.
    seconds: f64,
    /// Seconds per frame on one thread, if measured.
    alone: Option<f64>,
    /// The middle half of the times behind `seconds`, over their median.
    spread: f64,
}

impl Line {
    fn new(operation: Operation, times: &mut [Duration], alone: Option<&mut [Duration]>) -> Self {
        let seconds = median(times);
        // `median` has sorted them.
        let quartile = |n: usize| times.get(times.len() * n / 4).map_or(f64::NAN, Duration::as_secs_f64);
        Self { operation, seconds, alone: alone.map(median), spread: (quartile(3) - quartile(1)) / seconds }
    }

    /// How many times as fast a second core makes it.
    fn gain(&self) -> Option<f64> {
        Some(self.alone? / self.seconds)
    }
}

/// All times of one run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Speed {
    lines: Vec<Line>,
    /// The smallest and the largest of `minterpolate`'s times in seconds, or why there are none.
    filter_times: std::result::Result<[f64; 2], String>,
    /// The same lines of other scenes.
    other_scenes: Vec<(String, Vec<Line>)>,
    machine: String,
}

/// Measures all times.
///
/// # Errors
/// The scene cannot be rendered, or the generator rejects its anchors.
pub(super) fn measure(store: &Store, progress: &Progress, stop: &AtomicBool) -> Result<Speed> {
    progress.phase("drawing anchors of 1920x1080");
    let timed = TimedInput::draw(FAMILY, CURRENT, ANCHORS, store)?;
    let others = OTHER_FAMILIES.map(|family| Ok((family, TimedInput::draw(family, 1, 2, store)?)));
    let others = others.into_iter().collect::<Result<Vec<_>>>()?;

    progress.phase("timing");
    let filter = Minterpolate::open(progress).and_then(|row| Filter::new(&row.program, &timed.anchors));
    let (lines, filter_times) = time_all(&timed, filter, stop)?;
    let mut other_scenes = Vec::new();
    for (family, timed) in &others {
        let none = Err(Error::new(ErrorKind::Unsupported, "minterpolate is timed in one place only"));
        other_scenes.push((format!("{family}-{SEED}"), time_all(timed, none, stop)?.0));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let Versions { cpu, optimised_build, .. } = Versions::without_world(GeneratorChoice::Cpu);
    let build = if optimised_build { "" } else { ", by a build with its checks on, which is slower" };
    Ok(Speed { lines, filter_times, other_scenes, machine: format!("{cpu}, {cores} logical cores{build}") })
}

/// Input of the timed operations.
struct TimedInput {
    anchors: Vec<Picture>,
    /// Number of the anchor whose motion and depth are given.
    current: usize,
    given: Guidance,
    /// The same for the previous anchor, if known.
    before: Option<Guidance>,
}

impl TimedInput {
    /// Renders `count` anchors of a scene; index `current` is the anchor of the scene's first target.
    fn draw(family: Family, current: usize, count: usize, store: &Store) -> Result<Self> {
        let mut clip = SceneClip::new(family, SEED, Scale::Timed)?;
        let number = clip.targets().first().map_or(1, |target| target.anchor);
        // Anchors before the script's start do not exist: the first is number 0.
        let first = number.saturating_sub(current);
        let anchors = (first..first + count).map(|n| clip.anchor(n, store)).collect::<Result<Vec<Picture>>>()?;
        let given = clip
            .guidance(number, store)?
            .ok_or_else(|| Error::new(ErrorKind::InvalidState, "a scene knows its motion").field("guidance"))?;
        let before = if number >= 2 { clip.guidance(number - 1, store)? } else { None };
        Ok(Self { anchors, current: number - first, given, before })
    }
}

/// Thread pools of equal size for the average and for the library's work.
struct Threads {
    of_average: ThreadPool,
    of_library: Pool,
}

impl Threads {
    fn new(count: usize) -> Result<Self> {
        let built = ThreadPoolBuilder::new().num_threads(count).build();
        let of_average =
            built.map_err(|e| Error::new(ErrorKind::OutOfMemory, format!("{count} threads cannot be started: {e}")))?;
        Ok(Self { of_average, of_library: Pool::new(count)? })
    }
}

/// An operation and the threads it runs on.
struct TimedOperation<'a> {
    operation: Operation,
    threads: &'a Threads,
    run: Box<dyn FnMut() -> Result<()> + Send + 'a>,
    times: Vec<Duration>,
}

impl<'a> TimedOperation<'a> {
    fn new(threads: &'a Threads, operation: Operation, run: Box<dyn FnMut() -> Result<()> + Send + 'a>) -> Self {
        Self { operation, threads, run, times: Vec::new() }
    }
}

/// Result of [`time_all`]: a line per operation, and the value of [`Speed::filter_times`].
type Times = (Vec<Line>, std::result::Result<[f64; 2], String>);

/// Times this program's operations on two threads and on one, with the previous anchor's depth if known, interleaved with the
/// filter. Each round of [`Operation::Flow`] uses another of the filter's intervals.
fn time_all(timed: &TimedInput, filter: Result<Filter>, stop: &AtomicBool) -> Result<Times> {
    let TimedInput { anchors, current, given, before } = timed;
    let (pair, before) = ([&anchors[current - 1], &anchors[*current]], before.as_ref());
    let threads = [Threads::new(THREADS)?, Threads::new(1)?];
    let tiled = [tiled_guidance(given, 8)?, tiled_guidance(given, 16)?];
    let [of_8, of_16] = [8, 16].map(|tile| before.map(|before| tiled_guidance(before, tile)).transpose());
    let befores = [of_8?, of_16?, before.cloned()];
    let mut operations = Vec::new();
    for threads in &threads {
        let mut out = pair[1].clone();
        operations.push(TimedOperation::new(
            threads,
            Operation::Average,
            Box::new(move || {
                average(pair, &mut out);
                Ok(())
            }),
        ));
        let lines = tiled.iter().map(|g| (Operation::Tiles(g.motion().tile()), g)).chain([(Operation::Pixels, given)]);
        for ((operation, guidance), before) in lines.zip(&befores) {
            let (mut generator, mut out) = (CpuGenerator::new(), pair[1].clone());
            let mut pair = AnchorPair::new(pair[0], pair[1], guidance)?;
            if let Some(before) = before {
                pair = pair.with_previous_depth(before.depth())?;
            }
            operations.push(TimedOperation::new(
                threads,
                operation,
                Box::new(move || generator.generate(&pair, 0.5, &mut out).map(drop)),
            ));
        }
        let (mut extractor, mut generator) = (picture_flow::Extractor::new(), CpuGenerator::new());
        let mut guidance = Guidance::new(pair[0].width(), pair[0].height(), picture_flow::PROJECTION)?;
        let mut out = pair[1].clone();
        let mut intervals = intervals(anchors.len()).cycle();
        operations.push(TimedOperation::new(
            threads,
            Operation::Flow,
            Box::new(move || {
                let at = intervals.next().unwrap_or(0);
                let [previous, current] = [&anchors[at], &anchors[at + 1]];
                extractor.extract(previous, current, &mut guidance)?;
                generator.generate(&AnchorPair::new(previous, current, &guidance)?, 0.5, &mut out).map(drop)
            }),
        ));
    }
    let mut filter_times = filter.map(|filter| (filter, Vec::new()));
    for round in 0..=ROUNDS {
        for TimedOperation { operation, threads, run, times } in &mut operations {
            if stop.load(Ordering::SeqCst) {
                return Err(Error::new(ErrorKind::Cancelled, "interrupted while the time was taken"));
            }
            let timed = || {
                let start = Instant::now();
                run().map(|()| start.elapsed())
            };
            let time = match operation {
                Operation::Average => threads.of_average.install(timed)?,
                _ => threads.of_library.install(timed)?,
            };
            if round > 0 {
                times.push(time);
            }
        }
        if round % ROUNDS_PER_FILTER_RUN == 0 {
            filter_times = filter_times.and_then(|(filter, mut times)| {
                let measured = filter.times()?;
                times.extend(measured.into_iter().filter(|_| round > 0));
                Ok((filter, times))
            });
        }
    }
    let half = operations.len() / 2;
    let (both, alone) = operations.split_at_mut(half);
    let mut lines: Vec<Line> = both
        .iter_mut()
        .zip(alone)
        .map(|(both, alone)| Line::new(both.operation, &mut both.times, Some(&mut alone.times)))
        .collect();
    let range = filter_times.map_err(|error| error.to_string()).map(|(_, mut times)| {
        lines.push(Line::new(Operation::Minterpolate, &mut times, None));
        // They are sorted now.
        [times.first(), times.last()].map(|time| time.map_or(f64::NAN, Duration::as_secs_f64))
    });
    Ok((lines, range))
}

fn median(times: &mut [Duration]) -> f64 {
    times.sort_unstable();
    times.get(times.len() / 2).map_or(f64::NAN, Duration::as_secs_f64)
}

/// The cheapest picture between two others: their average.
fn average([previous, current]: [&Picture; 2], out: &mut Picture) {
    const PART: usize = 1 << 16;
    let pairs = previous.rgba().par_chunks(PART).zip(current.rgba().par_chunks(PART));
    out.rgba_mut().par_chunks_mut(PART).zip(pairs).for_each(|(out, (a, b))| {
        for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
            *out = (u16::from(a) + u16::from(b)).div_ceil(2) as u8;
        }
    });
    std::hint::black_box(out);
}

/// Guidance in tiles; each tile has the value of its middle pixel.
fn tiled_guidance(given: &Guidance, tile: u32) -> Result<Guidance> {
    let (width, height) = given.size();
    let mut motion = MotionField::tiled(width, height, tile)?;
    let mut depth = DepthMap::tiled(width, height, tile, given.depth().projection())?;
    let columns = motion.columns();
    let middle = |i: usize| {
        let (x, y) = (i as u32 % columns * tile + tile / 2, i as u32 / columns * tile + tile / 2);
        (y.min(height - 1) * width + x.min(width - 1)) as usize
    };
    for (i, vector) in motion.vectors_mut().iter_mut().enumerate() {
        *vector = given.motion().vectors()[middle(i)];
    }
    for (i, value) in depth.depth_mut().iter_mut().enumerate() {
        *value = given.depth().depth()[middle(i)];
    }
    Guidance::from_parts(motion, depth, given.origin())
}

fn line_of(lines: &[Line], operation: Operation) -> Option<&Line> {
    lines.iter().find(|line| line.operation == operation)
}

/// Time of an operation as a multiple of the plain average's.
fn times_average(lines: &[Line], operation: Operation) -> Option<f64> {
    Some(line_of(lines, operation)?.seconds / line_of(lines, Operation::Average)?.seconds)
}

impl Speed {
    fn line(&self, operation: Operation) -> Option<&Line> {
        line_of(&self.lines, operation)
    }

    /// Time of an operation as a multiple of the plain average's.
    fn times_average(&self, operation: Operation) -> Option<f64> {
        times_average(&self.lines, operation)
    }

    /// Why ratios to the plain average decide nothing: the time on two threads, which they are to, is not the shorter of its two, or its times
    /// differ.
    fn doubt(&self) -> Option<String> {
        let average = self.line(Operation::Average)?;
        match average.gain() {
            Some(gain) if gain <= 1.0 => Some(format!("it is {gain:.2} times as fast on {THREADS} threads as on one")),
            _ if average.spread > MAX_SPREAD => {
                Some(format!("the middle half of its times spans {:.0} % of their median", 100.0 * average.spread))
            }
            _ => None,
        }
    }

    /// Verdicts on the claims about times, as far as they were measured.
    pub(super) fn judge(&self) -> Vec<Claim> {
        let both = self.line(Operation::Flow).zip(self.line(Operation::Minterpolate));
        let gain = |operation| self.line(operation).and_then(Line::gain);
        let doubt = self.doubt();
        let figures = [
            self.times_average(Operation::Tiles(8)),
            self.times_average(Operation::Pixels),
            both.map(|(own, other)| other.seconds / own.seconds),
            gain(Operation::Pixels),
            gain(Operation::Flow),
        ];
        let claim = |(bound, figure): (&SpeedBound, Option<f64>)| {
            let figure = figure?;
            let (verdict, figures) = match &doubt {
                Some(why) if bound.is_of_average => (Verdict::NotJudged, format!("{NO_MEASURE}{why}")),
                _ => (bound.verdict(figure), format!("{figure:.2} times")),
            };
            Some(Claim { what: bound.what.into(), verdict, figures })
        };
        BOUNDS.iter().zip(figures).filter_map(claim).collect()
    }

    /// As Markdown.
    pub(super) fn text(&self) -> String {
        let mut out = format!(
            "\n## Time\n\nOne frame in the middle of two anchors of 1920x1080 (the scene `{}-{}`), on {THREADS} threads, in one run \
             on {}. Times differ from machine to machine; the ratios are what counts.\n\n\
             | | ms | times the plain average | gain by the second core |\n|---|---|---|---|\n",
            FAMILY, SEED, self.machine
        );
        for line in &self.lines {
            let gain = line.gain().map_or_else(|| "–".to_owned(), |gain| format!("{gain:.2}"));
            let ratio = self.times_average(line.operation).unwrap_or(f64::NAN);
            _ = writeln!(out, "| {} | {:.2} | {ratio:.1} | {gain} |", line.operation.label(), line.seconds * 1e3);
        }
        if let Some(why) = self.doubt() {
            _ = write!(out, "\n**The plain average is no measure in this run**: {why}. No claim is judged by it.");
            if let Some(gain) = self.line(Operation::Average).and_then(Line::gain).filter(|gain| *gain <= 1.0) {
                _ = write!(
                    out,
                    " To its time on one thread every ratio of this table is {:.1} times as large.",
                    1.0 / gain
                );
            }
            out.push('\n');
        }
        match &self.filter_times {
            Ok([least, greatest]) => {
                _ = writeln!(
                    out,
                    "\nAll turns are interleaved, and the middle one of each line is shown. `picture_flow` and generation, and \
                     minterpolate, take turns over the same {} intervals. Minterpolate's time is that from the pictures of one \
                     interval to those of the next within a run of the filter at its scored settings, on YUV 4:2:0: its start, \
                     reading, conversions and writing are not in it, as they are not in ours. It may use {THREADS} threads; the \
                     filter itself runs on one. Its times lie between {:.0} and {:.0} ms, and none of its pictures is a copy.",
                    intervals(ANCHORS).len(),
                    least * 1e3,
                    greatest * 1e3
                );
            }
            Err(why) => _ = writeln!(out, "\nLeft out: minterpolate: {}", why.replace('\n', " ")),
        }
        if !self.other_scenes.is_empty() {
            const SHOWN: [Operation; 4] =
                [Operation::Tiles(8), Operation::Tiles(16), Operation::Pixels, Operation::Flow];
            out += "\nThe more edges and the more that leaves the picture, the longer it takes. The same in other scenes, in times \
                    the plain average:\n\n| |";
            SHOWN.iter().for_each(|operation| _ = write!(out, " {} |", operation.label()));
            out += "\n|---|---|---|---|---|\n";
            for (name, lines) in &self.other_scenes {
                _ = write!(out, "| {name} |");
                for operation in SHOWN {
                    let times =
                        times_average(lines, operation).map_or_else(|| "–".to_owned(), |times| format!("{times:.1}"));
                    _ = write!(out, " {times} |");
                }
                out += "\n";
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use half::f16;

    use cairn::guidance::MotionOrigin;

    use super::*;

    #[test]
    fn ratios_decide_and_not_times() {
        let line = |operation, seconds, alone| Line { operation, seconds, alone, spread: 0.1 };
        let lines = vec![
            line(Operation::Average, 1.0, Some(1.5)),
            line(Operation::Tiles(8), 7.5, Some(14.0)),
            line(Operation::Pixels, 25.0, Some(50.0)),
            line(Operation::Flow, 40.0, Some(60.0)),
            line(Operation::Minterpolate, 900.0, None),
        ];
        let other_scenes = vec![("snow-4".into(), lines[..2].to_vec())];
        let slow = Speed { lines, filter_times: Ok([899.0, 901.0]), other_scenes, machine: "a machine".into() };
        let mut fast = slow.clone();
        for line in &mut fast.lines {
            line.seconds /= 1000.0;
            line.alone = line.alone.map(|seconds| seconds / 1000.0);
        }
        let held = |speed: &Speed| speed.judge().iter().map(|c| c.verdict == Verdict::Held).collect::<Vec<_>>();
        assert_eq!(held(&slow), [true, false, true, true, false]);
        assert_eq!(held(&slow), held(&fast));
        assert!(slow.text().contains("| 7500.00 | 7.5 | 1.87 |"), "{}", slow.text());
        assert!(slow.text().contains("| snow-4 | 7.5 | – | – | – |"), "{}", slow.text());
        // Claims without measurements are left out.
        fast.lines.truncate(2);
        assert_eq!(held(&fast), [true]);
    }

    #[test]
    fn a_slow_average_decides_no_claim() {
        let line = |operation, seconds, alone, spread| Line { operation, seconds, alone: Some(alone), spread };
        let speed = |average: Line| Speed {
            lines: vec![
                average,
                line(Operation::Tiles(8), 7.5, 14.0, 0.1),
                line(Operation::Pixels, 11.0, 19.0, 0.1),
                line(Operation::Flow, 40.0, 70.0, 0.1),
            ],
            filter_times: Err("none".into()),
            other_scenes: Vec::new(),
            machine: "a machine".into(),
        };
        let verdicts = |speed: &Speed| speed.judge().iter().map(|claim| claim.verdict).collect::<Vec<_>>();
        let good = speed(line(Operation::Average, 1.0, 1.1, 0.25));
        assert_eq!(verdicts(&good), [Verdict::Held; 4]);
        assert!(!good.text().contains("no measure"), "{}", good.text());
        // Neither ratios to a second core that slows the average, nor to times that differ; gains of ours stand.
        for (average, why) in [
            (line(Operation::Average, 1.0, 0.52, 0.1), "it is 0.52 times as fast on 2 threads as on one"),
            (line(Operation::Average, 1.0, 1.0, 0.1), "it is 1.00 times as fast on 2 threads as on one"),
            (line(Operation::Average, 1.0, 1.1, 0.36), "the middle half of its times spans 36 % of their median"),
        ] {
            let speed = speed(average);
            assert_eq!(verdicts(&speed), [Verdict::NotJudged, Verdict::NotJudged, Verdict::Held, Verdict::Held]);
            let claims = speed.judge();
            assert_eq!(claims[0].figures, format!("{NO_MEASURE}{why}"));
            for claim in &claims {
                assert_eq!(verdict(&claim.what, &claim.figures), Some(claim.verdict), "{claim}");
            }
            assert_eq!(verdict(&claims[2].what, &claims[0].figures), None, "it is no ratio to the average");
            assert!(
                speed.text().contains(&format!("in this run**: {why}. No claim is judged by it.")),
                "{}",
                speed.text()
            );
        }
        let slow = speed(line(Operation::Average, 1.0, 0.52, 0.1));
        assert!(slow.text().contains("every ratio of this table is 1.9 times as large.\n"), "{}", slow.text());
    }

    #[test]
    fn the_spread_is_that_of_the_middle_half() {
        let mut times: Vec<Duration> = [9, 1, 10, 11, 90, 12, 8, 13].map(Duration::from_secs).into();
        let line = Line::new(Operation::Average, &mut times, None);
        assert_eq!((line.seconds, line.spread), (11.0, 4.0 / 11.0));
    }

    #[test]
    fn a_tile_has_what_its_middle_pixel_had() {
        let (width, height) = (20, 9);
        let vectors = (0..width * height).map(|i| [f16::from_f32(i as f32), f16::ZERO]).collect();
        let motion = MotionField::from_vectors(width, height, vectors).unwrap();
        let depth = DepthMap::new(width, height, picture_flow::PROJECTION).unwrap();
        let tiled = tiled_guidance(&Guidance::from_parts(motion, depth, MotionOrigin::Geometry).unwrap(), 8).unwrap();
        let found: Vec<f32> = tiled.motion().vectors().iter().map(|v| v[0].to_f32()).collect();
        // Only the upper edge of the last row of tiles lies in the picture, and the left half of the last column.
        let middles = [(4, 4), (12, 4), (19, 4), (4, 8), (12, 8), (19, 8)];
        assert_eq!(found, middles.map(|(x, y)| (y * width + x) as f32));
    }
}
