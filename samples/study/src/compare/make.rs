//! Makes the cells that are not there yet, each in a process of its own: this program again, as `study rollout`.

use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::bundle::Bundle;
use cairn::world::OperatingPoint;
use cairn::{Error, ErrorKind, Result};

use super::cells::{Digests, Found, expect, look};
use super::plan::{Cell, Place, Settings};
use super::turn;
use crate::inputs;
use crate::manifest::{Manifest, sha256};
use crate::media::{RealDisk, describe_io, encode_png, write_whole};
use crate::output::{FRAMES, LATENTS};
use crate::place;
use crate::progress::Progress;
use crate::reconstruct::script_of;
use crate::settings::Settings as Rollout;

/// Between two looks at the processes.
const EVERY: Duration = Duration::from_millis(50);
/// How long a process that was interrupted may take to finish its frame and its manifest.
const PATIENCE: Duration = Duration::from_secs(10);
/// The most that is kept of what a process says.
const MAX_WORDS: u64 = 64 << 10;

/// All cells, there.
#[derive(Debug)]
pub(super) struct Made {
    /// Every branch of every place, in the plan's order.
    pub(super) cells: Vec<(Cell, Manifest)>,
    /// The straight walks.
    pub(super) straight: Vec<(Cell, Manifest)>,
    /// How many were there already.
    pub(super) kept: usize,
}

/// What all cells share.
struct Common {
    world: String,
    onnxruntime: String,
}

/// A cell to be made.
struct Work {
    cell: Cell,
    rollout: Rollout,
    digests: Digests,
    planned: u64,
}

