//! The file of a sweep as it is written: TOML, of which every word is known.

use cairn::world::{
    CacheMode, GuidanceSource, MAX_LATENT_RATE, MAX_PRESENTED_RATE, OperatingPoint, Presentation, Preset, Schedule,
};
use cairn::{Error, ErrorKind, Result};
use serde::Deserialize;

use super::plan::{MOST_POINTS, Point, refused};
use crate::generator::GeneratorChoice;

/// The whole of it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    /// Kinds of places; all where none is named.
    #[serde(default)]
    pub(super) scenes: Vec<String>,
    /// Places of each kind.
    #[serde(default = "one")]
    pub(super) places: u64,
    /// World time, in seconds.
    pub(super) seconds: Seconds,
    /// `[width, height]` at which everything is compared.
    pub(super) size: [u32; 2],
    /// A bundle, from where the file lies; without it, the world inside the library.
    pub(super) world: Option<std::path::PathBuf>,
    /// The operating point that the axes change: a preset's name, and what differs from it.
    #[serde(default = "coherence")]
    base: String,
    /// Threads of a pass.
    #[serde(default = "one_thread")]
    pub(super) threads: usize,
    /// Where the world runs.
    #[serde(default = "cpu")]
    pub(super) device: String,
    /// Whether LPIPS is measured.
    #[serde(default = "yes")]
    pub(super) lpips: bool,
    /// What coherence is measured by.
    pub(super) measure: Option<String>,
    /// What compute is counted in.
    #[serde(default = "gflop")]
    pub(super) cost: String,
    /// For a second of world time; for each the best point is told.
    #[serde(default)]
    pub(super) budgets: Vec<f64>,
    #[serde(default)]
    sweep: Axes,
}

/// A number, or one as text.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum Seconds {
    Whole(u64),
    Part(f64),
    Text(String),
}

impl std::fmt::Display for Seconds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Whole(seconds) => write!(f, "{seconds}"),
            Self::Part(seconds) => write!(f, "{seconds}"),
            Self::Text(seconds) => f.write_str(seconds),
        }
    }
}

fn one() -> u64 {
    1
}

fn one_thread() -> usize {
    1
}

fn coherence() -> String {
    Preset::Coherence.name().into()
}

fn cpu() -> String {
    "cpu".into()
}

fn gflop() -> String {
    "gflop".into()
}

fn yes() -> bool {
    true
}

/// What is varied; an axis that is not named stays as the base has it.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Axes {
    /// g, in latents.
    window: Vec<u32>,
    /// Passes of a latent, of refined schedules.
    steps: Vec<u32>,
    /// Schedules, instead of steps.
    schedule: Vec<String>,
    cache: Vec<String>,
    /// Latents a second.
    anchor_rate: Vec<u32>,
    /// Frames shown for each anchor; 1 shows anchors alone.
    multiplier: Vec<u32>,
    motion: Vec<String>,
    generator: Vec<String>,
}

/// The values of an axis, or none of its own.
fn values<T: Clone>(values: &[T]) -> Vec<Option<T>> {
    if values.is_empty() { vec![None] } else { values.iter().cloned().map(Some).collect() }
}

/// The same, of texts.
fn parsed<T: Clone + std::str::FromStr<Err = Error>>(texts: &[String], field: &str) -> Result<Vec<Option<T>>> {
    let read = |text: &String| text.parse::<T>().map_err(|e| e.field(field));
    Ok(values(&texts.iter().map(read).collect::<Result<Vec<T>>>()?))
}

/// Every point in every value of an axis.
fn each<T: Clone>(points: &mut Vec<Point>, values: &[Option<T>], set: impl Fn(&mut Point, T)) {
    let of = |point: &Point| {
        let of = |value: &Option<T>| {
            let mut point = point.clone();
            if let Some(value) = value.clone() {
                set(&mut point, value);
            }
            point
        };
        values.iter().map(of).collect::<Vec<_>>()
    };
    *points = points.iter().flat_map(of).collect();
}

impl File {
    /// Understands the text.
    ///
    /// # Errors
    /// `InvalidArgument` with line and column.
    pub(super) fn parse(text: &str) -> Result<Self> {
        toml::from_str(text).or_else(|e| {
            refused(
                format!("it is no sweep: {}", e.to_string().trim_end()),
                "sweep",
                "docs/sweep.md has all words of one",
            )
        })
    }

