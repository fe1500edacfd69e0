//! Long rollouts of a world beside those of the same world with smaller weights: the same walks, controls and noise, against the truth.
//!
//! ```text
//! place -> measure (truth, then a rollout of each world) -> result cache -> report, page
//! ```

mod measure;
mod report;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use cairn::bundle::Bundle;
use cairn::runtime::{CpuOptions, Device};
use cairn::world::{OperatingPoint, Preset, World, WorldOptions};
use cairn::{Error, ErrorKind, Result};
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

use super::place::TestWalk;
use crate::experiment::ExperimentOutcome;
use crate::experiment::files::{Files, docs, write_all};
use crate::experiment::provenance::stamped;
use crate::experiment::result_cache::ResultCache;
use crate::inputs;
use crate::level::{self, HELD_OUT_SECONDS};
use crate::metrics::{Lpips, Net};
use crate::progress::{Progress, check_stop};
use crate::workers::check_jobs;
use measure::{Samples, Truth, Walk};

/// Held-out walks of each level of the published page.
pub const WALKS: u32 = 3;
/// Changes when walks are measured in another way.
const VERSION: u32 = 1;

/// Settings of the comparison.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The world that the others are compared with; `None` for the library's own.
    pub world: Option<PathBuf>,
    /// Worlds of the same geometry with other weights; empty for the library's own in 8 and in 4 bits, which the bundle builder makes.
    pub others: Vec<PathBuf>,
    /// Operating point of all rollouts.
    pub preset: Preset,
    /// Held-out walks of each level, 1 to 8.
    pub walks: u32,
    /// Length of a walk in seconds, 1 to 60.
    pub seconds: u32,
    /// Whether LPIPS is measured; its weights are fetched if they are missing. Horizons need it.
    pub lpips: bool,
    /// Walks at a time. No number depends on it.
    pub jobs: usize,
    /// Also writes the page into the repository's docs.
    pub publish: bool,
    /// The output folder.
    pub out: PathBuf,
}

