//! What a comparison consists of: cells, one for each scene, place and branch, and where they lie.
//!
//! ```text
//! OUT/forest-41/seed.png, script.txt      what all branches of a place start from
//! OUT/forest-41/coherence/manifest.json   a rollout, beside its frames
//! OUT/forest-41/baseline/manifest.json
//! OUT/forest-41/baseline-straight/        the first seconds again without the mouse, from script-straight.txt
//! ```

use std::path::{Path, PathBuf};

use cairn::world::Presentation;
use cairn::{Error, ErrorKind, Result};
use scenes::Family;

use super::branch::Branch;
use super::turn::straight_seconds;
use crate::device::DeviceChoice;
use crate::generator::GeneratorChoice;
use crate::metrics::{Net, SSIM_WINDOW};
use crate::output::LATENTS;
use crate::place::MOST;
use crate::settings::{Formats, Settings as Rollout};
use crate::workers::check_jobs;
use crate::world_quality::held_out;

/// The first place of each kind; the others follow it. No world was trained on any of them.
pub(crate) const FIRST_PLACE: u64 = 41;
/// The most places of a kind.
const MAX_PLACES: u64 = 100;

/// What is compared: everything that decides a number, and how many rollouts are made at a time.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// Kinds of places.
    pub(crate) scenes: Vec<Family>,
    /// Places of each kind, from [`FIRST_PLACE`] on.
    pub(crate) places: u64,
    /// Decimal seconds of world time.
    pub(crate) seconds: String,
    /// `[width, height]` at which everything is compared.
    pub(crate) size: [u32; 2],
    /// The bundle; none for the library's own.
    pub(crate) world: Option<PathBuf>,
    /// Where the world runs.
    pub(crate) device: DeviceChoice,
    /// What makes frames between anchors, where a branch has such.
    pub(crate) generator: GeneratorChoice,
    /// `lanczos` or `catmull-rom`.
    pub(crate) upscaler: String,
    /// Threads of a pass; a setting of every cell, so that numbers do not depend on `jobs`.
    pub(crate) threads: usize,
    /// Whether LPIPS is measured; its weights are fetched where they are not there.
    pub(crate) lpips: bool,
    /// Rollouts made at a time.
    pub(crate) jobs: usize,
    /// The folder for everything.
    pub(crate) out: PathBuf,
    /// Another folder for the report and its figures, without the rollouts.
    pub(crate) publish: Option<PathBuf>,
}

/// A place of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    /// Its kind.
    pub(crate) family: Family,
    /// Which one; also the seed of the noise.
    pub(crate) seed: u64,
}

/// One rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cell {
    /// Where it starts.
    pub(crate) place: Place,
    /// How the world is run.
    pub(crate) branch: Branch,
    /// Whether it is the walk without the mouse, which the first turn is compared with.
    pub(crate) straight: bool,
}

/// The branches whose turns are compared: the paper's.
const TURNING: [Branch; 2] = [Branch::Coherence, Branch::Baseline];

impl Place {
    /// Its folder.
    pub(crate) fn folder(self, out: &Path) -> PathBuf {
        out.join(format!("{}-{}", self.family, self.seed))
    }

    /// The picture that every branch starts from.
    pub(crate) fn seed_picture(self, out: &Path) -> PathBuf {
        self.folder(out).join("seed.png")
    }

    /// The controls that every branch follows; with `straight`, those without the mouse.
    pub(crate) fn script(self, out: &Path, straight: bool) -> PathBuf {
        self.folder(out).join(if straight { "script-straight.txt" } else { "script.txt" })
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.family, self.seed)
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {}", self.place, self.name())
    }
}

impl Cell {
    /// Its name among the cells of its place, and that of its folder.
    fn name(self) -> String {
        format!("{}{}", self.branch.name(), if self.straight { "-straight" } else { "" })
    }

    /// Its folder.
    pub(crate) fn folder(self, out: &Path) -> PathBuf {
        self.place.folder(out).join(self.name())
    }

    /// The rollout that it is.
    pub(crate) fn rollout(self, settings: &Settings) -> Rollout {
        let Place { family, seed } = self.place;
        let out = &settings.out;
        // A straight walk is planned only where it has a length.
        let short = straight_seconds(family, &settings.seconds).ok().flatten().filter(|_| self.straight);
        let shared = self.branch.shares_latents_of().map(|branch| Self { branch, ..self });
        let point = self.branch.point(family);
        // Where nothing is generated nothing depends on it, and what was made with another is kept.
        let generates = matches!(point.presentation, Presentation::Generated { .. });
        Rollout {
            world: settings.world.clone(),
            seed_picture: Some(self.place.seed_picture(out)),
            script: Some(self.place.script(out, self.straight)),
            latents: shared.map(|cell| cell.folder(out).join(LATENTS)),
            preset: None,
            operating_point: point.to_string(),
            seconds: short.unwrap_or_else(|| settings.seconds.clone()),
            seed,
            size: settings.size,
            upscaler: settings.upscaler.clone(),
            // Nothing but PNG keeps every bit of a frame.
            formats: Formats { png: true, ..Formats::default() },
            threads: Some(settings.threads),
            device: settings.device,
            generator: if generates { settings.generator } else { GeneratorChoice::Cpu },
        }
    }
}

