//! Makes one cell: prepares its scene, makes its rollout and measures its frames. Parts that are complete are skipped.
//!
//! Several processes, also on several machines with a shared folder, may make cells at the same time. So a process locks a scene while it prepares
//! it, and a cell while it makes it. The operating system releases the locks of a killed process.

use std::ffi::OsStr;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::bundle::Bundle;
use cairn::{Error, ErrorKind, Result};

use super::plan::{Cell, Settings};
use crate::compare::make::{Common, prepare};
use crate::compare::paths::TRUTH;
use crate::compare::resume::{CellState, Digests, expect_rollout, find_rollout};
use crate::compare::score::{SERIES, measure_series, series_key, stored_series};
use crate::compare::series::{Comparison, Series, Stream};
use crate::compare::truth;
use crate::compare::walk::RATE;
use crate::experiment::cells::Cells;
use crate::inputs;
use crate::job::{self, Job};
use crate::manifest::Manifest;
use crate::metrics::Net;
use crate::output::MANIFEST;
use crate::progress::Progress;
use crate::scene_id::SceneId;
use crate::workers::Work;
use media::{RealDisk, describe_io};

/// A complete cell.
pub(super) struct CompleteCell {
    pub(super) manifest: Manifest,
    /// Series of the truth and of the cell.
    pub(super) series: [Series; 2],
}

/// Inputs shared by all cells.
pub(super) struct SweepInputs<'a> {
    settings: &'a Settings,
    bundle: &'a Bundle,
    common: Common,
}

/// A lock that is held until the value is dropped or the process ends.
struct Lock {
    _file: File,
}

impl Lock {
    /// Waits for the lock file at `path`, which is not deleted afterwards.
    fn wait(path: &Path, progress: &Progress) -> Result<Self> {
        let failed = |e: std::io::Error| describe_io("cannot be locked", path, &e);
        let file = File::options().create(true).truncate(false).write(true).open(path).map_err(failed)?;
        if file.try_lock().is_err() {
            progress.phase("another process is at it: waiting");
            file.lock().map_err(failed)?;
        }
        Ok(Self { _file: file })
    }
}

impl<'a> SweepInputs<'a> {
    /// Finds ONNX Runtime, whose version affects results, and fails if the world does not support the settings.
    ///
    /// # Errors
    /// As [`Settings::check_for`]; errors of finding ONNX Runtime.
    pub(super) fn new(settings: &'a Settings, bundle: &'a Bundle, progress: &Progress) -> Result<Self> {
        settings.check_for(bundle)?;
        let (_, onnxruntime) = inputs::onnxruntime(progress)?;
        let common = Common { world: bundle.digest().to_owned(), onnxruntime: onnxruntime.sha256 };
        Ok(Self { settings, bundle, common })
    }

    /// Writes seed picture and script of a scene, unless they are there.
    ///
    /// # Errors
    /// `Io`.
    pub(super) fn prepare(&self, scene: SceneId, progress: &Progress) -> Result<()> {
        let _lock = self.lock(scene, progress)?;
        prepare(scene, &self.settings.out, self.bundle.manifest().picture.render)
    }

    /// Makes the output folder and prepares all scenes.
    ///
    /// # Errors
    /// `Io`.
    pub(super) fn prepare_all(&self, progress: &Progress) -> Result<()> {
        let out = &self.settings.out;
        std::fs::create_dir_all(out).map_err(|e| describe_io("cannot be made", out, &e))?;
        progress.phase("drawing the seed pictures");
        self.settings.scenes().try_for_each(|scene| self.prepare(scene, progress))
    }

    fn lock(&self, scene: SceneId, progress: &Progress) -> Result<Lock> {
        let folder = scene.folder(&self.settings.out);
        std::fs::create_dir_all(&folder).map_err(|e| describe_io("cannot be made", &folder, &e))?;
        Lock::wait(&folder.join("place.lock"), progress)
    }

    fn digests(&self, scene: SceneId) -> Result<Digests> {
        self.common.digests(scene, false, &self.settings.out)
    }

