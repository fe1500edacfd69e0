//! Makes the missing cells, each in a process of its own: this program again, as `study rollout`.

use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::world::OperatingPoint;
use scenes::Scene;

use super::plan::{Cell, Settings};
use super::resume::{CellState, Digests, expect_rollout, find_rollout};
use super::walk;
use crate::experiment::cells::{Cells, complete};
use crate::inputs;
use crate::manifest::{Manifest, sha256};
use crate::output::LATENTS;
use crate::progress::Progress;
use crate::scene_id::SceneId;
use crate::seed_picture;
use crate::settings::Settings as Rollout;
use crate::workers::Work;
use media::{RealDisk, describe_io, encode_png, write_whole};

/// All cells, complete.
#[derive(Debug)]
pub(super) struct Rollouts {
    /// Every branch of every scene, in the plan's order.
    pub(super) cells: Vec<(Cell, Manifest)>,
    /// The walks without the mouse.
    pub(super) straight: Vec<(Cell, Manifest)>,
    /// Number of cells that were complete already.
    pub(super) kept: usize,
}

/// Inputs that all rollouts of a world share.
pub(crate) struct Common {
    /// Digest of the bundle.
    pub(crate) world: String,
    /// Digest of ONNX Runtime.
    pub(crate) onnxruntime: String,
}

/// Makes the missing cells.
///
/// # Errors
/// As [`find_rollout`]; errors of a rollout, with the cell named; `Cancelled` when `stop` was set.
pub(super) fn make(settings: &Settings, bundle: &Bundle, progress: &Progress, stop: &AtomicBool) -> Result<Rollouts> {
    let (_, onnxruntime) = inputs::onnxruntime(progress)?;
    for cell in settings.cells() {
        cell.branch.point(cell.scene.family).check_for(bundle.geometry())?;
    }
    let common = Common { world: bundle.digest().to_owned(), onnxruntime: onnxruntime.sha256 };
    progress.phase("drawing the seed pictures");
    for scene in settings.scenes() {
        prepare(scene, &settings.out, bundle.manifest().picture.render)?;
        let straight = walk::straight(scene.family);
        write_if_other(&scene.script(&settings.out, true), straight.as_bytes())?;
    }
    let plan = Plan { settings, common: &common };
    // Cells that show the latents of others are made after them.
    let (own, shared): (Vec<Cell>, Vec<Cell>) =
        settings.cells().partition(|cell| cell.branch.shares_latents_of().is_none());
    let own = complete(&plan, own, settings.jobs, progress, stop)?;
    let shared = complete(&plan, shared, settings.jobs, progress, stop)?;
    let kept = own.kept + shared.kept;
    let mut made: Vec<(Cell, Manifest)> = own.cells.into_iter().chain(shared.cells).collect();
    let order: Vec<Cell> = settings.cells().collect();
    made.sort_by_key(|(cell, _)| order.iter().position(|other| other == cell));
    let (straight, cells) = made.into_iter().partition(|(cell, _)| cell.straight);
    Ok(Rollouts { cells, straight, kept })
}

/// The plan with the inputs of its rollouts.
struct Plan<'a> {
    settings: &'a Settings,
    common: &'a Common,
}

impl Cells for Plan<'_> {
    type Cell = Cell;
    type Content = Manifest;

    fn find(&self, cell: Cell) -> Result<Option<Manifest>> {
        let digests = digests(cell, self.settings, self.common)?;
        match find_rollout(&cell.folder(&self.settings.out), &cell.rollout(self.settings), &digests)? {
            CellState::Complete(manifest) => Ok(Some(*manifest)),
            CellState::Missing(_) => Ok(None),
        }
    }

    fn work(&self, cell: Cell) -> Result<Work> {
        let (rollout, folder) = (cell.rollout(self.settings), cell.folder(&self.settings.out));
        let checked = rollout.check()?;
        let planned = checked.point.counts(checked.duration).presented;
        Ok(Work { name: cell.to_string(), arguments: arguments(&rollout, &folder)?, folder, planned })
    }

    fn expect(&self, cell: Cell) -> Result<Manifest> {
        let (rollout, folder) = (cell.rollout(self.settings), cell.folder(&self.settings.out));
        expect_rollout(&cell.to_string(), &folder, &rollout, &digests(cell, self.settings, self.common)?)
    }
}

