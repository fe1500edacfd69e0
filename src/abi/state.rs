//! A rollout's whole state, in memory or in a file.

use std::ffi::{c_char, c_void};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use super::boundary::call;
use super::handles::{enter, enter_alone};
use super::results::{CAIRN_ERROR_IO, CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_OK, Failure, Outcome, cairn_result};
use super::rollout::cairn_rollout;
use super::structs::{check_out, slice, slice_mut};
use super::text::required_text;
use crate::{Error, ErrorKind};

/// Bytes by which states of one world can differ: their operating points have texts of different lengths.
const SLACK: u64 = 1 << 16;

/// Copies the whole state of a rollout: its memory, clocks, seed, operating point and last pictures. A rollout that takes it up
/// goes on bit for bit, in this process or another, on the same kind of device.
///
/// bytes: capacity bytes, or null with capacity 0 to learn the size.
/// size: gets the size of the state; it stays the same as long as the rollout is not restored.
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
        let running = enter(rollout)?;
        check_out(size, "size")?;
        let core = running.lock_between_steps()?;
        let len = core.rollout.state_len()?;
        if !bytes.is_null() || capacity > 0 {
            if capacity < len {
                return Err(Failure::argument("capacity", format!("{capacity} bytes, the state has {len}")));
            }
            // SAFETY: the host's promise about `bytes`; what they hold is not looked at.
            let bytes = unsafe { slice_mut(bytes.cast::<u8>(), len, "bytes") }?;
            bytes.copy_from_slice(&core.rollout.save()?);
        }
        // SAFETY: checked above; writable by the host's promise.
        unsafe { size.write(len) };
        Ok(CAIRN_OK)
    })
}

/// Writes the whole state of a rollout into a file, whole or not at all: it is written beside it and then takes its name.
///
/// path: UTF-8; a file that is there is replaced.
///
/// Ownership: path is read during the call; on success the file is the caller's, on failure what was there is as it was.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY while a step is running;
/// CAIRN_ERROR_IO; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_save_file(rollout: *const cairn_rollout, path: *const c_char) -> cairn_result {
    call("cairn_rollout_save_file", || {
        let running = enter(rollout)?;
        // SAFETY: the host's promise about `path`.
        let path = Path::new(unsafe { required_text(path, "path") }?);
        let state = running.lock_between_steps()?.rollout.save()?;
        write_whole(path, &state)?;
        Ok(CAIRN_OK)
    })
}

/// Takes up a state that was saved of a rollout of the same bundle, precision and global window. Seed and operating point become
/// the state's.
///
/// Ownership: bytes are read during the call; on failure the rollout is as it was, on success as the saved one.
/// Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
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
        let running = enter_alone(rollout)?;
        // SAFETY: the host's promise about `bytes`.
        let bytes = unsafe { slice(bytes.cast::<u8>(), size, "bytes") }?;
        let mut core = running.lock_idle()?;
        core.rollout.restore(bytes)?;
        core.restored();
        Ok(CAIRN_OK)
    })
}

/// Takes up a state from a file; as cairn_rollout_restore.
///
/// path: UTF-8.
///
/// Ownership: path is read during the call; on failure the rollout is as it was, on success as the saved one.
/// Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_IO;
/// CAIRN_ERROR_INVALID_STATE; CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_restore_file(rollout: *mut cairn_rollout, path: *const c_char) -> cairn_result {
    call("cairn_rollout_restore_file", || {
        let running = enter_alone(rollout)?;
        // SAFETY: the host's promise about `path`.
        let path = Path::new(unsafe { required_text(path, "path") }?);
        let mut core = running.lock_idle()?;
        let most = core.rollout.state_len()? as u64 + SLACK;
        let state = read_whole(path, most)?;
        core.rollout.restore(&state)?;
        core.restored();
        Ok(CAIRN_OK)
    })
}

fn write_whole(path: &Path, bytes: &[u8]) -> Outcome<()> {
    let refused = |e: std::io::Error| io(path, &e);
    let mut name = path.file_name().ok_or_else(|| Failure::argument("path", "it names no file"))?.to_owned();
    name.push(format!(".{}.unfinished", std::process::id()));
    let beside: PathBuf = path.with_file_name(name);
    let written = File::create(&beside).and_then(|mut file| {
        file.write_all(bytes)?;
        // The file's data must reach the disk before its name: a crash must not leave a name without data.
        file.sync_all()
    });
    written.and_then(|()| fs::rename(&beside, path)).map_err(|e| {
        _ = fs::remove_file(&beside);
        refused(e)
    })
}

fn read_whole(path: &Path, most: u64) -> Outcome<Vec<u8>> {
    let refused = |e: std::io::Error| io(path, &e);
    let file = File::open(path).map_err(refused)?;
    let found = file.metadata().map_err(refused)?;
    if !found.is_file() || found.len() > most {
        return Err(Error::new(ErrorKind::InvalidState, "the file is no state of a rollout of this world")
            .field(path.display().to_string())
            .remedy("Give a file that was saved of one")
            .into());
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(found.len() as usize).map_err(|_| {
        Failure::new(CAIRN_ERROR_OUT_OF_MEMORY, format!("a state of {} bytes cannot be read", found.len()))
    })?;
    file.take(found.len()).read_to_end(&mut bytes).map_err(refused)?;
    Ok(bytes)
}

fn io(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(CAIRN_ERROR_IO, error.to_string()).field(path.display().to_string())
}
