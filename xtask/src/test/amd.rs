//! Runs with and without AMD's own libraries: tests on Direct3D 12 run both ways if `CAIRN_FFX_DIR` names the libraries' folder, and
//! else without them only.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::Ordering;

use super::Context;
use super::tally::{Skip, Tally};

/// The folder of AMD's own libraries, which may not be redistributed.
const VARIABLE: &str = "CAIRN_FFX_DIR";
/// Makes tools load libraries that AMD has not signed.
const UNSIGNED: &str = "CAIRN_FFX_UNSIGNED";

/// Which of AMD's libraries a program finds.
#[derive(Debug, Clone)]
pub(super) enum Amd {
    None,
    /// AMD's own signed libraries in that folder.
    Own(PathBuf),
    /// A test double in that folder.
    Double(PathBuf),
}

impl Amd {
    /// AMD's own libraries, if this machine has them.
    pub(super) fn own() -> Result<Option<Self>, String> {
        let folder = std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty()).map(PathBuf::from);
        folder
            .map(|folder| std::path::absolute(folder).map(Self::Own))
            .transpose()
            .map_err(|e| format!("{VARIABLE}: {e}"))
    }

    /// Runs something with AMD's own libraries in a library's folder, where an engine's plugin looks for them, or with none there: plugins
    /// read no environment variable.
    pub(super) fn beside<T>(&self, folder: &Path, run: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        remove_libraries(folder)?;
        if let Self::Own(own) = self {
            for file in libraries_in(own)? {
                let to = folder.join(file.file_name().unwrap_or_default());
                fs::copy(&file, &to).map_err(|e| format!("{}: {e}", to.display()))?;
            }
        }
        let ran = run();
        remove_libraries(folder)?;
        ran
    }

    /// Makes a command find these libraries and no others.
    pub(super) fn provide(&self, command: &mut Command) {
        command.env_remove(VARIABLE).env_remove(UNSIGNED);
        match self {
            Self::None => {}
            Self::Own(folder) => {
                command.env(VARIABLE, folder);
            }
            Self::Double(folder) => {
                command.env(VARIABLE, folder).env(UNSIGNED, "1");
            }
        }
    }
}

/// Files in a folder that have the names of AMD's libraries.
fn libraries_in(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let names = entries.flatten().map(|entry| entry.path());
    let is_amd_s = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        name.starts_with("amd_fidelityfx_") && name.ends_with(".dll")
    };
    Ok(names.filter(is_amd_s).collect())
}

fn remove_libraries(folder: &Path) -> Result<(), String> {
    for file in libraries_in(folder)? {
        fs::remove_file(&file).map_err(|e| format!("{}: {e}", file.display()))?;
    }
    Ok(())
}

impl Context<'_> {
    /// Runs something without AMD's libraries, and again with them if this machine has them. Their absence is reported once.
    pub(super) fn with_and_without_amd(
        &self,
        tally: &mut Tally,
        mut run: impl FnMut(&Amd) -> Result<Tally, String>,
    ) -> Result<(), String> {
        tally.add(run(&Amd::None)?);
        match Amd::own()? {
            Some(own) => {
                let mut with = run(&own)?;
                for failure in &mut with.failures {
                    failure.push_str(" (with AMD's own libraries)");
                }
                tally.add(with);
            }
            None if !self.amd_skipped.swap(true, Ordering::Relaxed) => {
                let name = "programs on Direct3D 12 with AMD's own libraries".to_owned();
                tally.skips.push(Skip { name, reason: format!("needs amd-dlls: {VARIABLE} names no folder") });
            }
            None => {}
        }
        Ok(())
    }
}
