//! File names of AMD's libraries, and the search for their folder.

#[cfg(any(windows, test))]
use std::path::{Path, PathBuf};

use crate::ffx::Effect;
#[cfg(any(windows, test))]
use crate::{Error, ErrorKind, LibrarySearch, Result};

/// One of AMD's libraries, by purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LibraryKind {
    /// Forwards calls to the effects' libraries. SDK 2.0 and later.
    Loader,
    /// Frame generation and its swap chain. SDK 2.0 and later.
    FrameGeneration,
    /// Upscaling. SDK 2.0 and later.
    Upscaler,
    /// All effects in one. SDK 1.1.
    Whole,
}

impl LibraryKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Loader, Self::FrameGeneration, Self::Upscaler, Self::Whole];

    /// The name of its file.
    pub fn file_name(self) -> &'static str {
        match self {
            Self::Loader => "amd_fidelityfx_loader_dx12.dll",
            Self::FrameGeneration => "amd_fidelityfx_framegeneration_dx12.dll",
            Self::Upscaler => "amd_fidelityfx_upscaler_dx12.dll",
            Self::Whole => "amd_fidelityfx_dx12.dll",
        }
    }

    /// The library of one effect.
    pub fn of(effect: Effect) -> Self {
        match effect {
            Effect::FrameGeneration => Self::FrameGeneration,
            Effect::Upscaling => Self::Upscaler,
        }
    }
}

/// The folder that the host names, or `CAIRN_FFX_DIR` if the host allows the environment.
#[cfg(any(windows, test))]
pub(super) fn configured_folder(search: &LibrarySearch) -> Option<PathBuf> {
    search.ffx.clone().or_else(|| search.variable("CAIRN_FFX_DIR"))
}

/// The folder to load from: `given` and no other, else the first of `others` that holds a library. Always absolute: the system
/// searches for a relative path in folders that other users may write to.
#[cfg(any(windows, test))]
pub(super) fn folder(given: Option<&Path>, others: &[PathBuf]) -> Result<PathBuf> {
    let given = given.map(|directory| [directory.to_owned()]);
    let directories = given.as_ref().map_or(others, |one| one.as_slice());
    let holds_one =
        |directory: &&PathBuf| LibraryKind::ALL.iter().any(|kind| directory.join(kind.file_name()).is_file());
    let found = directories.iter().find(holds_one);
    let found =
        found.map(|directory| std::path::absolute(directory).map_err(|e| Error::new(ErrorKind::Io, e.to_string())));
    found.unwrap_or_else(|| {
        let looked: Vec<_> = directories.iter().map(|directory| directory.display().to_string()).collect();
        Err(Error::new(
            ErrorKind::RuntimeMissing,
            format!("AMD's libraries were not found; looked in {}", looked.join(", ")),
        )
        .field(LibraryKind::FrameGeneration.file_name())
        .remedy(
            "Put amd_fidelityfx_loader_dx12.dll and the libraries of the effects, from AMD's FidelityFX SDK, there",
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A temporary folder with these files, empty.
    fn with(name: &str, parts: &[LibraryKind]) -> PathBuf {
        let directory = std::env::temp_dir().join(format!("cairn-ffx-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&directory).expect("a folder");
        for kind in parts {
            std::fs::write(directory.join(kind.file_name()), "").expect("a file");
        }
        directory
    }

    #[test]
    fn only_the_given_folder_is_searched_or_else_the_first_with_a_library() {
        let (empty, old, new) =
            (with("empty", &[]), with("old", &[LibraryKind::Whole]), with("new", &[LibraryKind::FrameGeneration]));
        let others = [empty.clone(), new.clone(), old.clone()];
        assert_eq!(folder(None, &others).expect("found"), new);
        assert_eq!(folder(Some(&old), &others).expect("found"), old);
        for (given, looked) in [(Some(empty.as_path()), [&empty].as_slice()), (None, &[])] {
            let missing = folder(given, &[]).expect_err("nothing is there");
            assert_eq!(missing.kind(), ErrorKind::RuntimeMissing);
            assert!(
                looked.iter().all(|directory| missing.cause().contains(&*directory.display().to_string())),
                "{missing}"
            );
        }
        for directory in [empty, old, new] {
            _ = std::fs::remove_dir_all(directory);
        }
    }

    #[test]
    fn a_host_s_folder_is_used() {
        let folder = Some(PathBuf::from("a folder of AMD's"));
        let search = LibrarySearch { ffx: folder.clone(), ..LibrarySearch::for_tools() };
        assert_eq!(configured_folder(&search), folder);
        assert_eq!(configured_folder(&LibrarySearch::default()), None);
    }

    #[test]
    fn a_relative_folder_becomes_absolute() {
        let directory = with("relative", &[LibraryKind::Loader]);
        let here = std::env::current_dir().expect("a folder");
        let up: PathBuf = here.components().skip(1).map(|_| "..").collect();
        let relative = up.join(directory.strip_prefix("/").unwrap_or(&directory));
        assert!(folder(Some(&relative), &[]).expect("found").is_absolute());
        _ = std::fs::remove_dir_all(directory);
    }
}
