//! Searches for ONNX Runtime's library file.

use std::path::PathBuf;

use crate::LibrarySearch;
use crate::libraries;

/// Names the library file. If it is set and the environment may name libraries, no other path is tried.
pub(super) const VARIABLE: &str = "CAIRN_ONNXRUNTIME";

const RELEASE: &str = "onnxruntime-1.24.4";

/// File names, the most specific first.
const NAMES: &[&str] = if cfg!(windows) {
    &["onnxruntime.dll"]
} else {
    &["libonnxruntime.so.1.24.4", "libonnxruntime.so.1", "libonnxruntime.so"]
};

/// The file to load, or every path that was tried.
pub(super) fn library(search: &LibrarySearch) -> Result<PathBuf, Vec<PathBuf>> {
    if let Some(path) = search.onnxruntime.clone().or_else(|| search.variable(VARIABLE)) {
        return Ok(path);
    }
    let mut folders = libraries::own_folders();
    folders.extend(cache(search).map(|cache| cache.join("cairn").join(RELEASE)));
    let mut tried = Vec::new();
    for path in folders.iter().flat_map(|folder| NAMES.iter().map(move |name| folder.join(name))) {
        if path.is_file() {
            return Ok(path);
        }
        tried.push(path);
    }
    Err(tried)
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
