//! The common parts of all measurements of a world in scenes that it was not trained on.
//!
//! ```text
//! Settings -> Inputs (world, LPIPS) -> Experiment: prepare, measure scene by scene, report -> files (page, CSV, figure)
//! ```
//!
//! [`motion`](crate::motion) and [`cadence`](crate::cadence) implement the trait `Experiment`. [`compare`](crate::compare) and
//! [`sweep`](crate::sweep) make their rollouts with `cells`; [`quality`](crate::quality) and
//! [`world_quality`](crate::world_quality) publish their pages with `files`.

pub(crate) mod cells;
pub(crate) mod files;
pub(crate) mod held_out;
pub(crate) mod provenance;
pub(crate) mod result_cache;
pub(crate) mod tiles;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::bundle::Bundle;
use cairn::runtime::{CpuOptions, Device};
use cairn::world::{OperatingPoint, World, WorldOptions};
use cairn::{Error, ErrorKind, Picture, Result};

use crate::inputs;
use crate::metrics::{Lpips, Net};
use crate::progress::Progress;
use crate::scene_id::SceneId;
use crate::sets;
use files::Files;
use media::encode_small_png;

/// Scene seeds that an [`Experiment`] measures in each family by default.
const SEEDS: [u64; 3] = [41, 42, 43];

/// Settings of an experiment.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The bundle; `None` for the library's own.
    pub world: Option<PathBuf>,
    /// Scene seeds; empty for the default ones.
    pub seeds: Vec<u64>,
    /// One scene of each family, and fewer frames of each.
    pub quick: bool,
    /// Whether LPIPS is measured; its weights are fetched if they are missing.
    pub lpips: bool,
    /// Also writes the page and its pictures into the repository's docs.
    pub publish: bool,
    /// The output folder.
    pub out: PathBuf,
}

/// Result of an experiment.
#[derive(Debug)]
pub struct ExperimentOutcome {
    /// Summary for the terminal.
    pub text: String,
    /// Files that were written.
    pub files: Vec<PathBuf>,
}

