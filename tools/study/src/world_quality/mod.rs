//! Scores a world against the truth: walks through held-out places with held-out scripts, starting from the first picture and using only the
//! controls.

mod endurance;
pub(crate) mod held_out;
mod memory;
mod page;
mod report;
mod response;
mod walk;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::runtime::{CpuOptions, Device};
use cairn::world::{ControlScript, OperatingPoint, Preset, Schedule, World, WorldOptions};
use scenes::FAMILIES;

use crate::inputs;
use crate::media::{RealDisk, describe_io, encode_small_png, write_whole};
use crate::metrics::Net;
use crate::progress::Progress;
use crate::reconstruct::script_of;
use report::Place;
use walk::{Tools, Walk};

/// Horizons in seconds after the last true picture.
const HORIZONS: [f64; 5] = [0.5, 1.0, 2.0, 5.0, 15.0];
/// Scene seeds that are walked, for each kind of place.
const SEEDS: [u64; 8] = [41, 42, 43, 44, 45, 46, 47, 48];
/// Seconds turned away in the memory test.
const AWAY: [f64; 3] = [2.0, 4.0, 8.0];
/// Context windows compared in the memory test.
const WINDOWS: [u32; 2] = [384, 112];
/// Seconds for which the stock schedule is compared with the refined one.
const FEW_STEPS_SECONDS: f64 = 2.0;
/// Seconds of a walk with `--quick`, which also uses one place of each kind and the shortest time away.
const QUICK_SECONDS: f64 = 5.0;

/// Settings of the measurement.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// The bundle; `None` for the library's own.
    pub(crate) world: Option<PathBuf>,
    /// Scene seeds; empty for the usual ones.
    pub(crate) seeds: Vec<u64>,
    pub(crate) quick: bool,
    /// Whether LPIPS is measured; its weights are fetched if they are missing.
    pub(crate) lpips: bool,
    /// Whether the memory test runs.
    pub(crate) memory: bool,
    /// Also writes the page and the pictures into the repository's docs.
    pub(crate) publish: bool,
    pub(crate) out: PathBuf,
}

