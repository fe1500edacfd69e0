//! Searches for ONNX Runtime's library file.

use std::path::{Path, PathBuf};

use crate::LibrarySearch;
use crate::libraries;

/// Names the library file. If it is set and the environment may name libraries, no other path is tried.
pub(super) const VARIABLE: &str = "CAIRN_ONNXRUNTIME";

const RELEASE: &str = "onnxruntime-1.24.4";

/// File names without a full version.
const NAMES: &[&str] = if cfg!(windows) { &["onnxruntime.dll"] } else { &["libonnxruntime.so.1", "libonnxruntime.so"] };

/// What precedes the version in a file name.
const PREFIX: &str = "libonnxruntime.so.";
const MAJOR: u32 = 1;
/// The oldest minor version that this build works with.
const OLDEST_MINOR: u32 = ort::sys::ORT_API_VERSION;

/// The file to load, or every path that was tried.
pub(super) fn library(search: &LibrarySearch) -> Result<PathBuf, Vec<PathBuf>> {
    if let Some(path) = search.onnxruntime.clone().or_else(|| search.variable(VARIABLE)) {
        return Ok(path);
    }
    let mut folders = libraries::own_folders();
    folders.extend(cache(search).map(|cache| cache.join("cairn").join(RELEASE)));
    let mut tried = Vec::new();
    for folder in folders {
        if !cfg!(windows) {
            if let Some(newest) = newest(&folder) {
                return Ok(newest);
            }
            tried.push(folder.join(format!("{PREFIX}{MAJOR}.*")));
        }
        for path in NAMES.iter().map(|name| folder.join(name)) {
            if path.is_file() {
                return Ok(path);
            }
            tried.push(path);
        }
    }
    Err(tried)
}

/// The file of the highest version in `folder` that has a usable version in its name.
fn newest(folder: &Path) -> Option<PathBuf> {
    let files = std::fs::read_dir(folder).ok()?.flatten();
    let versions = files.filter_map(|file| version(file.file_name().to_str()?).map(|version| (version, file.path())));
    versions.filter(|(_, path)| path.is_file()).max().map(|(_, path)| path)
}

/// The minor version and the patch in a usable library's file name such as `libonnxruntime.so.1.24.4`.
fn version(name: &str) -> Option<[u32; 2]> {
    let numbers: Option<Vec<u32>> = name.strip_prefix(PREFIX)?.split('.').map(|part| part.parse().ok()).collect();
    match numbers?[..] {
        [MAJOR, minor, patch] if minor >= OLDEST_MINOR => Some([minor, patch]),
        _ => None,
    }
}

/// The cache directory that contains `cairn/`; `None` if the environment may not name libraries.
fn cache(search: &LibrarySearch) -> Option<PathBuf> {
    if !search.environment {
        return None;
    }
    search.variable("CAIRN_CACHE_DIR").or_else(|| {
        if cfg!(windows) {
            search.variable("LOCALAPPDATA")
        } else {
            search.variable("XDG_CACHE_HOME").or_else(|| std::env::home_dir().map(|home| home.join(".cache")))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_in_file_names_are_numbers() {
        assert_eq!(version("libonnxruntime.so.1.24.4"), Some([24, 4]));
        assert!(version("libonnxruntime.so.1.100.0") > version("libonnxruntime.so.1.32.0"));
        for other in [
            "so.1",
            "so",
            "so.1.23.9",
            "so.2.30.0",
            "so.1.24",
            "so.1.24.4.5",
            "so.1.x.0",
            "so.1.24.4.debug",
            "1.24.4.dylib",
        ] {
            assert_eq!(version(&format!("libonnxruntime.{other}")), None, "{other}");
        }
    }

    #[test]
    fn the_file_of_the_highest_version_is_found() {
        let folder = std::env::temp_dir().join(format!("cairn-search-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("libonnxruntime.so.1.99.0")).unwrap();
        assert_eq!(newest(&folder), None, "a folder is no library");
        for file in ["so", "so.1", "so.1.9.0", "so.1.24.4", "so.1.25.10", "so.1.25.9"] {
            std::fs::write(folder.join(format!("libonnxruntime.{file}")), "").unwrap();
        }
        assert_eq!(newest(&folder), Some(folder.join("libonnxruntime.so.1.25.10")));
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(newest(&folder), None);
    }
}
