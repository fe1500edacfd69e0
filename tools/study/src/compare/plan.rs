//! Plan of a comparison: cells, one per scene, place and branch, and their folders.
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

/// Seed of the first place of each kind; the others follow. No world was trained on any of them.
pub(crate) const FIRST_PLACE: u64 = 41;
/// Maximum number of places of a kind.
const MAX_PLACES: u64 = 100;

/// Settings of a comparison: everything that affects a number, and the number of parallel rollouts.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// Kinds of places.
    pub(crate) scenes: Vec<Family>,
    /// Places of each kind, from [`FIRST_PLACE`] on.
    pub(crate) places: u64,
    /// Decimal seconds of world time.
    pub(crate) seconds: String,
    /// `[width, height]` of the compared frames.
    pub(crate) size: [u32; 2],
    /// The bundle; `None` for the library's own.
    pub(crate) world: Option<PathBuf>,
    /// Device on which the world runs.
    pub(crate) device: DeviceChoice,
    /// Generator of frames between anchors, for branches that have such frames.
    pub(crate) generator: GeneratorChoice,
    /// `lanczos` or `catmull-rom`.
    pub(crate) upscaler: String,
    /// Threads of a pass; a setting of every cell, so that numbers do not depend on `jobs`.
    pub(crate) threads: usize,
    /// Whether LPIPS is measured; its weights are fetched if they are missing.
    pub(crate) lpips: bool,
    /// Number of rollouts that run in parallel.
    pub(crate) jobs: usize,
    /// Output folder.
    pub(crate) out: PathBuf,
    /// Another folder for the report and its figures, without the rollouts.
    pub(crate) publish: Option<PathBuf>,
}

/// A place of a kind: one generated scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    /// Kind of the place.
    pub(crate) family: Family,
    /// Seed of the place, and of the noise.
    pub(crate) seed: u64,
}

/// One rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cell {
    /// The place.
    pub(crate) place: Place,
    /// Operating point.
    pub(crate) branch: Branch,
    /// Whether this is the walk without the mouse, the reference for the first turn.
    pub(crate) straight: bool,
}

/// Branches whose turns are compared: the paper's two.
const TURNING: [Branch; 2] = [Branch::Coherence, Branch::Baseline];

impl Place {
    /// Folder of the place.
    pub(crate) fn folder(self, out: &Path) -> PathBuf {
        out.join(format!("{}-{}", self.family, self.seed))
    }

    /// Seed picture of all branches.
    pub(crate) fn seed_picture(self, out: &Path) -> PathBuf {
        self.folder(out).join("seed.png")
    }

    /// Control script of all branches; with `straight`, the one without the mouse.
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
    /// Name of the cell within its place, and of its folder.
    fn name(self) -> String {
        format!("{}{}", self.branch.name(), if self.straight { "-straight" } else { "" })
    }

    /// Folder of the cell.
    pub(crate) fn folder(self, out: &Path) -> PathBuf {
        self.place.folder(out).join(self.name())
    }

    /// The rollout that makes the cell.
    pub(crate) fn rollout(self, settings: &Settings) -> Rollout {
        let Place { family, seed } = self.place;
        let out = &settings.out;
        // Only scripts with a turn have a straight walk with a length.
        let short = straight_seconds(family, &settings.seconds).ok().flatten().filter(|_| self.straight);
        let shared = self.branch.shares_latents_of().map(|branch| Self { branch, ..self });
        let point = self.branch.point(family);
        // Without generated frames the generator does not matter; cells made with another one are kept.
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
            // Only PNG is lossless.
            formats: Formats { png: true, ..Formats::default() },
            threads: Some(settings.threads),
            device: settings.device,
            generator: if generates { settings.generator } else { GeneratorChoice::Cpu },
        }
    }
}

impl Settings {
    /// All places, kind by kind.
    pub(crate) fn places(&self) -> impl Iterator<Item = Place> + '_ {
        let seeds = FIRST_PLACE..FIRST_PLACE + self.places;
        self.scenes.iter().flat_map(move |&family| seeds.clone().map(move |seed| Place { family, seed }))
    }

    /// All cells, place by place: all branches, then the straight walks if the walk has a turn.
    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.places().flat_map(|place| {
            let turns = straight_seconds(place.family, &self.seconds).is_ok_and(|seconds| seconds.is_some());
            let straight = TURNING.into_iter().filter(move |_| turns).map(|branch| (branch, true));
            let all = Branch::ALL.into_iter().map(|branch| (branch, false)).chain(straight);
            all.map(move |(branch, straight)| Cell { place, branch, straight })
        })
    }

    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument`, naming the option.
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
