//! Measures every scene, or reads the stored measurements.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::world::WorldTime;

use super::branch::Branch;
use super::make::Rollouts;
use super::paths::TRUTH;
use super::plan::{Cell, Settings};
use super::series::{Comparison, Series, Stream, from_csv, to_csv};
use super::summary::{RolloutMetrics, summarise};
use super::truth;
use super::turn_onset::onset;
use super::walk::{RATE, first_turn, straight_seconds};
use crate::manifest::{Manifest, sha256, to_json};
use crate::metrics::Lpips;
use crate::output::MANIFEST;
use crate::progress::Progress;
use crate::scene_id::SceneId;
use media::{RealDisk, describe_io, write_whole};

/// File of the per-frame series.
pub(crate) const SERIES: &str = "series.csv";
/// Version of the measurement; raised when a column changes its meaning.
const VERSION: u32 = 2;

/// Measurements of a scene.
pub(super) struct SceneScores {
    pub(super) scene: SceneId,
    /// Digest of the files of all streams.
    pub(super) key: String,
    /// The truth compared with itself: its own change over time.
    pub(super) truth: RolloutMetrics,
    /// In the order of [`Branch::ALL`].
    pub(super) branches: Vec<(Branch, RolloutMetrics)>,
    /// Series of the truth, then of each branch.
    pub(super) series: Vec<Series>,
    /// Whether the straight walks equal the turning ones until the turn, as they must.
    pub(super) same_before_turn: bool,
    /// File with the series.
    pub(super) file: PathBuf,
}

/// Measures every scene.
///
/// # Errors
/// Errors of drawing and measuring; `Cancelled` when `stop` was set.
pub(super) fn score(
    settings: &Settings,
    made: &Rollouts,
    lpips: Option<&Lpips>,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<Vec<SceneScores>> {
    settings
        .scenes()
        .map(|scene| {
            let cells: Vec<&(Cell, Manifest)> = made.cells.iter().filter(|(cell, _)| cell.scene == scene).collect();
            let mut scored = score_scene(scene, settings, &cells, lpips, progress, stop)?;
            let mut turned = false;
            for (straight, _) in made.straight.iter().filter(|(cell, _)| cell.scene == scene) {
                measure_onset(*straight, settings, &mut scored, progress, stop)?;
                turned = true;
            }
            if turned {
                scored.truth.onset = true_onset(scene, settings, progress, stop)?;
            }
            Ok(scored)
        })
        .collect()
}

/// Measures the turn onset of each branch that has a straight walk, and stores it.
fn measure_onset(
    straight: Cell,
    settings: &Settings,
    scored: &mut SceneScores,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<()> {
    let scene = straight.scene;
    let Some(command) = first_turn(scene.family)? else { return Ok(()) };
    progress.phase(&format!("looking for the turn of {scene}, {}", straight.branch.name()));
    let turned = stream(Cell { straight: false, ..straight }, settings);
    let onset = onset(&turned.folder, &straight.folder(&settings.out), turned.step, command, stop)?;
    if let Some((_, figures)) = scored.branches.iter_mut().find(|(branch, _)| *branch == straight.branch) {
        figures.onset = onset.latency;
    }
    scored.same_before_turn &= onset.same_before;
    Ok(())
}

/// Turn onset of the truth by the same detector, as the reference for delays.
fn true_onset(scene: SceneId, settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Option<f64>> {
    let Some(command) = first_turn(scene.family)? else { return Ok(None) };
    let straight = straight_seconds(scene.family, &settings.seconds)?;
    let Some(seconds) = straight else { return Ok(None) };
    let samples = WorldTime::parse(&seconds)?.whole_steps(RATE) + 1;
    let all = WorldTime::parse(&settings.seconds)?.whole_steps(RATE) + 1;
    let drawn = truth::Settings { out: &settings.out, size: settings.size };
    let turned = truth::draw(scene, false, all, &drawn, progress, stop)?;
    let straight = truth::draw(scene, true, samples, &drawn, progress, stop)?;
    Ok(onset(&turned, &straight, 1, command, stop)?.latency)
}

fn score_scene(
    scene: SceneId,
    settings: &Settings,
    cells: &[&(Cell, Manifest)],
    lpips: Option<&Lpips>,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<SceneScores> {
    let count = WorldTime::parse(&settings.seconds)?.whole_steps(RATE) + 1;
    let drawn = truth::Settings { out: &settings.out, size: settings.size };
    let folder = truth::draw(scene, false, count, &drawn, progress, stop)?;
    let key = series_key(count, lpips.is_some(), cells.iter().map(|(_, manifest)| manifest), &folder)?;
    let file = scene.folder(&settings.out).join(SERIES);
    let truth = Stream { name: TRUTH.into(), folder, step: 1 };
    let streams = cells.iter().map(|(cell, _)| stream(*cell, settings)).collect::<Vec<_>>();
    let decoder = [Branch::Coherence, Branch::CoherenceBest].map(|branch| [branch.name(), Branch::Decoded60.name()]);
    let comparison = Comparison { truth: &truth, streams: &streams, decoder: &decoder, count, lpips };
    let series = match stored_series(&file, &key, streams.len()) {
        Some(series) => series,
        None => {
            progress.phase(&format!("measuring {scene}"));
            measure_series(&file, &key, &comparison, progress, stop)?
        }
    };
    let truth = summarise(&series[0], &series[0]);
    let branches = cells.iter().zip(&series[1..]);
    let branches = branches.map(|((cell, _), stream)| (cell.branch, summarise(stream, &series[0]))).collect();
    Ok(SceneScores { scene, key, truth, branches, series, same_before_turn: true, file })
}

/// Key of the series' inputs: digests of the streams' files and of those of the truth in `truth`.
///
/// # Errors
/// `Io` if the truth was not drawn.
pub(crate) fn series_key<'a>(
    count: u64,
    lpips: bool,
    manifests: impl Iterator<Item = &'a Manifest>,
    truth: &Path,
) -> Result<String> {
    let mut key = format!("{VERSION} {count} {lpips}");
    for manifest in manifests {
        // Timings differ between runs, so only the outputs count.
        key += &sha256(&to_json(&manifest.outputs)?);
    }
    let drawn = truth.join(MANIFEST);
    key += &sha256(&std::fs::read(&drawn).map_err(|e| describe_io("cannot be read", &drawn, &e))?);
    Ok(sha256(key.as_bytes()))
}

/// The stored series of the truth and `streams` others in `file`, if they were measured under `key`.
pub(crate) fn stored_series(file: &Path, key: &str, streams: usize) -> Option<Vec<Series>> {
    let series = from_csv(key, &std::fs::read_to_string(file).ok()?)?;
    (series.len() == streams + 1).then_some(series)
}

/// Measures the series and stores them in `file`.
///
/// # Errors
/// As [`Comparison::measure`]; `Io` when they cannot be written.
pub(crate) fn measure_series(
    file: &Path,
    key: &str,
    comparison: &Comparison<'_>,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<Vec<Series>> {
    let series = comparison.measure(progress, stop)?;
    write_whole(&RealDisk, file, to_csv(key, &series).as_bytes())?;
    Ok(series)
}

fn stream(cell: Cell, settings: &Settings) -> Stream {
    // All branches present a multiple of the sample rate.
    let step = u64::from(cell.branch.point(cell.scene.family).presented_rate() / RATE).max(1);
    Stream { name: cell.branch.name().into(), folder: cell.folder(&settings.out), step }
}
