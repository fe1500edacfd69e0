//! Plan of a comparison: its cells, one for each scene and branch, and their folders.
//!
//! ```text
//! OUT/forest-41/seed.png, script.txt      inputs of all branches of a scene
//! OUT/forest-41/coherence/manifest.json   a rollout, beside its frames
//! OUT/forest-41/baseline/manifest.json
//! OUT/forest-41/baseline-straight/        the first seconds again without the mouse, from script-straight.txt
//! ```

use std::path::{Path, PathBuf};

use cairn::world::Presentation;
use cairn::{Error, ErrorKind, Result};
use scenes::Family;

use super::branch::Branch;
use super::walk::straight_seconds;
use crate::device::DeviceChoice;
use crate::experiment::held_out;
use crate::generator::GeneratorChoice;
use crate::metrics::{Net, SSIM_WINDOW};
use crate::output::LATENTS;
use crate::scene_id::SceneId;
use crate::seed_picture::MAX_SIDE;
use crate::sets;
use crate::settings::{Formats, Settings as Rollout};
use crate::workers::check_jobs;

/// Seed of the first scene of each family; the others follow. The miniature world was not trained on any of them.
pub(crate) const FIRST_SEED: u64 = 41;
/// Maximum number of scenes of a family.
const MAX_SCENES_PER_FAMILY: u64 = 100;

/// Settings of a comparison: everything that affects a number, and the number of parallel rollouts.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Families of the scenes.
    pub families: Vec<Family>,
    /// Number of scenes of each family, with seeds from 41 on.
    pub scenes_per_family: u64,
    /// Decimal seconds of world time.
    pub seconds: String,
    /// `[width, height]` of the compared frames.
    pub size: [u32; 2],
    /// The bundle; `None` for the library's own.
    pub world: Option<PathBuf>,
    /// Device on which the world runs.
    pub device: DeviceChoice,
    /// Generator of frames between anchors, for branches that have such frames.
    pub generator: GeneratorChoice,
    /// `lanczos` or `catmull-rom`.
    pub upscaler: String,
    /// Threads of a pass; a setting of every cell, so that numbers do not depend on `jobs`.
    pub threads: usize,
    /// Whether LPIPS is measured; its weights are fetched if they are missing.
    pub lpips: bool,
    /// Number of rollouts that run in parallel.
    pub jobs: usize,
    /// Output folder.
    pub out: PathBuf,
    /// Another folder for the report as Markdown with compressed figures, without the page and the rollouts.
    pub publish: Option<PathBuf>,
}

/// One rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cell {
    /// The scene.
    pub(crate) scene: SceneId,
    /// Operating point.
    pub(crate) branch: Branch,
    /// Whether this is the walk without the mouse, the reference for the first turn.
    pub(crate) straight: bool,
}

/// Branches whose turn onsets are compared: the paper's two, and the first with the best motion.
const TURNING: [Branch; 3] = [Branch::Coherence, Branch::CoherenceBest, Branch::Baseline];

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {}", self.scene, self.name())
    }
}

impl Cell {
    /// Name of the cell within its scene, and of its folder.
    fn name(self) -> String {
        format!("{}{}", self.branch.name(), if self.straight { "-straight" } else { "" })
    }

    /// Folder of the cell.
    pub(crate) fn folder(self, out: &Path) -> PathBuf {
        self.scene.folder(out).join(self.name())
    }

    /// The rollout that makes the cell.
    pub(crate) fn rollout(self, settings: &Settings) -> Rollout {
        let SceneId { family, seed } = self.scene;
        let out = &settings.out;
        // Only scripts with a turn have a straight walk with a length.
        let short = straight_seconds(family, &settings.seconds).ok().flatten().filter(|_| self.straight);
        let shared = self.branch.shares_latents_of().map(|branch| Self { branch, ..self });
        let point = self.branch.point(family);
        // Without generated frames the generator does not matter; cells made with another one are kept.
        let generates = matches!(point.presentation, Presentation::Generated { .. });
        Rollout {
            world: settings.world.clone(),
            seed_picture: Some(self.scene.seed_picture(out)),
            script: Some(self.scene.script(out, self.straight)),
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
    /// The first place of a kind, which the report shows.
    pub(super) fn first_place(&self, family: Family) -> Option<SceneId> {
        self.scenes().find(|scene| scene.family == family)
    }

    /// All scenes, family by family.
    pub(crate) fn scenes(&self) -> impl Iterator<Item = SceneId> + '_ {
        let seeds = FIRST_SEED..FIRST_SEED + self.scenes_per_family;
        self.families.iter().flat_map(move |&family| seeds.clone().map(move |seed| SceneId { family, seed }))
    }

    /// All cells, scene by scene: all branches, then the straight walks if the walk has a turn.
    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.scenes().flat_map(|scene| {
            let turns = straight_seconds(scene.family, &self.seconds).is_ok_and(|seconds| seconds.is_some());
            let straight = TURNING.into_iter().filter(move |_| turns).map(|branch| (branch, true));
            let all = Branch::ALL.into_iter().map(|branch| (branch, false)).chain(straight);
            all.map(move |(branch, straight)| Cell { scene, branch, straight })
        })
    }

    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument`, naming the option.
    pub fn check(&self) -> Result<()> {
        let refused = |cause: String, field: &str, remedy: String| {
            Err(Error::new(ErrorKind::InvalidArgument, cause).field(field).remedy(remedy))
        };
        if !(1..=MAX_SCENES_PER_FAMILY).contains(&self.scenes_per_family) {
            return refused(
                format!("{} places of a kind cannot be compared", self.scenes_per_family),
                "--seeds",
                format!("Use 1 to {MAX_SCENES_PER_FAMILY}"),
            );
        }
        check_jobs(self.jobs)?;
        let least = if self.lpips { Net::Alex.smallest_side() } else { SSIM_WINDOW as u32 };
        let [width, height] = self.size;
        if self.size.iter().any(|side| !(least..=MAX_SIDE).contains(side)) {
            return refused(
                format!("streams cannot be compared at {width}x{height}"),
                "--size",
                format!("Use a width and a height from {least} to {MAX_SIDE}, such as 640x360"),
            );
        }
        let seeds: Vec<u64> = self.scenes().map(|scene| scene.seed).collect();
        held_out::require(&seeds)?;
        sets::require_unsealed(&seeds, "--seeds")?;
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
            families: vec![Family::Forest, Family::Snow],
            scenes_per_family: 2,
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
        for scene in settings.scenes() {
            let [first, others @ ..] =
                Branch::ALL.map(|branch| Cell { scene, branch, straight: false }.rollout(&settings));
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
            (Settings { scenes_per_family: 0, ..base() }, "--seeds"),
            (Settings { scenes_per_family: 1000, ..base() }, "--seeds"),
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