    /// Makes the missing parts of a cell.
    ///
    /// # Errors
    /// As [`find`](Self::find); errors of the rollout or its measurement; `Cancelled` when `stop` was set.
    pub(super) fn make(&self, cell: Cell<'a>, progress: &Progress, stop: &AtomicBool) -> Result<()> {
        let settings = self.settings;
        let scene = cell.scene;
        self.prepare(scene, progress)?;
        let drawn = truth::Settings { out: &settings.out, size: settings.size };
        let folder = cell.folder(&settings.out);
        let _lock = Lock::wait(&folder.with_added_extension("lock"), progress)?;
        if self.find(cell)?.is_some() {
            return Ok(());
        }
        let truth = {
            let _lock = self.lock(scene, progress)?;
            truth::draw(scene, false, settings.sample_count()?, &drawn, progress, stop)?
        };
        // Loaded before the rollout, which is useless if it cannot be measured.
        let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
        let (rollout, digests) = (cell.rollout(settings), self.digests(scene)?);
        if let CellState::Missing(_) = find_rollout(&folder, &rollout, &digests)? {
            let disk = Arc::new(RealDisk);
            let job = Job { settings: &rollout, out: &folder, overwrite: true, disk, stop, progress, limit: None };
            let outcome = job::run(&job)?;
            if let Some(failure) = outcome.failure {
                return Err(failure);
            }
            if outcome.interrupted {
                return Err(Error::new(ErrorKind::Cancelled, "interrupted"));
            }
        }
        let manifest = expect_rollout(&cell.name(), &folder, &rollout, &digests)?;
        let (count, file) = (settings.sample_count()?, folder.join(SERIES));
        let key = series_key(count, settings.lpips, [&manifest].into_iter(), &truth)?;
        if stored_series(&file, &key, 1).is_some() {
            return Ok(());
        }
        progress.phase("measuring");
        let truth = Stream { name: TRUTH.into(), folder: truth, step: 1 };
        let step = u64::from(cell.point.point.presented_rate() / RATE).max(1);
        let streams = [Stream { name: "rollout".into(), folder, step }];
        let comparison = Comparison { truth: &truth, streams: &streams, decoder: &[], count, lpips: lpips.as_ref() };
        measure_series(&file, &key, &comparison, progress, stop).map(drop)
    }
}

impl<'a> Cells for SweepInputs<'a> {
    type Cell = Cell<'a>;
    type Content = CompleteCell;

    /// The scene of the cell must be prepared.
    fn find(&self, cell: Cell<'a>) -> Result<Option<CompleteCell>> {
        let (settings, folder) = (self.settings, cell.folder(&self.settings.out));
        let manifest = match find_rollout(&folder, &cell.rollout(settings), &self.digests(cell.scene)?)? {
            CellState::Complete(manifest) => *manifest,
            CellState::Missing(_) => return Ok(None),
        };
        let truth = cell.scene.folder(&settings.out).join(TRUTH);
        if !truth.join(MANIFEST).exists() {
            return Ok(None);
        }
        let key = series_key(settings.sample_count()?, settings.lpips, [&manifest].into_iter(), &truth)?;
        let series = stored_series(&folder.join(SERIES), &key, 1).and_then(|series| series.try_into().ok());
        Ok(series.map(|series| CompleteCell { manifest, series }))
    }

    /// The command line is that of [`only`](super::only).
    fn work(&self, cell: Cell<'a>) -> Result<Work> {
        let (settings, name) = (self.settings, cell.name());
        let words: [&dyn AsRef<OsStr>; 7] =
            [&"sweep", &settings.file, &"--only", &name, &"--out", &settings.out, &"--quiet"];
        let arguments = words.iter().map(|word| word.as_ref().to_owned()).collect();
        Ok(Work { folder: cell.folder(&settings.out), planned: cell.planned(settings)?, arguments, name })
    }

    fn expect(&self, cell: Cell<'a>) -> Result<CompleteCell> {
        self.find(cell)?.ok_or_else(|| {
            Error::new(ErrorKind::InvalidState, format!("{} was made, but is not there", cell.name()))
                .field(cell.folder(&self.settings.out).display().to_string())
                .remedy("See that nothing else writes into that folder, and run the command again")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_held_by_one_and_left_by_who_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("place.lock");
        let quiet = Progress::quiet();
        let held = Lock::wait(&path, &quiet).unwrap();
        let other = File::options().write(true).open(&path).unwrap();
        assert!(other.try_lock().is_err());
        drop(held);
        other.try_lock().unwrap();
        drop(other);
        Lock::wait(&path, &quiet).unwrap();
        let nowhere = folder.path().join("nowhere").join("place.lock");
        assert_eq!(Lock::wait(&nowhere, &quiet).err().unwrap().kind(), ErrorKind::Io);
    }
}
