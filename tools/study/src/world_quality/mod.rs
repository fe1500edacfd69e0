//! Scores a world against the truth: held-out walks through the levels that it knows, and walks through places that it has never seen. A
//! rollout starts from the first true picture and gets only the controls.
//!
//! ```text
//! gallery (true pictures from everywhere in a level) -> probe (classifiers), search of poses
//! place -> walk (rollout beside the truth) + memory -> store (kept walks) -> figures -> report, page
//! ```

mod csv;
mod discrepancy;
mod endurance;
mod figures;
mod gallery;
mod memory;
mod page;
mod place;
mod probe;
mod report;
mod response;
mod sheet;
mod store;
mod walk;
pub mod weights;

use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::world::{OperatingPoint, Preset, Schedule};

use crate::experiment::files::Files;
use crate::experiment::{self, Inputs, seed_list};
use crate::level::{self, HELD_OUT_SECONDS, HELD_OUT_WALKS};
use crate::progress::Progress;
use figures::{Results, WalkResult};
use media::encode_small_png;
use place::TestWalk;
use store::Store;
use walk::{Judges, Tools};

pub use crate::experiment::ExperimentOutcome;

/// Scene seeds of the places that were never seen.
const SEEDS: [u64; 2] = [41, 42];
/// Held-out walks of each level, and places that were never seen, of the published page.
pub const WALKS: u32 = 3;
/// Seconds of a walk of the published page.
pub const SECONDS: u32 = 15;
/// Seconds turned away in the memory test.
const AWAY: [f64; 3] = [2.0, 4.0, 8.0];
/// Seconds for which the stock schedule is compared with the refined one.
const FEW_STEPS_SECONDS: f64 = 2.0;
/// Seconds of a walk with `--quick`, which also uses one walk of each level, the shortest time away and fewer true pictures.
const QUICK_SECONDS: u32 = 5;
/// How many times as sparse the grid of true pictures is with `--quick`.
const QUICK_SPACING: f32 = 4.0;

/// Settings of the measurement.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The seeds are those of the places that were never seen.
    pub common: experiment::Settings,
    /// Held-out walks of each level, 1 to 8, and the number of places that were never seen. A quick run uses one.
    pub walks: u32,
    /// Length of a walk in seconds, 1 to 60. A quick run uses 5.
    pub seconds: u32,
    /// Walks of each level in which the memory test runs; 0 to leave it out.
    pub looks_away: u32,
}

