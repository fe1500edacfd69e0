//! The TOML file of a sweep. Unknown keys are errors.

use cairn::world::{
    CacheMode, GuidanceSource, MAX_LATENT_RATE, MAX_PRESENTED_RATE, OperatingPoint, Presentation, Preset, Schedule,
};
use cairn::{Error, ErrorKind, Result};
use serde::Deserialize;

use super::point::{MOST_POINTS, Point, refused};
use crate::generator::GeneratorChoice;

/// Content of the file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    /// Families of the scenes; empty for all.
    #[serde(default)]
    pub(super) scenes: Vec<String>,
    /// Number of scenes of each family.
    #[serde(default = "one")]
    pub(super) places: u64,
    /// World time, in seconds.
    pub(super) seconds: Seconds,
    /// `[width, height]` of the compared frames.
    pub(super) size: [u32; 2],
    /// Path of a bundle, relative to the file; `None` for the embedded world.
    pub(super) world: Option<std::path::PathBuf>,
    /// Operating point that the axes change: a preset's name and changes to it.
    #[serde(default = "coherence")]
    base: String,
    /// Threads per pass.
    #[serde(default = "one_thread")]
    pub(super) threads: usize,
    /// Device of the world.
    #[serde(default = "cpu")]
    pub(super) device: String,
    /// Whether LPIPS is measured.
    #[serde(default = "yes")]
    pub(super) lpips: bool,
    /// Measure of coherence.
    pub(super) measure: Option<String>,
    /// Measure of compute.
    #[serde(default = "gflop")]
    pub(super) cost: String,
    /// Budgets per second of world time; the report names the best point for each.
    #[serde(default)]
    pub(super) budgets: Vec<f64>,
    #[serde(default)]
    sweep: Axes,
}

/// A number, or a number as text.
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

/// The axes. One without values keeps the base's value.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Axes {
    /// Context window in latents.
    window: Vec<u32>,
    /// Denoise passes per latent of refined schedules.
    steps: Vec<u32>,
    /// Schedules; used instead of steps.
    schedule: Vec<String>,
    cache: Vec<String>,
    /// Latents per second.
    anchor_rate: Vec<u32>,
    /// Presented frames per anchor; 1 presents anchors only.
    multiplier: Vec<u32>,
    motion: Vec<String>,
    generator: Vec<String>,
}

/// The values of an axis; a single `None` for an empty one.
fn values<T: Clone>(values: &[T]) -> Vec<Option<T>> {
    if values.is_empty() { vec![None] } else { values.iter().cloned().map(Some).collect() }
}

/// The same for values that are parsed from text.
fn parsed<T: Clone + std::str::FromStr<Err = Error>>(texts: &[String], field: &str) -> Result<Vec<Option<T>>> {
    let read = |text: &String| text.parse::<T>().map_err(|e| e.field(field));
    Ok(values(&texts.iter().map(read).collect::<Result<Vec<T>>>()?))
}

/// Combines every point with every value of an axis.
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
    /// Parses the file's text.
    ///
    /// # Errors
    /// `InvalidArgument`, with line and column.
    pub(super) fn parse(text: &str) -> Result<Self> {
        toml::from_str(text).or_else(|e| {
            refused(
                format!("it is no sweep: {}", e.to_string().trim_end()),
                "sweep",
                "docs/sweep.md has all words of one",
            )
        })
    }

    /// Every combination of the axes, without duplicates, in the file's order: the last axis changes fastest.
    ///
    /// # Errors
    /// `InvalidArgument`, naming the axis.
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
        // Checked before the points are made, so that a typo cannot fill the memory.
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
            let remedy = format!("Use 1 to {MAX_PRESENTED_RATE}");
            return refused(format!("{times} frames for an anchor cannot be shown"), "sweep.multiplier", &remedy);
        }

        let mut points = vec![Point { point: base, generator: GeneratorChoice::Cpu }];
        each(&mut points, &windows, |p, window| p.point.global_window = window);
        each(&mut points, &schedules, |p, schedule| p.point.schedule = schedule);
        each(&mut points, &caches, |p, cache| p.point.cache_mode = cache);
        each(&mut points, &rates, |p, rate| {
            // The number of frames per anchor stays the same.
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
            // Without generated frames the generator has no effect.
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

/// Adds the file's path to an error's field.
pub(super) fn in_file(error: &Error, path: &std::path::Path) -> Error {
    let path = path.display();
    let field = error.offending_field().map_or(path.to_string(), |field| format!("{path}: {field}"));
    let named = Error::new(error.kind(), error.cause()).field(field);
    error.remedy_text().map_or(named.clone(), |remedy| named.remedy(remedy))
}

/// Maximum file size in bytes.
pub(super) const MAX_FILE: u64 = 1 << 20;

/// Reads the file at `path`.
///
/// # Errors
/// `Io`; `InvalidArgument` if it is not UTF-8.
pub(super) fn read(path: &std::path::Path) -> Result<String> {
    String::from_utf8(crate::manifest::read_bounded(path, MAX_FILE)?)
        .map_err(|_| Error::new(ErrorKind::InvalidArgument, "it is no UTF-8 text").field(path.display().to_string()))
}
