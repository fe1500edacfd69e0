//! Saves and restores a rollout's whole state, in memory or in a file.

use std::ffi::{c_char, c_void};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::boundary::call;
use super::handles::{enter, enter_serialized};
use super::results::{AbiResult, CAIRN_ERROR_IO, CAIRN_OK, Failure, cairn_result};
use super::rollout::cairn_rollout;
use super::structs::{check_out, slice, slice_mut};
use super::text::required_text;
use crate::{Error, ErrorKind, allocate};

/// Upper limit on the difference in bytes between two states of one world: their operating points' texts differ in length.
const SLACK: u64 = 1 << 16;

/// How often a file is renamed on Windows before its error is reported, and the time between.
const RENAME_ATTEMPTS: u32 = 100;
const RENAME_PAUSE: Duration = Duration::from_millis(20);

/// Copies the whole state of a rollout: its memory, clocks, seed, operating point and last pictures. A rollout that restores it
/// continues bit for bit the same, in this process or another, on the same kind of device.
///
/// bytes: capacity bytes, or null with capacity 0 to learn the size.
/// size: gets the size of the state. It depends on the operating point, which a budget or a governor may change, and on whether the encoder's
/// stream is kept, so ask before each save.
///
/// Ownership: the state is copied; on failure nothing is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the capacity is too small;
/// CAIRN_ERROR_BUSY while a step is running; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_save(
    rollout: *const cairn_rollout,
    bytes: *mut c_void,
    capacity: usize,
    size: *mut usize,
) -> cairn_result {
    call("cairn_rollout_save", || {
        let worker = enter(rollout)?;
        check_out(size, "size")?;
        let core = worker.lock_between_steps(worker.is_nested())?;
        let len = core.rollout.state_len()?;
        if !bytes.is_null() || capacity > 0 {
            if capacity < len {
                return Err(Failure::argument("capacity", format!("{capacity} bytes, the state has {len}")));
            }
            // SAFETY: the host's promise about `bytes`; their previous contents are not read.
            let bytes = unsafe { slice_mut(bytes.cast::<u8>(), len, "bytes") }?;
            bytes.copy_from_slice(&core.rollout.save()?);
        }
        // SAFETY: checked above; writable by the host's promise.
        unsafe { size.write(len) };
        Ok(CAIRN_OK)
    })
}

/// Writes the whole state of a rollout to a file, completely or not at all: to a temporary file beside it, which is then renamed.
///
/// path: UTF-8; an existing file is replaced.
///
/// Ownership: path is read during the call; on success the file is the caller's, on failure an existing file is unchanged.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY while a step is running;
/// CAIRN_ERROR_IO; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_save_file(rollout: *const cairn_rollout, path: *const c_char) -> cairn_result {
    call("cairn_rollout_save_file", || {
        let worker = enter(rollout)?;
        // SAFETY: the host's promise about `path`.
        let path = Path::new(unsafe { required_text(path, "path") }?);
        let state = worker.lock_between_steps(worker.is_nested())?.rollout.save()?;
        write_atomically(path, &state)?;
        Ok(CAIRN_OK)
    })
}

/// Restores a state that was saved from a rollout of the same bundle, precision and global window. The rollout gets the state's seed
/// and operating point.
///
/// Ownership: bytes are read during the call; on failure the rollout is unchanged, on success it is as the saved one was.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_INVALID_STATE;
/// CAIRN_ERROR_UNSUPPORTED for a state of another version; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_restore(
    rollout: *mut cairn_rollout,
    bytes: *const c_void,
    size: usize,
) -> cairn_result {
    call("cairn_rollout_restore", || {
        let worker = enter_serialized(rollout)?;
        // SAFETY: the host's promise about `bytes`.
        let bytes = unsafe { slice(bytes.cast::<u8>(), size, "bytes") }?;
        let mut core = worker.lock_idle()?;
        core.rollout.restore(bytes)?;
        core.mark_cut();
        Ok(CAIRN_OK)
    })
}

