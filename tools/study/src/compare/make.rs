//! Makes the missing cells, each in a process of its own: this program again, as `study rollout`.

use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::world::OperatingPoint;

use super::cells::{Digests, Found, expect, look};
use super::plan::{Cell, Place, Settings};
use super::turn;
use crate::inputs;
use crate::manifest::{Manifest, sha256};
use crate::media::{RealDisk, describe_io, encode_png, write_whole};
use crate::output::LATENTS;
use crate::place;
use crate::progress::Progress;
use crate::reconstruct::script_of;
use crate::settings::Settings as Rollout;
use crate::workers::{Work, run_all};

/// All cells, complete.
#[derive(Debug)]
pub(super) struct Made {
    /// Every branch of every place, in the plan's order.
    pub(super) cells: Vec<(Cell, Manifest)>,
    /// The walks without turns.
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
/// As [`look`]; errors of a rollout, with the cell named; `Cancelled` when `stop` was set.
pub(super) fn make(settings: &Settings, bundle: &Bundle, progress: &Progress, stop: &AtomicBool) -> Result<Made> {
    let (_, onnxruntime) = inputs::onnxruntime(progress)?;
    for cell in settings.cells() {
        cell.branch.point(cell.place.family).check_for(bundle.geometry())?;
    }
    let common = Common { world: bundle.digest().to_owned(), onnxruntime: onnxruntime.sha256 };
    progress.phase("drawing the seed pictures");
    for place in settings.places() {
        prepare(place, &settings.out, bundle.manifest().picture.render)?;
        let straight = turn::straight(place.family);
        write_if_other(&place.script(&settings.out, true), straight.as_bytes())?;
    }
    let mut kept = 0;
    // Cells that show the latents of others are made after them.
    for shared in [false, true] {
        let (mut work, mut expected) = (Vec::new(), Vec::new());
        for cell in settings.cells().filter(|cell| cell.branch.shares_latents_of().is_some() == shared) {
            let (rollout, folder) = (cell.rollout(settings), cell.folder(&settings.out));
            let digests = digests(cell, settings, &common)?;
            match look(&folder, &rollout, &digests)? {
                Found::Whole(_) => kept += 1,
                Found::Missing(_) => {
                    let checked = rollout.check()?;
                    let planned = checked.point.counts(checked.duration).presented;
                    let arguments = arguments(&rollout, &folder)?;
                    work.push(Work { name: cell.to_string(), folder: folder.clone(), arguments, planned });
                    expected.push((cell, folder, rollout, digests));
                }
            }
        }
        run_all(&work, settings.jobs, progress, stop)?;
        for (cell, folder, rollout, digests) in expected {
            expect(&cell.to_string(), &folder, &rollout, &digests)?;
        }
    }
    let cells = settings.cells().map(|cell| {
        let digests = digests(cell, settings, &common)?;
        let manifest = expect(&cell.to_string(), &cell.folder(&settings.out), &cell.rollout(settings), &digests)?;
        Ok((cell, manifest))
    });
    let cells = cells.collect::<Result<Vec<_>>>()?;
    let (straight, cells) = cells.into_iter().partition(|(cell, _)| cell.straight);
    Ok(Made { cells, straight, kept })
}

/// Writes the seed picture and the script of a place below `out`, unless they are there unchanged.
pub(crate) fn prepare(place: Place, out: &Path, [width, height]: [u32; 2]) -> Result<()> {
    let folder = place.folder(out);
    std::fs::create_dir_all(&folder).map_err(|e| describe_io("cannot be made", &folder, &e))?;
    let picture = encode_png(&place::draw(place.family, place.seed, width, height)?)?;
    write_if_other(&place.seed_picture(out), &picture)?;
    write_if_other(&place.script(out, false), script_of(place.family).as_bytes())
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
    Ok(Digests { latents, ..common.digests(cell.place, cell.straight, &settings.out)? })
}

fn digest_of(path: &Path) -> Result<String> {
    std::fs::read(path).map(|bytes| sha256(&bytes)).map_err(|e| describe_io("cannot be read", path, &e))
}

impl Common {
    /// Digests of all inputs of a rollout through a prepared place.
    ///
    /// # Errors
    /// `Io` where the place was not prepared.
    pub(crate) fn digests(&self, place: Place, straight: bool, out: &Path) -> Result<Digests> {
        Ok(Digests {
            world: self.world.clone(),
            seed_picture: digest_of(&place.seed_picture(out))?,
            script: digest_of(&place.script(out, straight))?,
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
