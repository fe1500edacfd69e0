//! Third-party packages by version and SHA-256: one file of a package, or all of them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::python::{self, Python, text};
use crate::{Error, Progress, Result, cache, process};

/// A file inside a package, and its checksum.
pub(crate) struct Pinned {
    /// Pattern of the package's file name.
    pub(crate) package: &'static str,
    /// Path inside the package. `!` follows the path of an archive inside it.
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

/// A package on PyPI at one version, with the checksum of its only file.
pub(crate) struct PyPi {
    pub(crate) name: &'static str,
    pub(crate) version: &'static str,
    pub(crate) sha256: &'static str,
}

/// The form in which a package is published.
#[derive(Clone, Copy)]
pub(crate) enum Form {
    Source,
    Wheel,
}

impl Form {
    /// pip's flag for this form only.
    fn flag(self) -> &'static str {
        match self {
            Self::Source => "--no-binary=:all:",
            Self::Wheel => "--only-binary=:all:",
        }
    }
}

impl PyPi {
    /// Its name in the cache.
    pub(crate) fn item(&self) -> String {
        format!("{}-{}", self.name, self.version)
    }

    /// Runs pip with `arguments`, which begin with `install` or `download`, on the pinned file only.
    fn pip(
        &self,
        python: &Python,
        arguments: &[&str],
        wanted: &str,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<()> {
        let list = folder.join("requirements.txt");
        let line = format!("{}=={} --hash=sha256:{}\n", self.name, self.version, self.sha256);
        fs::write(&list, line).map_err(|e| Error::io(&list, &e))?;
        let all = [arguments, &["--quiet", "--no-deps", "--require-hashes", "-r", text(&list)?]].concat();
        python::pip(python, &all, wanted, folder, progress).map(drop)
    }

    /// Downloads its file unchanged into a folder.
    pub(crate) fn download(
        &self,
        form: Form,
        python: &Python,
        wanted: &str,
        into: &Path,
        progress: &dyn Progress,
    ) -> Result<()> {
        self.pip(python, &["download", form.flag(), "--dest", text(into)?], wanted, into, progress)
    }

    /// The folder of its installed wheel in the cache; fetched on first use. It must contain `program`, which is made executable. `size` is
    /// shown while it is fetched.
    pub(crate) fn files(&self, program: &str, wanted: &str, size: &str, progress: &dyn Progress) -> Result<PathBuf> {
        self.files_for(None, program, wanted, size, progress)
    }

    /// The same for its wheel for another platform, by pip's name of that.
    pub(crate) fn files_for(
        &self,
        platform: Option<&str>,
        program: &str,
        wanted: &str,
        size: &str,
        progress: &dyn Progress,
    ) -> Result<PathBuf> {
        let item = platform.map_or_else(|| self.item(), |platform| format!("{}-{platform}", self.item()));
        let folder = cache::cache_dir()?.join(&item);
        if folder.join(program).is_file() {
            return Ok(folder);
        }
        let held = cache::lock(&item, progress)?;
        if folder.join(program).is_file() {
            return Ok(folder);
        }
        let python = python::find()?;
        progress.start(&format!("fetching {wanted} ({item} from PyPI, {size})"));
        let scratch = cache::scratch(&item, &held)?;
        let root = scratch.join("root");
        let mut arguments = vec!["install", "--no-compile", Form::Wheel.flag(), "--target", text(&root)?];
        arguments.extend(platform.iter().flat_map(|platform| ["--platform", *platform]));
        self.pip(&python, &arguments, wanted, &scratch, progress)?;
        let fetched = root.join(program);
        if !fetched.is_file() {
            let cause = format!("its package has no {}", fetched.display());
            return Err(Error::new(wanted, cause, "Check pip's configuration: --target must put programs into bin"));
        }
        executable(&fetched).map_err(|e| Error::io(&fetched, &e))?;
        cache::publish(&root, &folder)?;
        cache::remove(&scratch)?;
        progress.done(&format!("{wanted}: {}", folder.display()));
        Ok(folder)
    }
}

/// Makes a file executable, which its package may not do.
fn executable(file: &Path) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(file, fs::Permissions::from_mode(0o755))?;
    }
    fs::metadata(file).map(drop)
}

#[cfg(test)]
impl PyPi {
    pub(crate) fn is_pinned(&self) -> bool {
        self.sha256.len() == 64 && self.sha256.bytes().all(|b| b.is_ascii_hexdigit())
    }
}

/// Unpacks an npm package, `name@version`, into a folder; `wanted` names what it is fetched for.
pub(crate) fn npm(package: &str, wanted: &str, into: &Path, progress: &dyn Progress) -> Result<()> {
    let fail = |cause: String| {
        let remedy =
            "Install npm (Debian and Ubuntu: apt install npm), connect to the network and run the command again";
        Error::new(wanted, cause, remedy)
    };
    // On Windows npm is a script that must be started by its full name.
    let npm = if cfg!(windows) { "npm.cmd" } else { "npm" };
    let mut command = Command::new(npm);
    command.args(["pack", "--silent", package]).current_dir(into);
    let outcome =
        process::run(&mut command, |line| progress.detail(line)).map_err(|e| fail(format!("npm does not run: {e}")))?;
    if outcome.status.success() { Ok(()) } else { Err(fail(format!("npm failed:\n{}\n", outcome.tail(3)))) }
}

/// A file of a package that `fetch` puts into a folder; it is checked and kept in the cache as `item`.
pub(crate) fn pinned_file(
    item: &str,
    wanted: &str,
    file: &Pinned,
    fetch: &dyn Fn(&Python, &Path) -> Result<()>,
    progress: &dyn Progress,
) -> Result<PathBuf> {
    const SCRIPT: &str = "import io, pathlib, sys, tarfile, zipfile\n\
        folder, pattern, inside, target = pathlib.Path(sys.argv[1]), *sys.argv[2:]\n\
        (package,) = folder.glob(pattern)\n\
        data = package.read_bytes()\n\
        for path in inside.split('!'):\n\
        \x20   archive = io.BytesIO(data)\n\
        \x20   if zipfile.is_zipfile(archive):\n\
        \x20       data = zipfile.ZipFile(archive).read(path)\n\
        \x20   else:\n\
        \x20       data = tarfile.open(fileobj=io.BytesIO(data)).extractfile(path).read()\n\
        (folder / 'file').mkdir()\n\
        (folder / 'file' / target).write_bytes(data)\n";
    let folder = cache::cache_dir()?.join(item);
    let kept = folder.join(file.name);
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
    cache::publish(&unpacked, &folder)?;
    cache::remove(&scratch)?;
    progress.done(&format!("{wanted}: {}", kept.display()));
    Ok(kept)
}
