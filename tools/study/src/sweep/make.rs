//! Makes one cell: prepares its place, makes its rollout and measures its frames, skipping each part that is complete.
//!
//! Several processes, also on several machines with a shared folder, may make cells at the same time. So a process locks a place while it prepares
//! it, and a cell while it makes it. The operating system releases the locks of a killed process.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::bundle::Bundle;
use cairn::{Error, ErrorKind, Result};

use super::plan::{Cell, Settings};
use crate::compare::cells::{Digests, Found, expect, look};
use crate::compare::make::{Common, prepare};
use crate::compare::plan::Place;
use crate::compare::score::{SERIES, kept, key, measure};
use crate::compare::series::{Comparison, RATE, Series, Stream};
use crate::compare::truth;
use crate::inputs;
use crate::job::{self, Job};
use crate::manifest::Manifest;
use crate::media::{RealDisk, describe_io};
use crate::metrics::Net;
use crate::output::MANIFEST;
use crate::progress::Progress;

/// A complete cell.
pub(super) struct Whole {
    pub(super) manifest: Manifest,
    /// Series of the truth and of the cell.
    pub(super) series: [Series; 2],
}

/// Inputs shared by all cells.
pub(super) struct Shared<'a> {
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

impl<'a> Shared<'a> {
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

    /// Writes seed picture and script of a place, unless they are there.
    ///
    /// # Errors
    /// `Io`.
    pub(super) fn prepare(&self, place: Place, progress: &Progress) -> Result<()> {
        let _lock = self.lock(place, progress)?;
        prepare(place, &self.settings.out, self.bundle.manifest().picture.render)
    }

    fn lock(&self, place: Place, progress: &Progress) -> Result<Lock> {
        let folder = place.folder(&self.settings.out);
        std::fs::create_dir_all(&folder).map_err(|e| describe_io("cannot be made", &folder, &e))?;
        Lock::wait(&folder.join("place.lock"), progress)
    }

    fn digests(&self, place: Place) -> Result<Digests> {
        self.common.digests(place, false, &self.settings.out)
    }

    /// A cell of a prepared place; `None` if a part of it must be made.
    ///
    /// # Errors
    /// `Unsupported` for a manifest of a newer version, which is not overwritten; `Io`.
    pub(super) fn find(&self, cell: &Cell<'_>) -> Result<Option<Whole>> {
        let (settings, folder) = (self.settings, cell.folder(&self.settings.out));
        let manifest = match look(&folder, &cell.rollout(settings), &self.digests(cell.place)?)? {
            Found::Whole(manifest) => *manifest,
            Found::Missing(_) => return Ok(None),
        };
        let truth = cell.place.folder(&settings.out).join(truth::FOLDER);
        if !truth.join(MANIFEST).exists() {
            return Ok(None);
        }
        let key = key(settings.looks()?, settings.lpips, [&manifest].into_iter(), &truth)?;
        let series = kept(&folder.join(SERIES), &key, 1).and_then(|series| series.try_into().ok());
        Ok(series.map(|series| Whole { manifest, series }))
    }

    /// Makes the missing parts of a cell.
    ///
    /// # Errors
    /// As [`find`](Self::find); errors of the rollout or its measurement; `Cancelled` when `stop` was set.
    pub(super) fn make(&self, cell: &Cell<'_>, progress: &Progress, stop: &AtomicBool) -> Result<()> {
        let settings = self.settings;
        let place = cell.place;
        self.prepare(place, progress)?;
        let drawn = truth::Settings { out: &settings.out, size: settings.size };
        let folder = cell.folder(&settings.out);
        let _lock = Lock::wait(&folder.with_added_extension("lock"), progress)?;
        if self.find(cell)?.is_some() {
            return Ok(());
        }
        let truth = {
            let _lock = self.lock(place, progress)?;
            truth::draw(place, false, settings.looks()?, &drawn, progress, stop)?
        };
        // Loaded before the rollout, which is useless if it cannot be measured.
        let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
        let (rollout, digests) = (cell.rollout(settings), self.digests(place)?);
        if let Found::Missing(_) = look(&folder, &rollout, &digests)? {
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
        let manifest = expect(&cell.name(), &folder, &rollout, &digests)?;
        let (count, file) = (settings.looks()?, folder.join(SERIES));
        let key = key(count, settings.lpips, [&manifest].into_iter(), &truth)?;
        if kept(&file, &key, 1).is_some() {
            return Ok(());
        }
        progress.phase("measuring");
        let truth = Stream { name: truth::FOLDER.into(), folder: truth, step: 1 };
        let step = u64::from(cell.point.point.presented_rate() / RATE).max(1);
        let streams = [Stream { name: "rollout".into(), folder, step }];
        let comparison = Comparison { truth: &truth, streams: &streams, decoder: None, count, lpips: lpips.as_ref() };
        measure(&file, &key, &comparison, progress, stop).map(drop)
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