impl Settings {
    /// Every place, kind by kind.
    pub(crate) fn places(&self) -> impl Iterator<Item = Place> + '_ {
        let seeds = FIRST_PLACE..FIRST_PLACE + self.places;
        self.scenes.iter().flat_map(move |&family| seeds.clone().map(move |seed| Place { family, seed }))
    }

    /// Every cell, place by place: all branches, then the straight walks where the walk has a turn in it.
    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.places().flat_map(|place| {
            let turns = straight_seconds(place.family, &self.seconds).is_ok_and(|seconds| seconds.is_some());
            let straight = TURNING.into_iter().filter(move |_| turns).map(|branch| (branch, true));
            let all = Branch::ALL.into_iter().map(|branch| (branch, false)).chain(straight);
            all.map(move |(branch, straight)| Cell { place, branch, straight })
        })
    }

    /// Refuses what makes no sense; needs no file.
    ///
    /// # Errors
    /// `InvalidArgument`, with the option.
    pub(crate) fn check(&self) -> Result<()> {
        let refused = |cause: String, field: &str, remedy: String| {
            Err(Error::new(ErrorKind::InvalidArgument, cause).field(field).remedy(remedy))
        };
        if !(1..=MAX_PLACES).contains(&self.places) {
            return refused(
                format!("{} places of a kind cannot be compared", self.places),
                "--seeds",
                format!("Use 1 to {MAX_PLACES}"),
            );
        }
        check_jobs(self.jobs)?;
        let least = if self.lpips { Net::Alex.smallest_side() } else { SSIM_WINDOW as u32 };
        let [width, height] = self.size;
        if self.size.iter().any(|side| !(least..=MOST).contains(side)) {
            return refused(
                format!("streams cannot be compared at {width}x{height}"),
                "--size",
                format!("Use a width and a height from {least} to {MOST}, such as 640x360"),
            );
        }
        held_out::require(&self.places().map(|place| place.seed).collect::<Vec<_>>())?;
        for cell in self.cells() {
            cell.rollout(self).check()?;
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::compare) fn settings(out: &Path) -> Settings {
        Settings {
            scenes: vec![Family::Forest, Family::Snow],
            places: 2,
            seconds: "1".into(),
            size: [64, 36],
            world: None,
            device: DeviceChoice::Cpu,
            generator: GeneratorChoice::Cpu,
            upscaler: "lanczos".into(),
            threads: 1,
            lpips: false,
            jobs: 1,
            out: out.to_owned(),
            publish: None,
        }
    }

    #[test]
    fn a_cell_is_one_scene_place_and_branch() {
        let settings = settings(Path::new("out"));
        settings.check().unwrap();
        let cells: Vec<Cell> = settings.cells().collect();
        assert_eq!(cells.len(), 2 * 2 * Branch::ALL.len());
        let folders: std::collections::BTreeSet<PathBuf> = cells.iter().map(|c| c.folder(&settings.out)).collect();
        assert_eq!(folders.len(), cells.len());
        assert!(
            folders.contains(Path::new("out/forest-41/coherence")) && folders.contains(Path::new("out/snow-42/heavy"))
        );
    }

    #[test]
    fn branches_of_a_place_differ_in_nothing_but_how_the_world_is_run() {
        let settings = settings(Path::new("out"));
        for place in settings.places() {
            let [first, others @ ..] =
                Branch::ALL.map(|branch| Cell { place, branch, straight: false }.rollout(&settings));
            for other in others {
                let alike = Rollout {
                    operating_point: first.operating_point.clone(),
                    latents: first.latents.clone(),
                    ..other.clone()
                };
                assert_eq!(alike, first);
            }
        }
    }

    #[test]
    fn straight_walks_are_planned_where_there_is_a_turn() {
        let settings = Settings { seconds: "15".into(), ..settings(Path::new("out")) };
        let straight: Vec<Cell> = settings.cells().filter(|cell| cell.straight).collect();
        assert_eq!(straight.len(), 2 * 2 * TURNING.len());
        let rollout = straight[0].rollout(&settings);
        assert_eq!(
            (rollout.seconds.as_str(), straight[0].to_string().as_str()),
            ("3.200", "forest 41, coherence-straight")
        );
        assert_eq!(rollout.script.as_deref(), Some(Path::new("out/forest-41/script-straight.txt")));
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let base = || settings(Path::new("out"));
        for (settings, option) in [
            (Settings { places: 0, ..base() }, "--seeds"),
            (Settings { places: 1000, ..base() }, "--seeds"),
            (Settings { jobs: 0, ..base() }, "--jobs"),
            (Settings { threads: 0, ..base() }, "--threads"),
            (Settings { seconds: "0".into(), ..base() }, "--seconds"),
            (Settings { size: [0, 9], ..base() }, "--size"),
            (Settings { upscaler: "best".into(), ..base() }, "--upscaler"),
        ] {
            let error = settings.check().unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some(option)));
        }
    }
}