/// Writes the seed picture and the script of a scene below `out`, unless they are there unchanged.
pub(crate) fn prepare(scene: SceneId, out: &Path, [width, height]: [u32; 2]) -> Result<()> {
    let folder = scene.folder(out);
    std::fs::create_dir_all(&folder).map_err(|e| describe_io("cannot be made", &folder, &e))?;
    let picture = encode_png(&seed_picture::draw(&Scene::new(scene.family, scene.seed), width, height)?)?;
    write_if_other(&scene.seed_picture(out), &picture)?;
    write_if_other(&scene.script(out, false), scene.family.script().as_bytes())
}

fn write_if_other(path: &Path, bytes: &[u8]) -> Result<()> {
    match std::fs::read(path).ok().as_deref() == Some(bytes) {
        true => Ok(()),
        false => write_whole(&RealDisk, path, bytes),
    }
}

fn digests(cell: Cell, settings: &Settings, common: &Common) -> Result<Digests> {
    let shared = cell.branch.shares_latents_of().map(|branch| Cell { branch, ..cell });
    let latents = shared.map(|cell| digest_of(&cell.folder(&settings.out).join(LATENTS))).transpose()?;
    Ok(Digests { latents, ..common.digests(cell.scene, cell.straight, &settings.out)? })
}

fn digest_of(path: &Path) -> Result<String> {
    std::fs::read(path).map(|bytes| sha256(&bytes)).map_err(|e| describe_io("cannot be read", path, &e))
}

impl Common {
    /// Digests of all inputs of a rollout through a prepared scene.
    ///
    /// # Errors
    /// `Io` where the scene was not prepared.
    pub(crate) fn digests(&self, scene: SceneId, straight: bool, out: &Path) -> Result<Digests> {
        Ok(Digests {
            world: self.world.clone(),
            seed_picture: digest_of(&scene.seed_picture(out))?,
            script: digest_of(&scene.script(out, straight))?,
            onnxruntime: self.onnxruntime.clone(),
            latents: None,
        })
    }
}

/// Command line that makes `rollout` in `out`.
fn arguments(rollout: &Rollout, out: &Path) -> Result<Vec<OsString>> {
    let mut all: Vec<OsString> = ["rollout", "--quiet", "--overwrite"].map(OsString::from).into();
    let mut add = |option: &str, value: &dyn AsRef<std::ffi::OsStr>| all.extend([option.into(), value.as_ref().into()]);
    let files = [
        ("--world", &rollout.world),
        ("--seed-picture", &rollout.seed_picture),
        ("--script", &rollout.script),
        ("--latents", &rollout.latents),
    ];
    for (option, path) in files {
        if let Some(path) = path {
            add(option, path);
        }
    }
    let [width, height] = rollout.size;
    // Every item of the operating point is passed, so that no value of a preset remains.
    let point: OperatingPoint = rollout.operating_point.parse()?;
    add("--context", &format!("g{}", point.global_window));
    add("--schedule", &point.schedule.to_string());
    add("--cache", &point.cache_mode.to_string());
    add("--anchor-rate", &point.latents_per_second.to_string());
    add("--pictures", &point.pictures_per_latent.to_string());
    add("--present", &point.presentation.to_string());
    add("--seconds", &rollout.seconds);
    add("--seed", &rollout.seed.to_string());
    add("--size", &format!("{width}x{height}"));
    add("--upscaler", &rollout.upscaler);
    add("--generator", &rollout.generator.to_string());
    add("--formats", &"png");
    if let Some(threads) = rollout.threads {
        add("--threads", &threads.to_string());
    }
    add("--device", &rollout.device.to_string());
    add("--out", &out);
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::rollout_settings;
    use crate::compare::plan::tests::settings;
    use crate::device::DeviceChoice;
    use crate::generator::GeneratorChoice;

    #[test]
    fn a_command_line_says_all_that_the_settings_say() {
        let mut common = settings(Path::new("out"));
        common.world = Some("w.cairn".into());
        common.upscaler = "catmull-rom".into();
        common.generator = GeneratorChoice::Shader;
        common.device = DeviceChoice::D3d12(Some(1));
        common.threads = 3;
        for cell in common.cells() {
            let wanted = cell.rollout(&common);
            let all = [OsString::from("study")].into_iter().chain(arguments(&wanted, Path::new("o")).unwrap());
            let understood = rollout_settings(all).unwrap();
            assert_eq!(Rollout { preset: None, ..understood }, wanted, "{cell}");
        }
    }
}