/// Restores a state from a file, as cairn_rollout_restore does from memory.
///
/// path: UTF-8.
///
/// Ownership: path is read during the call; on failure the rollout is unchanged, on success it is as the saved one was.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_IO;
/// CAIRN_ERROR_INVALID_STATE; CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_restore_file(rollout: *mut cairn_rollout, path: *const c_char) -> cairn_result {
    call("cairn_rollout_restore_file", || {
        let worker = enter_serialized(rollout)?;
        // SAFETY: the host's promise about `path`.
        let path = Path::new(unsafe { required_text(path, "path") }?);
        let mut core = worker.lock_idle()?;
        let max_bytes = core.rollout.state_len()? as u64 + SLACK;
        let state = read_file(path, max_bytes)?;
        core.rollout.restore(&state)?;
        core.mark_cut();
        Ok(CAIRN_OK)
    })
}

/// Writes a temporary file beside `path` and renames it, so that `path` never has an incomplete file.
fn write_atomically(path: &Path, bytes: &[u8]) -> AbiResult<()> {
    let mut name = path.file_name().ok_or_else(|| Failure::argument("path", "it names no file"))?.to_owned();
    // Several threads may save to one path.
    static SAVES: AtomicU64 = AtomicU64::new(0);
    name.push(format!(".{}-{}.unfinished", std::process::id(), SAVES.fetch_add(1, Ordering::Relaxed)));
    let temporary: PathBuf = path.with_file_name(name);
    let written = File::create(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        // The data must reach the disk before the rename, so that a crash cannot leave an empty file at `path`.
        file.sync_all()
    });
    written.and_then(|()| rename(&temporary, path)).map_err(|e| {
        _ = fs::remove_file(&temporary);
        io_failure(path, &e)
    })
}

/// Renames a file. Windows refuses it for a moment while a virus scanner reads the new file, or another thread replaces the old one.
fn rename(from: &Path, to: &Path) -> std::io::Result<()> {
    let mut left = if cfg!(windows) { RENAME_ATTEMPTS } else { 1 };
    loop {
        left -= 1;
        match fs::rename(from, to) {
            Err(e) if left > 0 && is_in_use(&e) && !to.is_dir() => std::thread::sleep(RENAME_PAUSE),
            ended => return ended,
        }
    }
}

/// Whether Windows gives this error for a file that somebody else has open.
fn is_in_use(error: &std::io::Error) -> bool {
    const ERROR_SHARING_VIOLATION: i32 = 32;
    error.kind() == std::io::ErrorKind::PermissionDenied || error.raw_os_error() == Some(ERROR_SHARING_VIOLATION)
}

/// Reads a file of at most `max_bytes`.
fn read_file(path: &Path, max_bytes: u64) -> AbiResult<Vec<u8>> {
    let failure = |e: std::io::Error| io_failure(path, &e);
    // Asked first: to open a pipe would wait for somebody who writes to it.
    let found = fs::metadata(path).map_err(failure)?;
    if !found.is_file() || found.len() > max_bytes {
        return Err(Error::new(ErrorKind::InvalidState, "the file is no state of a rollout of this world")
            .field(path.display().to_string())
            .remedy("Give a file that was saved of one")
            .into());
    }
    let file = File::open(path).map_err(failure)?;
    let mut bytes = Vec::new();
    allocate::reserve(&mut bytes, found.len() as usize)?;
    file.take(found.len()).read_to_end(&mut bytes).map_err(failure)?;
    Ok(bytes)
}

fn io_failure(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(CAIRN_ERROR_IO, error.to_string()).field(path.display().to_string())
}

// Miri runs the tests of this module's neighbours without files and processes.
#[cfg(all(test, not(miri)))]
mod tests {
    use super::*;

    #[test]
    fn threads_that_save_to_one_path_leave_one_whole_state() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state");
        std::thread::scope(|scope| {
            for byte in 1..=4_u8 {
                let path = &path;
                scope.spawn(move || {
                    for _ in 0..25 {
                        write_atomically(path, &vec![byte; 1 << 18]).unwrap();
                        let found = fs::read(path).unwrap();
                        assert!(found.len() == 1 << 18 && found.iter().all(|b| *b == found[0]));
                    }
                });
            }
        });
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_no_state() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let refused = read_file(&path, 1 << 20).unwrap_err();
        assert!(refused.to_string().contains("no state of a rollout"), "{refused}");
    }
}