impl Settings {
    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument` for a scene seed that is not held out.
    pub(crate) fn check(&self) -> Result<()> {
        held_out::require(&self.seeds)
    }

    /// The command line that measures the same.
    fn command(&self) -> String {
        let mut command = String::from("cargo run --release -p study -- world-quality --publish");
        if self.quick {
            command += " --quick";
        }
        if !self.seeds.is_empty() {
            let seeds: Vec<String> = self.seeds.iter().map(u64::to_string).collect();
            command += &format!(" --seeds {}", seeds.join(","));
        }
        if !self.lpips {
            command += " --no-lpips";
        }
        if !self.memory {
            command += " --no-memory";
        }
        command
    }

    fn seeds(&self) -> &[u64] {
        match (self.seeds.is_empty(), self.quick) {
            (false, _) => &self.seeds,
            (true, true) => &SEEDS[..1],
            (true, false) => &SEEDS,
        }
    }
}

/// Result of the measurement.
pub(crate) struct Outcome {
    /// Summary for the terminal.
    pub(crate) text: String,
    /// Files that were written.
    pub(crate) files: Vec<PathBuf>,
}

/// Measures a world.
///
/// # Errors
/// An unusable world, missing weights of LPIPS, and errors of making latents.
pub(crate) fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
    settings.check()?;
    let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
    let (ort, _) = inputs::onnxruntime(progress)?;
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    let device = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
    let seconds = if settings.quick { QUICK_SECONDS } else { HORIZONS[HORIZONS.len() - 1] };
    let away = match settings {
        Settings { memory: false, .. } => &[][..],
        Settings { quick: true, .. } => &AWAY[..1],
        _ => &AWAY,
    };

    let mut places = Vec::new();
    // Further windows are used by the memory test only.
    let windows = windows(&bundle).into_iter().take(if settings.memory { usize::MAX } else { 1 });
    for (number, window) in windows.enumerate() {
        let point = OperatingPoint { global_window: window, ..Preset::Coherence.operating_point() };
        let world = load(&device, &bundle, &point)?;
        let tools = Tools { point: &point, lpips: lpips.as_ref(), stop };
        for (n, (family, scene)) in places_of(settings.seeds()).enumerate() {
            progress.phase(&format!("{family} {scene} at g{window}"));
            if number == 0 {
                let script = ControlScript::parse(script_of(family))?;
                let walked = Walk { family, scene, script: &script, seconds }.score(&world, &tools, &HORIZONS)?;
                let stock = OperatingPoint { schedule: Schedule::Stock, ..point.clone() };
                let tools = Tools { point: &stock, ..tools };
                let few_steps = Walk { family, scene, script: &script, seconds: FEW_STEPS_SECONDS };
                let few_steps = few_steps.score(&world, &tools, &HORIZONS)?;
                places.push(Place { family, scene, walked, few_steps, remembered: Vec::new() });
            }
            // The memory test takes long, so it uses one place of each kind.
            for &away in away.iter().filter(|_| settings.seeds().first() == Some(&scene)) {
                let remembered = memory::turn_away_and_back(family, scene, away, &world, &tools)?;
                places[n].remembered.push(remembered);
            }
        }
    }

    let rate = Preset::Coherence.operating_point().latents_per_second;
    let mut text = head(settings, &bundle);
    text += &report::text(&places, &HORIZONS, rate);
    std::fs::create_dir_all(&settings.out).map_err(|e| describe_io("it cannot be made", &settings.out, &e))?;
    let [good, bad] = report::extremes(&places).map(|shown| encode_small_png(&report::sheet(&shown)?));
    let (good, bad) = (good?, bad?);
    let mut files = Vec::new();
    for (name, bytes) in [
        ("world-quality.txt", text.as_bytes()),
        ("world-quality.csv", report::csv(&places).as_bytes()),
        ("world-quality-lasting.csv", report::lasting_csv(&places, rate).as_bytes()),
        ("world-quality-good.png", &good),
        ("world-quality-bad.png", &bad),
    ] {
        let path = settings.out.join(name);
        write_whole(&RealDisk, &path, bytes)?;
        files.push(path);
    }
    if settings.publish {
        files.extend(page::publish(&settings.command(), &text, &good, &bad)?);
    }
    Ok(Outcome { text, files })
}

/// Context windows for the memory test that the world declares; the world's own if it declares none of them.
fn windows(bundle: &Bundle) -> Vec<u32> {
    let global = bundle.geometry().global;
    let declared = |g: &u32| *g <= global.max_window && g.is_multiple_of(global.dilation);
    let all: Vec<u32> = WINDOWS.into_iter().filter(declared).collect();
    if all.is_empty() { vec![global.window] } else { all }
}

/// Every kind of place with every seed.
fn places_of(seeds: &[u64]) -> impl Iterator<Item = (scenes::Family, u64)> + '_ {
    FAMILIES.into_iter().flat_map(move |family| seeds.iter().map(move |&seed| (family, seed)))
}

fn load(device: &Device, bundle: &Arc<Bundle>, point: &OperatingPoint) -> Result<Arc<World>> {
    point.check_for(bundle.geometry())?;
    let options = WorldOptions { global_window: Some(point.global_window), ..WorldOptions::default() };
    World::load(device, bundle, options)
}

/// Heading with the world and the places.
fn head(settings: &Settings, bundle: &Bundle) -> String {
    let manifest = bundle.manifest();
    let seeds: Vec<String> = settings.seeds().iter().map(u64::to_string).collect();
    let mut text = format!("{}, {}\n", manifest.name, Preset::Coherence.name());
    if manifest.provenance.get("weights").is_some_and(|weights| weights.starts_with("random")) {
        text += "This world has random weights: its figures say nothing.\n";
    }
    text + &format!(
        "places {}: all on the held-out list, which training refuses; scripts of samples/scripts\n\n",
        seeds.join(", ")
    )
}
