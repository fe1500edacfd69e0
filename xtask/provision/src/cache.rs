//! The cache directory: paths, one lock per item, and items that appear complete or not at all.

use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::{Error, Progress, Result};

/// The folder `cairn` in `$CAIRN_CACHE_DIR`; else in `%LOCALAPPDATA%` on Windows, in `$XDG_CACHE_HOME` or `~/.cache`
/// elsewhere. It need not exist yet. The library looks for ONNX Runtime in the same place.
///
/// # Errors
/// None of the variables is set, or the one that counts holds a relative path.
pub fn cache_dir() -> Result<PathBuf> {
    cache_dir_from(&|name| std::env::var_os(name).filter(|value| !value.is_empty()))
}

fn cache_dir_from(variable: &dyn Fn(&str) -> Option<OsString>) -> Result<PathBuf> {
    let under = |name: &str, rest: &str| variable(name).map(|value| Path::new(&value).join(rest));
    let found = if let Some(own) = under("CAIRN_CACHE_DIR", "cairn") {
        Some(own)
    } else if cfg!(windows) {
        under("LOCALAPPDATA", "cairn")
    } else {
        under("XDG_CACHE_HOME", "cairn").or_else(|| under("HOME", ".cache/cairn"))
    };
    match found {
        Some(path) if path.is_absolute() => Ok(path),
        Some(path) => Err(Error::new(
            "the cache directory",
            format!("\"{}\" is a relative path", path.display()),
            "Set CAIRN_CACHE_DIR to an absolute path",
        )),
        None => Err(Error::new(
            "the cache directory",
            "neither CAIRN_CACHE_DIR nor a home directory is set",
            "Set CAIRN_CACHE_DIR to an absolute path",
        )),
    }
}

/// Holds an item's lock until dropped.
pub(crate) struct ItemLock {
    _file: File,
}

/// Waits for the lock of `item`, so that one process fetches it and the others find it.
pub(crate) fn lock(item: &str, progress: &dyn Progress) -> Result<ItemLock> {
    let folder = cache_dir()?.join("locks");
    fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, &e))?;
    let path = folder.join(format!("{item}.lock"));
    let file = File::create(&path).map_err(|e| Error::io(&path, &e))?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            progress.start(&format!("waiting for another process that is preparing {item}"));
            file.lock().map_err(|e| Error::io(&path, &e))?;
            progress.done(&format!("the other process is done with {item}"));
        }
        Err(TryLockError::Error(e)) => return Err(Error::io(&path, &e)),
    }
    Ok(ItemLock { _file: file })
}

/// An empty folder to prepare `item` in. Leftovers of an interrupted run are removed first, so the caller must hold its lock.
pub(crate) fn scratch(item: &str, _lock: &ItemLock) -> Result<PathBuf> {
    let path = cache_dir()?.join("unfinished").join(item);
    remove(&path)?;
    fs::create_dir_all(&path).map_err(|e| Error::io(&path, &e))?;
    Ok(path)
}

/// Moves a finished folder or file to its final path in one step.
pub(crate) fn publish(finished: &Path, destination: &Path) -> Result<()> {
    if let Some(parent) = destination.parent() {
        fs::create_dir_all(parent).map_err(|e| Error::io(parent, &e))?;
    }
    if destination.is_dir() {
        remove(destination)?;
    }
    let mut left = if cfg!(windows) { RENAME_ATTEMPTS } else { 1 };
    loop {
        left -= 1;
        match fs::rename(finished, destination) {
            Ok(()) => return Ok(()),
            // A virus scanner reads what was just written.
            Err(e) if left > 0 && e.kind() == std::io::ErrorKind::PermissionDenied => std::thread::sleep(RENAME_PAUSE),
            Err(e) => return Err(Error::io(destination, &e)),
        }
    }
}

/// How often a finished folder is renamed on Windows before the error is reported, and the time between.
const RENAME_ATTEMPTS: u32 = 100;
const RENAME_PAUSE: std::time::Duration = std::time::Duration::from_millis(50);

/// Removes a folder recursively; a missing one is not an error.
pub(crate) fn remove(path: &Path) -> Result<()> {
    match fs::remove_dir_all(path) {
        Ok(()) => Ok(()),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(Error::io(path, &e)),
    }
}

/// SHA-256 of a file as lower-case hex.
pub(crate) fn sha256_of(path: &Path) -> Result<String> {
    let mut file = File::open(path).map_err(|e| Error::io(path, &e))?;
    let mut hash = Sha256::new();
    let mut piece = vec![0; 1 << 20];
    loop {
        match file.read(&mut piece).map_err(|e| Error::io(path, &e))? {
            0 => return Ok(hex(&hash.finalize())),
            n => hash.update(&piece[..n]),
        }
    }
}

/// Lower-case hex of `bytes`.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Size of everything under `path` in bytes; files that vanish meanwhile count as empty.
pub(crate) fn size_of(path: &Path) -> u64 {
    let Ok(entries) = fs::read_dir(path) else { return 0 };
    entries
        .flatten()
        .map(|entry| match entry.metadata() {
            Ok(data) if data.is_dir() => size_of(&entry.path()),
            Ok(data) => data.len(),
            Err(_) => 0,
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(pairs: &[(&str, &str)]) -> Result<PathBuf> {
        cache_dir_from(&|name| pairs.iter().find(|(n, _)| *n == name).map(|(_, v)| OsString::from(v)))
    }

    #[test]
    fn own_variable_wins_and_must_be_absolute() {
        let here = std::env::temp_dir();
        let here = here.to_str().unwrap();
        assert_eq!(from(&[("CAIRN_CACHE_DIR", here), ("HOME", "/home/x")]).unwrap(), Path::new(here).join("cairn"));
        let refused = from(&[("CAIRN_CACHE_DIR", "cache")]).unwrap_err();
        assert!(refused.to_string().contains("relative"), "{refused}");
    }

    #[cfg(not(windows))]
    #[test]
    fn follows_xdg_then_home() {
        assert_eq!(from(&[("XDG_CACHE_HOME", "/x"), ("HOME", "/h")]).unwrap(), Path::new("/x/cairn"));
        assert_eq!(from(&[("HOME", "/h")]).unwrap(), Path::new("/h/.cache/cairn"));
        assert!(from(&[]).unwrap_err().to_string().contains("CAIRN_CACHE_DIR"));
    }

    #[test]
    fn sha256_is_the_published_one() {
        let path = std::env::temp_dir().join(format!("cairn-provision-sha-{}", std::process::id()));
        fs::write(&path, "abc").unwrap();
        let sum = sha256_of(&path).unwrap();
        fs::remove_file(&path).unwrap();
        assert_eq!(sum, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