impl Settings {
    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument` for walks that do not exist, and for no jobs.
    pub fn check(&self) -> Result<()> {
        check_jobs(self.jobs)?;
        level::check_held_out(self.walks, self.seconds)
    }

    /// The command line that measures the same.
    fn command(&self) -> String {
        let mut command = "cargo run --release -p study -- weights".to_owned();
        if self.publish {
            command += " --publish";
        }
        for other in &self.others {
            command += &format!(" {}", other.display());
        }
        if let Some(world) = &self.world {
            command += &format!(" --world {}", world.display());
        }
        if self.preset != Preset::Stock {
            command += &format!(" --preset {}", self.preset.name());
        }
        for (option, value, default) in [("walks", self.walks, WALKS), ("seconds", self.seconds, HELD_OUT_SECONDS)] {
            if value != default {
                command += &format!(" --{option} {value}");
            }
        }
        if !self.lpips {
            command += " --no-lpips";
        }
        command
    }
}

/// A world that is compared.
struct ComparedWorld {
    name: String,
    bundle: Arc<Bundle>,
    world: Arc<World>,
}

/// All of them, the first one first, and what their rollouts share.
struct Inputs {
    worlds: Vec<ComparedWorld>,
    point: OperatingPoint,
    /// Digest of ONNX Runtime.
    onnxruntime: String,
}

/// A walk that was measured: the truth's own values, and each world's.
struct Measured {
    truth: Truth,
    /// In the worlds' order.
    rollouts: Vec<Samples>,
}

/// Compares worlds. Finished rollouts are kept in the output folder's folder `rollouts` and made once.
///
/// # Errors
/// Invalid settings, an unusable world, worlds of other geometries, missing weights of LPIPS, errors of making latents; `Cancelled` when `stop` was
/// set.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<ExperimentOutcome> {
    settings.check()?;
    let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
    let inputs = inputs(settings, progress)?;
    let (worlds, point) = (&inputs.worlds, &inputs.point);
    let places = TestWalk::all(settings.walks, &[]);
    let measured = measure_all(settings, &places, &inputs, lpips.as_ref(), progress, stop)?;

    let names: Vec<&str> = worlds.iter().map(|world| world.name.as_str()).collect();
    let results = report::Results { names: &names, point, seconds: settings.seconds, measured: &measured };
    let text = results.text();
    let mut files = Files::default();
    files.add("weights.md", text.as_str());
    files.add("weights.csv", results.csv(&places));
    let mut files = files.write(&settings.out)?;
    if settings.publish {
        let page = report::page(&text, &settings.command());
        let page = stamped(&page, Some(worlds[0].bundle.digest())).into_bytes();
        files.extend(write_all(vec![(docs().join("weights.md"), page)])?);
    }
    Ok(ExperimentOutcome { text, files })
}

/// Loads all worlds.
fn inputs(settings: &Settings, progress: &Progress) -> Result<Inputs> {
    let (first, _) = inputs::world(settings.world.as_deref(), progress)?;
    let name = if settings.world.is_some() { &first.manifest().name } else { "16 bits" };
    let mut bundles = vec![(name.to_owned(), first.clone())];
    if settings.others.is_empty() {
        for (world, weights) in provision::QUANTISED {
            let folder = provision::bundle(world, progress).map_err(|e| inputs::not_provided(&e, ErrorKind::Io))?;
            bundles.push((weights.to_owned(), inputs::world(Some(&folder), progress)?.0));
        }
    }
    for path in &settings.others {
        let name = path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.display().to_string());
        bundles.push((name, inputs::world(Some(path), progress)?.0));
    }
    for (name, bundle) in &bundles {
        if bundle.geometry() != first.geometry() || bundle.manifest().sampler != first.manifest().sampler {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("{name} is not the first world in other weights"),
            )
            .field("BUNDLE")
            .remedy("Give bundles that `python -m cairn.build quantise` made of the first one"));
        }
    }
    let preset = settings.preset.operating_point();
    let point = OperatingPoint { global_window: super::window(&first, preset.global_window), ..preset };
    point.check_for(first.geometry())?;
    let (ort, onnxruntime) = inputs::onnxruntime(progress)?;
    let device = Device::cpu(&ort, CpuOptions { threads: Some(1), deterministic: true })?;
    let load = |(name, bundle): (String, Arc<Bundle>)| {
        let world = World::load(&device, &bundle, WorldOptions::for_point(&point))?;
        Ok(ComparedWorld { name, bundle, world })
    };
    let worlds = bundles.into_iter().map(load).collect::<Result<_>>()?;
    Ok(Inputs { worlds, point: point.clone(), onnxruntime: onnxruntime.sha256 })
}

/// Measures all walks, `settings.jobs` at a time.
fn measure_all(
    settings: &Settings,
    places: &[TestWalk],
    inputs: &Inputs,
    lpips: Option<&Lpips>,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<Vec<Measured>> {
    let Inputs { worlds, point, onnxruntime } = inputs;
    let latents = super::walk::step_at(point, settings.seconds.into());
    progress.begin(latents * (places.len() * worlds.len()) as u64);
    let (done, has_failed) = (AtomicU64::new(0), AtomicBool::new(false));
    let count = |latents: u64| progress.frames(done.fetch_add(latents, Ordering::Relaxed) + latents);
    let proceed = || {
        check_stop(stop)?;
        // Another walk's failure ends this one too.
        check_stop(&has_failed)
    };
    let one = |place: TestWalk| -> Result<Measured> {
        let course = place.course()?;
        let walk = Walk::new(&course, worlds[0].world.render_size(), point, settings.seconds, lpips, &proceed)?;
        let rollout = |compared: &ComparedWorld| {
            let measured = [
                format!("world {}, ONNX Runtime {onnxruntime}", compared.bundle.digest()),
                format!("{point:?}, {} s, lpips {}", settings.seconds, lpips.is_some()),
            ];
            let cache = ResultCache::new(settings.out.join("rollouts"), VERSION, &measured);
            let name = format!("{}-{}-{}s", place.key(), compared.file_name(), settings.seconds);
            if let Some(samples) = cache.find(&name)? {
                count(latents);
                return Ok(samples);
            }
            let samples = measure::rollout(place, &course, &walk, &compared.world, point, lpips, &|| {
                count(1);
                proceed()
            })?;
            cache.store(&name, &samples, Vec::new())?;
            Ok(samples)
        };
        let rollouts = worlds.iter().map(rollout).collect::<Result<_>>()?;
        Ok(Measured { truth: walk.truth, rollouts })
    };
    let measure = |place: &TestWalk| {
        let measured = one(*place);
        has_failed.fetch_or(measured.is_err(), Ordering::Relaxed);
        measured
    };
    let pool = ThreadPoolBuilder::new().num_threads(settings.jobs).build();
    let pool = pool.map_err(|e| Error::new(ErrorKind::Unsupported, e.to_string()).field("--jobs"))?;
    let results: Vec<Result<Measured>> = pool.install(|| places.par_iter().map(measure).collect());
    progress.end();
    // The failure of one walk ends the others with `Cancelled`.
    let is_cause = |result: &Result<Measured>| result.as_ref().is_err_and(|e| e.kind() != ErrorKind::Cancelled);
    match results.iter().position(is_cause) {
        Some(cause) => results.into_iter().skip(cause).take(1).collect(),
        None => results.into_iter().collect(),
    }
}

impl ComparedWorld {
    /// Its part of a cached rollout's file name.
    fn file_name(&self) -> &str {
        &self.bundle.digest()[..16]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings {
            world: None,
            others: Vec::new(),
            preset: Preset::Stock,
            walks: WALKS,
            seconds: HELD_OUT_SECONDS,
            lpips: true,
            jobs: 2,
            publish: true,
            out: PathBuf::from("out"),
        }
    }

    #[test]
    fn the_command_measures_the_same() {
        assert_eq!(settings().command(), "cargo run --release -p study -- weights --publish");
        let other = Settings { walks: 8, seconds: 5, preset: Preset::Coherence, ..settings() };
        assert!(other.command().ends_with(" --preset coherence --walks 8 --seconds 5"), "{}", other.command());
        let own = Settings {
            world: Some("mine".into()),
            others: vec!["mine-8bit".into()],
            lpips: false,
            publish: false,
            ..settings()
        };
        assert!(own.command().ends_with("-- weights mine-8bit --world mine --no-lpips"), "{}", own.command());
        settings().check().unwrap();
        for (wrong, field) in [
            (Settings { walks: 9, ..settings() }, "--walks"),
            (Settings { seconds: 61, ..settings() }, "--seconds"),
            (Settings { jobs: 0, ..settings() }, "--jobs"),
        ] {
            assert_eq!(wrong.check().unwrap_err().offending_field(), Some(field));
        }
    }
}