    /// Every combination of the axes, each once, in the order of the file: the last axis changes fastest.
    ///
    /// # Errors
    /// `InvalidArgument`, with the axis.
    pub(super) fn points(&self) -> Result<Vec<Point>> {
        let axes = &self.sweep;
        if !axes.steps.is_empty() && !axes.schedule.is_empty() {
            return refused("steps and schedules are one axis".into(), "sweep.steps", "Name one of the two");
        }
        let base: OperatingPoint = self.base.parse().map_err(|e: Error| e.field("base"))?;
        let windows = values(&axes.window);
        let schedules = match axes.steps.as_slice() {
            [] => parsed::<Schedule>(&axes.schedule, "sweep.schedule")?,
            steps => steps.iter().map(|steps| Some(Schedule::Refined(*steps))).collect(),
        };
        let caches = parsed::<CacheMode>(&axes.cache, "sweep.cache")?;
        let rates = values(&axes.anchor_rate);
        let multipliers = values(&axes.multiplier);
        let motions = parsed::<GuidanceSource>(&axes.motion, "sweep.motion")?;
        let generators = parsed::<GeneratorChoice>(&axes.generator, "sweep.generator")?;
        let counts = [
            windows.len(),
            schedules.len(),
            caches.len(),
            rates.len(),
            multipliers.len(),
            motions.len(),
            generators.len(),
        ];
        // Before they are made: a slip of the pen must not fill the memory.
        let all = counts.into_iter().fold(1, usize::saturating_mul);
        if all > MOST_POINTS {
            return refused(
                format!("{all} combinations are too many"),
                "sweep",
                &format!("Use fewer values; {MOST_POINTS} are the most"),
            );
        }
        if let Some(rate) = axes.anchor_rate.iter().find(|rate| !(1..=MAX_LATENT_RATE).contains(*rate)) {
            let remedy = format!("Use 1 to {MAX_LATENT_RATE}");
            return refused(format!("{rate} anchors a second cannot be made"), "sweep.anchor_rate", &remedy);
        }
        if let Some(times) = axes.multiplier.iter().find(|times| !(1..=MAX_PRESENTED_RATE).contains(*times)) {
            return refused(format!("{times} frames for an anchor cannot be shown"), "sweep.multiplier", "Use 1 to 6");
        }

        let mut points = vec![Point { point: base, generator: GeneratorChoice::Cpu }];
        each(&mut points, &windows, |p, window| p.point.global_window = window);
        each(&mut points, &schedules, |p, schedule| p.point.schedule = schedule);
        each(&mut points, &caches, |p, cache| p.point.cache_mode = cache);
        each(&mut points, &rates, |p, rate| {
            // As many frames for each anchor as before.
            if let Presentation::Generated { rate: shown, .. } = &mut p.point.presentation {
                *shown = shown.saturating_mul(rate) / p.point.latents_per_second.max(1);
            }
            p.point.latents_per_second = rate;
        });
        each(&mut points, &multipliers, |p, times| {
            let guidance = match p.point.presentation {
                Presentation::Generated { guidance, .. } => guidance,
                Presentation::Native => GuidanceSource::BEST,
            };
            let rate = p.point.latents_per_second.saturating_mul(times);
            p.point.pictures_per_latent = 1;
            p.point.presentation =
                if times == 1 { Presentation::Native } else { Presentation::Generated { rate, guidance } };
        });
        each(&mut points, &motions, |p, motion| {
            if let Presentation::Generated { guidance, .. } = &mut p.point.presentation {
                *guidance = motion;
            }
        });
        each(&mut points, &generators, |p, generator| {
            // Where nothing is generated nothing depends on it.
            if p.point.presentation != Presentation::Native {
                p.generator = generator;
            }
        });
        let mut unique: Vec<Point> = Vec::new();
        for point in points {
            if !unique.contains(&point) {
                unique.push(point);
            }
        }
        Ok(unique)
    }
}

/// An error about the text of `path`, which its field then names.
pub(super) fn in_file(error: &Error, path: &std::path::Path) -> Error {
    let path = path.display();
    let field = error.offending_field().map_or(path.to_string(), |field| format!("{path}: {field}"));
    let named = Error::new(error.kind(), error.cause()).field(field);
    error.remedy_text().map_or(named.clone(), |remedy| named.remedy(remedy))
}

/// A limit of the file's size, in bytes.
pub(super) const MAX_FILE: u64 = 1 << 20;

/// The text of `path`.
///
/// # Errors
/// `Io`; `InvalidArgument` for what is no text.
pub(super) fn read(path: &std::path::Path) -> Result<String> {
    String::from_utf8(crate::manifest::read_bounded(path, MAX_FILE)?)
        .map_err(|_| Error::new(ErrorKind::InvalidArgument, "it is no UTF-8 text").field(path.display().to_string()))
}
