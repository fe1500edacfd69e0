//! The workspace: the repository's root, cargo's target folder, and commands that run in the root.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::tools;

/// Removes a file or a folder with all that is in it; a missing one is no error.
pub(crate) fn remove(path: &Path) -> Result<(), String> {
    let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match removed {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(format!("{}: {e}", path.display())),
        _ => Ok(()),
    }
}

/// Makes a folder empty, or creates it.
pub(crate) fn make_empty(folder: &Path) -> Result<(), String> {
    remove(folder)?;
    fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))
}

/// The workspace that this program was compiled in.
#[derive(Debug, Clone)]
pub(crate) struct Workspace {
    pub(crate) root: PathBuf,
    /// Cargo's target directory, as the environment sets it.
    pub(crate) target: PathBuf,
    /// Names of the workspace's packages.
    pub(crate) packages: Vec<String>,
}

impl Workspace {
    pub(crate) fn find() -> Result<Self, String> {
        let root = provision::repository().to_owned();
        let mut command = Command::new(tools::cargo());
        command.args(["metadata", "--format-version", "1", "--no-deps"]).current_dir(&root);
        let output = command.output().map_err(|e| format!("cargo does not run: {e}. Install Rust with rustup"))?;
        if !output.status.success() {
            return Err(format!("cargo metadata failed:\n{}", String::from_utf8_lossy(&output.stderr)));
        }
        let data: serde_json::Value =
            serde_json::from_slice(&output.stdout).map_err(|e| format!("cargo metadata is not JSON: {e}"))?;
        let target = data["target_directory"].as_str().ok_or("cargo metadata names no target directory")?;
        let packages = data["packages"].as_array().into_iter().flatten();
        let packages = packages.filter_map(|package| package["name"].as_str()).map(str::to_owned).collect();
        Ok(Self { root, target: PathBuf::from(target), packages })
    }

    /// A cargo command in the repository's root.
    pub(crate) fn cargo<'a>(&self, arguments: impl IntoIterator<Item = &'a str>) -> Command {
        let mut command = Command::new(tools::cargo());
        command.args(arguments).current_dir(&self.root);
        command
    }

    /// A program of the workspace in cargo's folder for the profile (`debug`, `release`).
    pub(crate) fn program(&self, profile: &str, name: &str) -> PathBuf {
        self.target.join(profile).join(format!("{name}{}", std::env::consts::EXE_SUFFIX))
    }

    /// Cargo's folder of programs for Windows; test programs are in its folder `deps`.
    pub(crate) fn windows_programs(&self) -> PathBuf {
        let target = if cfg!(windows) { self.target.clone() } else { self.target.join(tools::WINDOWS_TARGET) };
        target.join("debug")
    }

    /// The tracked and the new files of the repository, with `/`, relative to its root.
    pub(crate) fn files(&self) -> Result<Vec<String>, String> {
        let mut git = Command::new("git");
        git.args(["ls-files", "--cached", "--others", "--exclude-standard", "-z"]).current_dir(&self.root);
        match git.output() {
            Ok(output) if output.status.success() => Ok(String::from_utf8_lossy(&output.stdout)
                .split('\0')
                .filter(|name| !name.is_empty() && self.root.join(name).is_file())
                .map(str::to_owned)
                .collect()),
            Ok(output) => Err(format!("git ls-files failed: {}", String::from_utf8_lossy(&output.stderr))),
            Err(e) => Err(format!("git does not run: {e}. Install git")),
        }
    }

    /// The text of a file in the repository.
    pub(crate) fn read(&self, name: &str) -> Result<String, String> {
        fs::read_to_string(self.root.join(name)).map_err(|e| format!("{name}: {e}"))
    }
}