/// Makes what is missing.
///
/// # Errors
/// As [`look`]; what a rollout fails with, with the cell named; `Cancelled` when `stop` was set.
pub(super) fn make(settings: &Settings, bundle: &Bundle, progress: &Progress, stop: &AtomicBool) -> Result<Made> {
    let (_, onnxruntime) = inputs::onnxruntime(progress)?;
    for cell in settings.cells() {
        cell.branch.point(cell.place.family).check_for(bundle.geometry())?;
    }
    let common = Common { world: bundle.digest().to_owned(), onnxruntime: onnxruntime.sha256 };
    progress.phase("drawing the seed pictures");
    for place in settings.places() {
        prepare(place, settings, bundle.manifest().picture.render)?;
    }
    let mut kept = 0;
    // What shows latents of others waits for them.
    for shared in [false, true] {
        let mut work = Vec::new();
        for cell in settings.cells().filter(|cell| cell.branch.shares_latents_of().is_some() == shared) {
            let rollout = cell.rollout(settings);
            let digests = digests(cell, settings, &common)?;
            match look(&cell.folder(&settings.out), &rollout, &digests)? {
                Found::Whole(_) => kept += 1,
                Found::Missing(_) => {
                    let checked = rollout.check()?;
                    let planned = checked.point.counts(checked.duration).presented;
                    work.push(Work { cell, rollout, digests, planned });
                }
            }
        }
        run_all(&work, settings, progress, stop)?;
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

/// Writes the picture and the script of a place, where they are not there as they should be.
fn prepare(place: Place, settings: &Settings, [width, height]: [u32; 2]) -> Result<()> {
    let folder = place.folder(&settings.out);
    std::fs::create_dir_all(&folder).map_err(|e| describe_io("cannot be made", &folder, &e))?;
    let picture = encode_png(&place::draw(place.family, place.seed, width, height)?)?;
    let (script, straight) = (script_of(place.family), turn::straight(place.family));
    for (path, bytes) in [
        (place.seed_picture(&settings.out), &picture[..]),
        (place.script(&settings.out, false), script.as_bytes()),
        (place.script(&settings.out, true), straight.as_bytes()),
    ] {
        if std::fs::read(&path).ok().as_deref() != Some(bytes) {
            write_whole(&RealDisk, &path, bytes)?;
        }
    }
    Ok(())
}

fn digests(cell: Cell, settings: &Settings, common: &Common) -> Result<Digests> {
    let of = |path: &Path| {
        std::fs::read(path).map(|bytes| sha256(&bytes)).map_err(|e| describe_io("cannot be read", path, &e))
    };
    let shared = cell.branch.shares_latents_of().map(|branch| Cell { branch, ..cell });
    Ok(Digests {
        world: common.world.clone(),
        seed_picture: of(&cell.place.seed_picture(&settings.out))?,
        script: of(&cell.place.script(&settings.out, cell.straight))?,
        onnxruntime: common.onnxruntime.clone(),
        latents: shared.map(|cell| of(&cell.folder(&settings.out).join(LATENTS))).transpose()?,
    })
}

/// The command line that makes `rollout` in `out`.
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
    // Every item of the point, so that nothing of a preset is left.
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

/// A process that makes a cell. It does not outlive this value.
struct Running<'a> {
    work: &'a Work,
    child: Child,
    folder: PathBuf,
    /// Frames that were seen in its folder.
    frames: u64,
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        // Both fail for one that has ended, which is as it should be.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl<'a> Running<'a> {
    fn start(work: &'a Work, settings: &Settings) -> Result<Self> {
        let folder = work.cell.folder(&settings.out);
        let failed = |e: std::io::Error| {
            Error::new(ErrorKind::Io, format!("{}: this program cannot be started again: {e}", work.cell))
        };
        let program = std::env::current_exe().map_err(failed)?;
        let child = Command::new(program)
            .args(arguments(&work.rollout, &folder)?)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        Ok(Self { work, child, folder, frames: 0 })
    }

    /// Frames that are there by now.
    fn frames(&mut self) -> u64 {
        let frames = self.folder.join(FRAMES);
        while frames.join(format!("{:06}.png", self.frames)).exists() && self.frames < self.work.planned {
            self.frames += 1;
        }
        self.frames
    }

    /// Whether it has ended; an error when not well.
    fn ended(&mut self) -> Result<bool> {
        let cell = self.work.cell;
        let status = self.child.try_wait().map_err(|e| Error::new(ErrorKind::Io, format!("{cell}: {e}")))?;
        let Some(status) = status else { return Ok(false) };
        if status.success() {
            return Ok(true);
        }
        let mut words = String::new();
        if let Some(stderr) = self.child.stderr.take() {
            // What it said before it ended; that it cannot be read tells nothing more.
            let _ = stderr.take(MAX_WORDS).read_to_string(&mut words);
        }
        let said = words.lines().find_map(|line| line.strip_prefix("error: ")).unwrap_or_default();
        let kind = if status.code() == Some(2) { ErrorKind::InvalidArgument } else { ErrorKind::InvalidState };
        let cause = if said.is_empty() { format!("its process ended by itself: {status}") } else { said.to_owned() };
        Err(Error::new(kind, format!("{cell}: {cause}"))
            .field(self.folder.display().to_string())
            .remedy("Run the same command again: what is whole is kept"))
    }
}

/// Makes all of `work`, so many at a time. After a failure nothing new is begun, and what runs comes to its end.
fn run_all(work: &[Work], settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<()> {
    let Some(first) = work.first() else { return Ok(()) };
    let more = if work.len() > 1 { format!(", and {} more", work.len() - 1) } else { String::new() };
    progress.phase(&format!("{}{more}", first.cell));
    progress.begin(work.iter().map(|work| work.planned).sum::<u64>());
    let mut waiting = work.iter();
    let mut running: Vec<Running<'_>> = Vec::new();
    let (mut done, mut failure, mut interrupted) = (0, None, None);
    loop {
        if interrupted.is_none() && stop.load(Ordering::Relaxed) {
            interrupted = Some(Instant::now());
        }
        while running.len() < settings.jobs && failure.is_none() && interrupted.is_none() {
            match waiting.next().map(|work| Running::start(work, settings)) {
                None => break,
                Some(Ok(started)) => running.push(started),
                Some(Err(error)) => failure = Some(error),
            }
        }
        // The signal of the keyboard reaches them too; what ignores it is ended.
        if running.is_empty() || interrupted.is_some_and(|since| since.elapsed() > PATIENCE) {
            break;
        }
        let mut now = done;
        running.retain_mut(|process| match process.ended() {
            Ok(false) => {
                now += process.frames();
                true
            }
            Ok(true) => {
                done += process.work.planned;
                now += process.work.planned;
                false
            }
            Err(error) => {
                if interrupted.is_none() {
                    failure.get_or_insert(error);
                }
                false
            }
        });
        progress.frames(now);
        std::thread::sleep(EVERY);
    }
    progress.end();
    drop(running);
    match (failure, interrupted) {
        (Some(error), _) => Err(error),
        (None, Some(_)) => Err(Error::new(ErrorKind::Cancelled, "interrupted")),
        (None, None) => work.iter().try_for_each(|Work { cell, rollout, digests, .. }| {
            expect(&cell.to_string(), &cell.folder(&settings.out), rollout, digests).map(drop)
        }),
    }
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