impl Settings {
    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument` for a scene seed that is not held out, or that is sealed, and for walks that do not exist.
    pub fn check(&self) -> Result<()> {
        self.common.check()?;
        level::check_held_out(self.walks, self.seconds)
    }

    /// The command line that measures the same.
    fn command(&self) -> String {
        let mut command = self.common.command("world-quality");
        for (option, value, default) in
            [("walks", self.walks, WALKS), ("seconds", self.seconds, SECONDS), ("looks-away", self.looks_away, 1)]
        {
            if value != default {
                command += &format!(" --{option} {value}");
            }
        }
        command
    }

    fn walks(&self) -> u32 {
        if self.common.quick { 1 } else { self.walks }
    }

    fn seconds(&self) -> u32 {
        if self.common.quick { QUICK_SECONDS } else { self.seconds }
    }

    /// Seconds turned away in the memory test of a place.
    fn away(&self, place: TestWalk) -> &'static [f64] {
        match place {
            TestWalk::Level(_, number) if number < self.looks_away => {
                &AWAY[..if self.common.quick { 1 } else { AWAY.len() }]
            }
            _ => &[],
        }
    }
}

/// Measures a world. Finished walks are kept in the output folder's folder `walks` and measured once.
///
/// # Errors
/// Invalid settings, an unusable world, missing weights of LPIPS, errors of making latents; `Cancelled` when `stop` was set.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<ExperimentOutcome> {
    settings.check()?;
    let inputs = Inputs::open(&settings.common, progress)?;
    let (bundle, lpips) = (&inputs.bundle, inputs.lpips.as_ref());
    let preset = Preset::Coherence.operating_point();
    let point = OperatingPoint { global_window: window(bundle, preset.global_window), ..preset };
    point.check_for(bundle.geometry())?;
    let stock = OperatingPoint { schedule: Schedule::Stock, ..point.clone() };
    let spacing = if settings.common.quick { QUICK_SPACING } else { 1.0 };

    let (mut judges, mut world) = (None, None);
    let mut results = Vec::new();
    for place in TestWalk::all(settings.walks(), settings.common.seeds(&SEEDS)) {
        let seconds = match place {
            TestWalk::Level(..) => settings.seconds(),
            // The scripts of the scenes are this long.
            TestWalk::Unseen(..) => settings.seconds().min(SECONDS),
        };
        let measured = [
            format!("world {:?}", bundle.digest()),
            format!("{point:?}, {seconds} s, away {:?}", settings.away(place)),
            format!("lpips {}, spacing {spacing}", lpips.is_some()),
        ];
        let store = Store::new(settings.common.out.join("walks"), &measured);
        let (walked, shown) = match store.find(place)? {
            Some(kept) => kept,
            None => {
                let judges = match &judges {
                    Some(judges) => judges,
                    None => judges.insert(Judges::new(lpips, spacing, progress, stop)?),
                };
                let world = match &world {
                    Some(world) => world,
                    None => world.insert(inputs.load(&point)?),
                };
                progress.phase(&place.to_string());
                let course = place.course()?;
                let tools = Tools { point: &point, lpips, judges, stop };
                let (mut walked, shown) = walk::score(place, &course, seconds.into(), world, &tools)?;
                let few = Tools { point: &stock, ..tools };
                walked.few_steps =
                    walk::scores_alone(place, &course, FEW_STEPS_SECONDS.min(seconds.into()), world, &few)?;
                walked.remembered = memory::turn_away_and_back(place, &course, settings.away(place), world, &tools)?;
                store.keep(place, &walked, &shown)?;
                (walked, shown)
            }
        };
        results.push(WalkResult { place, walked, shown });
    }

    let results = Results { all: results, latents_per_second: point.latents_per_second };
    let text = head(settings, bundle, &point) + &report::text(&results);
    let [good, bad] = figures::extremes(&results.all, sheet::SHOWN).map(|results| sheet::draw(&results));
    let (good, bad) = (good?, bad?);
    let mut files = Files::default();
    files.add("world-quality.txt", text.as_str());
    files.add("world-quality.csv", csv::scores(&results));
    files.add("world-quality-lasting.csv", csv::seconds(&results));
    files.add("world-quality-poses.csv", csv::poses(&results));
    files.add("world-quality-good.png", encode_small_png(&good)?);
    files.add("world-quality-bad.png", encode_small_png(&bad)?);
    let mut files = files.write(&settings.common.out)?;
    if settings.common.publish {
        files.extend(page::publish(&settings.command(), &text, [&good, &bad], bundle.digest())?);
    }
    Ok(ExperimentOutcome { text, files })
}

/// The context window: `wanted` if the world declares it, otherwise the world's own.
fn window(bundle: &Bundle, wanted: u32) -> u32 {
    let global = bundle.geometry().global;
    let is_declared = wanted <= global.max_window && wanted.is_multiple_of(global.dilation);
    if is_declared { wanted } else { global.window }
}

/// Heading with the world and the walks.
fn head(settings: &Settings, bundle: &Bundle, point: &OperatingPoint) -> String {
    let manifest = bundle.manifest();
    let mut text = format!("{}, {}, g{}\n", manifest.name, Preset::Coherence.name(), point.global_window);
    if manifest.provenance.get("weights").is_some_and(|weights| weights.starts_with("random")) {
        text += "This world has random weights: its figures say nothing.\n";
    }
    let (walks, seconds) = (settings.walks(), settings.seconds());
    let places = TestWalk::all(walks, settings.common.seeds(&SEEDS));
    let unseen = places.iter().filter(|place| matches!(place, TestWalk::Unseen(..))).count();
    text + &format!(
        "levels: {walks} of {HELD_OUT_WALKS} held-out walks of each, {seconds} of {HELD_OUT_SECONDS} s: training refuses them\n\
         unseen: {unseen} walks of {} s through the places {}, in turn of each kind, with the scripts of samples/scripts: all on the held-out list\n\n",
        seconds.min(SECONDS),
        seed_list(settings.common.seeds(&SEEDS), ", ")
    )
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use cairn::ErrorKind;
    use scenes::Family;

    use super::*;

    fn settings() -> Settings {
        let common = experiment::Settings {
            world: None,
            seeds: Vec::new(),
            quick: false,
            lpips: true,
            publish: true,
            out: PathBuf::from("out"),
        };
        Settings { common, walks: WALKS, seconds: SECONDS, looks_away: 1 }
    }

    #[test]
    fn the_command_measures_the_same() {
        assert_eq!(settings().command(), "cargo run --release -p study -- world-quality --publish");
        let all = Settings { walks: 8, seconds: 60, looks_away: 0, ..settings() };
        assert!(all.command().ends_with(" --publish --walks 8 --seconds 60 --looks-away 0"), "{}", all.command());
        all.check().unwrap();
        for wrong in [
            Settings { walks: 9, ..settings() },
            Settings { walks: 0, ..settings() },
            Settings { seconds: 61, ..settings() },
        ] {
            assert_eq!(wrong.check().unwrap_err().kind(), ErrorKind::InvalidArgument);
        }
    }

    #[test]
    fn looks_away_are_those_of_the_first_walks() {
        let settings = settings();
        assert_eq!(settings.away(TestWalk::Level(Family::Snow, 0)), AWAY);
        assert!(settings.away(TestWalk::Level(Family::Snow, 1)).is_empty());
        assert!(settings.away(TestWalk::Unseen(Family::Snow, 41)).is_empty());
    }
}