impl Settings {
    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument` for a scene seed that is not held out, or that is sealed.
    pub fn check(&self) -> Result<()> {
        held_out::require(&self.seeds)?;
        sets::require_unsealed(&self.seeds, "--seeds")
    }

    /// The scene seeds: those that were set, otherwise the first of `default` for a quick run, otherwise all of them.
    pub(crate) fn seeds<'a>(&'a self, default: &'a [u64]) -> &'a [u64] {
        match (self.seeds.is_empty(), self.quick) {
            (false, _) => &self.seeds,
            (true, true) => &default[..1],
            (true, false) => default,
        }
    }

    /// The command line of `subcommand` that measures the same.
    pub(crate) fn command(&self, subcommand: &str) -> String {
        let mut command = format!("cargo run --release -p study -- {subcommand}");
        if self.publish {
            command += " --publish";
        }
        if let Some(world) = &self.world {
            command += &format!(" --world {}", world.display());
        }
        if self.quick {
            command += " --quick";
        }
        if !self.seeds.is_empty() {
            command += &format!(" --seeds {}", seed_list(&self.seeds, ","));
        }
        if !self.lpips {
            command += " --no-lpips";
        }
        command
    }
}

/// Seeds as text.
pub(crate) fn seed_list(seeds: &[u64], separator: &str) -> String {
    seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(separator)
}

/// Inputs of an experiment.
pub(crate) struct Inputs {
    /// `None` if LPIPS is not measured.
    pub(crate) lpips: Option<Lpips>,
    pub(crate) bundle: Arc<Bundle>,
    device: Device,
}

impl Inputs {
    /// Opens the inputs. Missing ones are fetched.
    ///
    /// # Errors
    /// Invalid settings, an unusable world, missing weights of LPIPS, no ONNX Runtime.
    pub(crate) fn open(settings: &Settings, progress: &Progress) -> Result<Self> {
        settings.check()?;
        let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
        let (ort, _) = inputs::onnxruntime(progress)?;
        let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
        let device = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
        Ok(Self { lpips, bundle, device })
    }

    /// Loads the world with the context window of `point`.
    ///
    /// # Errors
    /// As [`World::load`].
    pub(crate) fn load(&self, point: &OperatingPoint) -> Result<Arc<World>> {
        let options = WorldOptions::for_point(point);
        World::load(&self.device, &self.bundle, options)
    }
}

/// What an experiment measures with.
pub(crate) struct Bench<'a> {
    pub(crate) world: &'a Arc<World>,
    pub(crate) point: &'a OperatingPoint,
    pub(crate) lpips: Option<&'a Lpips>,
    /// Whether fewer frames of each scene are measured.
    pub(crate) quick: bool,
    pub(crate) progress: &'a Progress,
    pub(crate) stop: &'a AtomicBool,
}

/// All measurements, for the report.
pub(crate) struct Measurements<'a, R> {
    pub(crate) settings: &'a Settings,
    /// The world's name.
    pub(crate) world: &'a str,
    pub(crate) seeds: &'a [u64],
    pub(crate) scenes: &'a [SceneId],
    pub(crate) records: &'a [R],
}

/// The figure of a page.
pub(crate) struct Figure {
    pub(crate) caption: String,
    pub(crate) picture: Picture,
}

/// Texts of a report.
pub(crate) struct Report {
    /// For the terminal.
    pub(crate) summary: String,
    /// Markdown; its figure is `NAME.png`.
    pub(crate) page: String,
    pub(crate) csv: String,
}

/// An experiment whose cells are scenes: each is measured by itself, and the report has means over scenes.
pub(crate) trait Experiment {
    /// The subcommand, and the stem of the files.
    const NAME: &'static str;
    /// Measurements of one frame.
    type Record;

    /// The operating point for a world.
    fn point(bundle: &Bundle) -> OperatingPoint;

    /// Work before the first scene is measured.
    ///
    /// # Errors
    /// As [`measure`](Self::measure).
    fn prepare(&mut self, _bench: &Bench<'_>) -> Result<()> {
        Ok(())
    }

    /// Measures one scene.
    ///
    /// # Errors
    /// Errors of making latents; `Cancelled` when `bench.stop` was set.
    fn measure(&mut self, scene: SceneId, bench: &Bench<'_>) -> Result<Vec<Self::Record>>;

    /// Draws the figure, if there is one.
    ///
    /// # Errors
    /// As [`measure`](Self::measure).
    fn figure(&self, records: &[Self::Record], bench: &Bench<'_>) -> Result<Option<Figure>>;

    /// Writes the texts. They depend on the measurements only.
    fn report(&self, measured: &Measurements<'_, Self::Record>, caption: Option<&str>) -> Report;
}

/// Runs an experiment and writes its files. Returns its measurements as well.
///
/// # Errors
/// As [`Inputs::open`]; errors of the experiment; `Cancelled` when `stop` was set.
pub(crate) fn run<E: Experiment>(
    experiment: &mut E,
    settings: &Settings,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<(ExperimentOutcome, Vec<E::Record>)> {
    let inputs = Inputs::open(settings, progress)?;
    let point = E::point(&inputs.bundle);
    let world = inputs.load(&point)?;
    let (lpips, quick) = (inputs.lpips.as_ref(), settings.quick);
    let bench = Bench { world: &world, point: &point, lpips, quick, progress, stop };
    let seeds = settings.seeds(&SEEDS);
    let scenes = SceneId::all(seeds);

    experiment.prepare(&bench)?;
    let mut records = Vec::new();
    for &scene in &scenes {
        progress.phase(&scene.to_string());
        records.extend(experiment.measure(scene, &bench)?);
    }
    let figure = experiment.figure(&records, &bench)?;
    let measured =
        Measurements { settings, world: &inputs.bundle.manifest().name, seeds, scenes: &scenes, records: &records };
    let report = experiment.report(&measured, figure.as_ref().map(|figure| figure.caption.as_str()));

    let [page, csv, png] = ["md", "csv", "png"].map(|kind| format!("{}.{kind}", E::NAME));
    let mut files = Files::default();
    files.add(&page, report.page);
    files.add(&csv, report.csv);
    if let Some(Figure { picture, .. }) = &figure {
        files.add_picture(E::NAME, encode_small_png(picture)?, picture)?;
    }
    let mut written = files.write(&settings.out)?;
    if settings.publish {
        written.extend(files.publish(&[&page, &png], Some(inputs.bundle.digest()))?);
    }
    Ok((ExperimentOutcome { text: report.summary, files: written }, records))
}

/// Error for an internal inconsistency.
pub(crate) fn missing_frame() -> Error {
    Error::new(ErrorKind::InvalidState, "a frame behind the end of the walk")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_measures_the_same() {
        let settings = Settings {
            world: None,
            seeds: vec![41, 44],
            quick: true,
            lpips: false,
            publish: true,
            out: PathBuf::from("out"),
        };
        assert_eq!(
            settings.command("motion"),
            "cargo run --release -p study -- motion --publish --quick --seeds 41,44 --no-lpips"
        );
        assert_eq!(settings.seeds(&SEEDS), [41, 44]);
        let default = Settings { seeds: Vec::new(), ..settings };
        assert_eq!(default.seeds(&SEEDS), [41]);
        assert_eq!(Settings { quick: false, ..default }.seeds(&SEEDS), SEEDS);
    }
}
