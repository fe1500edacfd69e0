//! Where ONNX Runtime's library file is looked for.

use std::path::{Path, PathBuf};

/// Names the library file; nothing else is looked at when it is set.
pub(super) const VARIABLE: &str = "CAIRN_ONNXRUNTIME";

const RELEASE: &str = "onnxruntime-1.24.4";

/// File names, the most exact first.
const NAMES: &[&str] = if cfg!(windows) {
    &["onnxruntime.dll"]
} else {
    &["libonnxruntime.so.1.24.4", "libonnxruntime.so.1", "libonnxruntime.so"]
};

/// The file to load, or every path that was looked at.
pub(super) fn library(explicit: Option<&Path>) -> Result<PathBuf, Vec<PathBuf>> {
    if let Some(path) = explicit {
        return Ok(path.to_owned());
    }
    if let Some(path) = std::env::var_os(VARIABLE).filter(|v| !v.is_empty()) {
        return Ok(path.into());
    }
    let beside = [own_module(), std::env::current_exe().ok()];
    let mut folders: Vec<PathBuf> =
        beside.into_iter().flatten().filter_map(|f| f.parent().map(Path::to_owned)).collect();
    folders.extend(cache().map(|c| c.join("cairn").join(RELEASE)));
    folders.dedup();
    let mut tried = Vec::new();
    for path in folders.iter().flat_map(|folder| NAMES.iter().map(move |name| folder.join(name))) {
        if path.is_file() {
            return Ok(path);
        }
        tried.push(path);
    }
    Err(tried)
}

/// The folder in which `cairn/` holds what was fetched.
fn cache() -> Option<PathBuf> {
    let variable = |name| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    variable("CAIRN_CACHE_DIR").or_else(|| {
        if cfg!(windows) {
            variable("LOCALAPPDATA")
        } else {
            variable("XDG_CACHE_HOME").or_else(|| std::env::home_dir().map(|home| home.join(".cache")))
        }
    })
}

/// The file this very code was loaded from, which is the library when a host loaded it as one: the mapping of this
/// function, where the system lists mappings as files do.
pub(super) fn own_module() -> Option<PathBuf> {
    let here = own_module as fn() -> Option<PathBuf> as usize;
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    maps.lines().find_map(|line| {
        let (range, rest) = line.split_once(' ')?;
        let (from, to) = range.split_once('-')?;
        let (from, to) = (usize::from_str_radix(from, 16).ok()?, usize::from_str_radix(to, 16).ok()?);
        let path = &rest[rest.find('/')?..];
        (from..to).contains(&here).then(|| PathBuf::from(path))
    })
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_module_of_a_test_is_the_test_program() {
        assert_eq!(own_module(), std::env::current_exe().ok());
    }
}
