//! Scores a world against the truth: walks through held-out scenes with held-out scripts, starting from the first picture and using only the
//! controls.

mod endurance;
mod memory;
mod page;
mod report;
mod response;
mod walk;

use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::world::{ControlScript, OperatingPoint, Preset, Schedule};

use crate::experiment::files::Files;
use crate::experiment::{self, Inputs, seed_list};
use crate::media::encode_small_png;
use crate::progress::Progress;
use crate::scene_id::SceneId;
use report::SceneResult;
use walk::{Tools, Walk};

pub use crate::experiment::Outcome;

/// Horizons in seconds after the last true picture.
const HORIZONS: [f64; 5] = [0.5, 1.0, 2.0, 5.0, 15.0];
/// Scene seeds that are walked, in each family.
const SEEDS: [u64; 8] = [41, 42, 43, 44, 45, 46, 47, 48];
/// Seconds turned away in the memory test.
const AWAY: [f64; 3] = [2.0, 4.0, 8.0];
/// Context windows compared in the memory test.
const WINDOWS: [u32; 2] = [384, 112];
/// Seconds for which the stock schedule is compared with the refined one.
const FEW_STEPS_SECONDS: f64 = 2.0;
/// Seconds of a walk with `--quick`, which also uses one scene of each family and the shortest time away.
const QUICK_SECONDS: f64 = 5.0;

/// Settings of the measurement.
#[derive(Debug, Clone)]
pub struct Settings {
    /// A quick run uses one scene of each family, short walks, and the shortest time away.
    pub common: experiment::Settings,
    /// Whether the memory test runs.
    pub memory: bool,
}

impl Settings {
    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument` for a scene seed that is not held out, or that is sealed.
    pub fn check(&self) -> Result<()> {
        self.common.check()
    }

    /// The command line that measures the same.
    fn command(&self) -> String {
        let memory = if self.memory { "" } else { " --no-memory" };
        self.common.command("world-quality") + memory
    }

    fn seeds(&self) -> &[u64] {
        self.common.seeds(&SEEDS)
    }
}

/// Measures a world.
///
/// # Errors
/// An unusable world, missing weights of LPIPS, and errors of making latents.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
    let inputs = Inputs::open(&settings.common, progress)?;
    let (bundle, lpips) = (&inputs.bundle, &inputs.lpips);
    let seconds = if settings.common.quick { QUICK_SECONDS } else { HORIZONS[HORIZONS.len() - 1] };
    let away = match (settings.memory, settings.common.quick) {
        (false, _) => &[][..],
        (true, true) => &AWAY[..1],
        (true, false) => &AWAY,
    };

    let mut results = Vec::new();
    // Further windows are used by the memory test only.
    let windows = windows(bundle).into_iter().take(if settings.memory { usize::MAX } else { 1 });
    for (number, window) in windows.enumerate() {
        let point = OperatingPoint { global_window: window, ..Preset::Coherence.operating_point() };
        point.check_for(bundle.geometry())?;
        let world = inputs.load(&point)?;
        let tools = Tools { point: &point, lpips: lpips.as_ref(), stop };
        for (n, scene) in SceneId::all(settings.seeds()).into_iter().enumerate() {
            progress.phase(&format!("{scene} at g{window}"));
            if number == 0 {
                let script = ControlScript::parse(scene.family.script())?;
                let walked = Walk { scene, script: &script, seconds }.score(&world, &tools, &HORIZONS)?;
                let stock = OperatingPoint { schedule: Schedule::Stock, ..point.clone() };
                let tools = Tools { point: &stock, ..tools };
                let few_steps = Walk { scene, script: &script, seconds: FEW_STEPS_SECONDS };
                let few_steps = few_steps.score(&world, &tools, &HORIZONS)?;
                results.push(SceneResult { scene, walked, few_steps, remembered: Vec::new() });
            }
            // The memory test takes long, so it uses one scene of each family.
            for &away in away.iter().filter(|_| settings.seeds().first() == Some(&scene.seed)) {
                let remembered = memory::turn_away_and_back(scene, away, &world, &tools)?;
                results[n].remembered.push(remembered);
            }
        }
    }

    let rate = Preset::Coherence.operating_point().latents_per_second;
    let mut text = head(settings, bundle);
    text += &report::text(&results, &HORIZONS, rate);
    let [good, bad] = report::extremes(&results).map(|results| report::sheet(&results));
    let (good, bad) = (good?, bad?);
    let mut files = Files::default();
    files.add("world-quality.txt", text.as_str());
    files.add("world-quality.csv", report::csv(&results));
    files.add("world-quality-lasting.csv", report::lasting_csv(&results, rate));
    files.add("world-quality-good.png", encode_small_png(&good)?);
    files.add("world-quality-bad.png", encode_small_png(&bad)?);
    let mut files = files.write(&settings.common.out)?;
    if settings.common.publish {
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

/// Heading with the world and the scenes.
fn head(settings: &Settings, bundle: &Bundle) -> String {
    let manifest = bundle.manifest();
    let mut text = format!("{}, {}\n", manifest.name, Preset::Coherence.name());
    if manifest.provenance.get("weights").is_some_and(|weights| weights.starts_with("random")) {
        text += "This world has random weights: its figures say nothing.\n";
    }
    text + &format!(
        "places {}: all on the held-out list, which training refuses; scripts of samples/scripts\n\n",
        seed_list(settings.seeds(), ", ")
    )
}
