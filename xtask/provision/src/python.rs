//! The machine's Python, its pip, and an environment of our own with pinned packages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

use crate::cache::{self, size_of};
use crate::process::{self, ProcessOutput};
use crate::{Error, Progress, Result, repository};

/// A version, major and minor.
type Version = (u32, u32);

/// The oldest Python that works.
const OLDEST: Version = (3, 11);

/// The newest Python that the pinned packages have wheels for.
const NEWEST: Version = (3, 14);

/// The oldest pip that has the option `--python`.
const OLDEST_PIP: Version = (22, 3);

/// Tried in this order; the versioned names help where `python3` is too old or too new, and `py` starts the Pythons of Windows that are not on
/// the PATH.
const NAMES: [&str; 7] = ["python3", "python", "py", "python3.14", "python3.13", "python3.12", "python3.11"];

/// Python's options for printing paths: without the user's variables and packages, and in UTF-8. On Windows it would print in the ANSI code
/// page, which lacks letters that a user's name may have.
const PRINT_UTF8: [&str; 3] = ["-X", "utf8", "-I"];

/// Pinned packages, one per line.
pub(crate) const REQUIREMENTS: &str = include_str!("../requirements.txt");

/// Additional packages for training, also pinned.
const TRAINING: &str = include_str!("../training.txt");

/// All packages for a sweep through Ray, also pinned.
const CLUSTER: &str = include_str!("../cluster.txt");

/// A Python of a supported version that has pip.
#[derive(Debug)]
pub(crate) struct Python {
    /// Path of the interpreter.
    pub(crate) program: PathBuf,
    /// Its version and path, the same for every run of the same installation.
    identity: String,
    /// Whether it is that of the Microsoft Store.
    is_of_store: bool,
}

/// Finds the machine's Python: `$CAIRN_PYTHON`, else the first of the usual names that is suitable.
pub(crate) fn find() -> Result<Python> {
    let own = std::env::var_os("CAIRN_PYTHON").filter(|value| !value.is_empty());
    match own {
        Some(own) => first_of(
            &[PathBuf::from(&own)],
            OLDEST,
            &format!("CAIRN_PYTHON names {}, which does not run", own.display()),
        ),
        None => first_of(&NAMES.map(PathBuf::from), OLDEST, "no python3 or python is on the PATH"),
    }
}

/// Finds a newer Python than most features need: the usual one if it suffices, else any of the usual names, else one
/// that pyenv has.
pub(crate) fn find_at_least(oldest: Version) -> Result<Python> {
    let mut candidates: Vec<PathBuf> = std::env::var_os("CAIRN_PYTHON").into_iter().map(PathBuf::from).collect();
    candidates.extend(NAMES.map(PathBuf::from));
    let root = std::env::var_os("PYENV_ROOT").map(PathBuf::from);
    let root = root.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".pyenv")));
    let kept = root.and_then(|root| fs::read_dir(root.join("versions")).ok());
    let mut kept: Vec<PathBuf> =
        kept.into_iter().flatten().flatten().map(|entry| entry.path().join("bin/python")).collect();
    kept.sort();
    candidates.extend(kept);
    first_of(&candidates, oldest, "no python3 or python is on the PATH")
}

/// The first Python of `names` from `oldest` to [`NEWEST`] with a suitable pip; `nothing` is the message if there is none at all.
fn first_of(names: &[PathBuf], oldest: Version, nothing: &str) -> Result<Python> {
    // What the Store's Python writes below AppData, where the cache is, Windows keeps apart, and no other program sees it.
    let may_be_of_store = std::env::var_os("CAIRN_CACHE_DIR").is_some();
    let (mut seen, mut of_store, mut without_pip) = (Vec::new(), None, None);
    for name in names {
        match python_at(name, oldest) {
            Ok(python) if python.is_of_store && !may_be_of_store => of_store = of_store.or(Some(python)),
            Ok(python) => match require_pip(&python) {
                Ok(()) => return Ok(python),
                Err(why) => without_pip = without_pip.or(Some(why)),
            },
            Err(Some(why)) => seen.push(why),
            Err(None) => {}
        }
    }
    if let Some(why) = without_pip {
        return Err(why);
    }
    if let Some(Python { program, .. }) = of_store {
        let cause =
            format!("{} is of the Microsoft Store, and other programs do not see what it writes", program.display());
        let remedy = "Install Python of python.org, or set CAIRN_CACHE_DIR to a folder that is not below AppData";
        return Err(Error::new("a Python whose files others see", cause, remedy));
    }
    let cause = match seen.is_empty() {
        true => nothing.to_owned(),
        false => format!("only other versions were found: {}", seen.join(", ")),
    };
    let wanted = format!("Python {} to {}", dotted(oldest), dotted(NEWEST));
    let remedy = format!(
        "Install {wanted} with pip (Debian and Ubuntu: apt install python3 python3-pip; Fedora: dnf install python3-pip; \
         Arch: pacman -S python-pip; Windows: python.org), or set CAIRN_PYTHON to one"
    );
    Err(Error::new(wanted, cause, remedy))
}

fn dotted((major, minor): Version) -> String {
    format!("{major}.{minor}")
}

/// The first two numbers of a version such as `3.11` or `22.3.1`; `None` if it does not start with two numbers.
fn version(text: &str) -> Option<Version> {
    let mut numbers = text.split('.').map(|number| number.parse().ok());
    Some((numbers.next()??, numbers.next()??))
}

/// The Python that `name` starts; else its version if that is not supported, or `None` if there is none.
fn python_at(name: &Path, oldest: Version) -> Result<Python, Option<String>> {
    const QUESTION: &str = "import sys, platform; print('%d.%d' % sys.version_info[:2]); \
                            print(platform.python_version(), platform.machine(), sys.base_prefix); print(sys.executable)";
    let arguments = [&PRINT_UTF8[..], &["-c", QUESTION]].concat();
    let answer = process::run(Command::new(name).args(arguments), |_| {}).map_err(|_| None)?;
    let [found, identity, program] = answer.stdout.lines().collect::<Vec<_>>()[..] else { return Err(None) };
    let found = version(found.trim()).ok_or(None)?;
    if !(oldest..=NEWEST).contains(&found) {
        return Err(Some(format!("{} is {}", name.display(), dotted(found))));
    }
    let is_of_store = cfg!(windows) && program.to_ascii_lowercase().contains("\\windowsapps\\");
    Ok(Python { program: name.to_owned(), identity: identity.trim().to_owned(), is_of_store })
}

fn require_pip(python: &Python) -> Result<()> {
    let answer = process::run(Command::new(&python.program).args(["-m", "pip", "--version"]), |_| {})
        .map_err(|e| Error::io(&python.program, &e))?;
    let program = python.program.display();
    if !answer.status.success() {
        return Err(Error::new(
            "pip",
            format!("\"{program} -m pip\" does not work: {}", answer.tail(1)),
            "Install pip for that Python (Debian and Ubuntu: apt install python3-pip; Fedora: dnf install python3-pip; Arch: \
             pacman -S python-pip; elsewhere: python3 -m ensurepip)",
        ));
    }
    match pip_version(&answer.stdout) {
        Some(found) if found < OLDEST_PIP => Err(Error::new(
            format!("pip {} or newer", dotted(OLDEST_PIP)),
            format!("\"{program} -m pip\" is {}", dotted(found)),
            format!("Run {program} -m pip install --user -U pip"),
        )),
        _ => Ok(()),
    }
}

/// The version that `pip --version` prints, as in `pip 23.0.1 from /usr/lib/python3/dist-packages/pip (python 3.11)`.
fn pip_version(printed: &str) -> Option<Version> {
    version(printed.trim_start().strip_prefix("pip ")?.split_whitespace().next()?)
}

/// Runs pip with the machine's own configuration, shows how much has arrived under `watched`, and explains a failure.
pub(crate) fn pip(
    python: &Python,
    arguments: &[&str],
    wanted: &str,
    watched: &Path,
    progress: &dyn Progress,
) -> Result<ProcessOutput> {
    // pip downloads into the temporary folder first; with one of our own its growth can be watched.
    let temporary = watched.join("pip-temporary");
    fs::create_dir_all(&temporary).map_err(|e| Error::io(&temporary, &e))?;
    let mut command = Command::new(&python.program);
    command
        .args(["-m", "pip", "--disable-pip-version-check", "--no-input"])
        .args(arguments)
        .env("TMPDIR", &temporary)
        .env("TEMP", &temporary)
        .env("TMP", &temporary)
        .env_remove("PIP_TARGET")
        .env_remove("PIP_USER")
        .env_remove("PIP_PREFIX")
        .env_remove("PIP_REQUIRE_VIRTUALENV");
    #[expect(clippy::cast_precision_loss, reason = "a size shown with one decimal")]
    let outcome = process::run(&mut command, |_| progress.detail(&format!("{:.1} MB", size_of(watched) as f64 / 1e6)))
        .map_err(|e| Error::io(&python.program, &e))?;
    cache::remove(&temporary)?;
    if outcome.status.success() { Ok(outcome) } else { Err(explain(wanted, &outcome)) }
}

/// Describes pip's failure, with the end of its output.
fn explain(wanted: &str, outcome: &ProcessOutput) -> Error {
    const OFFLINE: [&str; 6] = [
        "Failed to establish a new connection",
        "Temporary failure in name resolution",
        "NameResolutionError",
        "Max retries exceeded",
        "ConnectTimeoutError",
        "Connection refused",
    ];
    let all = format!("{}\n{}", outcome.stdout, outcome.stderr);
    let tail = outcome.tail(4);
    // For an unreachable index pip prints "No matching distribution", so connection errors are checked first.
    if OFFLINE.iter().any(|sign| all.contains(sign)) {
        let remedy = "Connect to the network, or name an index that can be reached in pip's own configuration \
                      (PIP_INDEX_URL or pip.conf), and run the command again";
        return Error::new(wanted, format!("pip cannot reach the package index:\n{tail}\n"), remedy);
    }
    if all.contains("No matching distribution") {
        let remedy = "Check that pip's index carries this version for this platform (pip config list), or use 64-bit \
                      Python on Linux or Windows";
        return Error::new(wanted, format!("pip finds no such package:\n{tail}\n"), remedy);
    }
    if all.contains("No space left on device") {
        return Error::new(wanted, "the disk is full", "Make room, or set CAIRN_CACHE_DIR to a folder on another disk");
    }
    Error::new(wanted, format!("pip failed:\n{tail}\n"), "Mend what pip names above and run the command again")
}

/// A Python interpreter with the packages of the bundle builder and the Python tests; made on first use.
///
/// Run it with [`python_path`] as `PYTHONPATH` to import this repository's own package `cairn`.
///
/// # Errors
/// No Python of a supported version with pip, an unreachable package index, or a disk that is full: cause and remedy are named.
pub fn python_env(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "the Python environment of the bundle builder";
    environment("python", &find()?, REQUIREMENTS, wanted, progress).map(|folder| interpreter(&folder))
}

/// A Python interpreter with the packages of [`python_env`] and JAX, which trains the miniature world; made on first use.
///
/// # Errors
/// As [`python_env`].
pub fn training_env(progress: &dyn Progress) -> Result<PathBuf> {
    let requirements = format!("{REQUIREMENTS}{TRAINING}");
    let wanted = "the Python environment of the training";
    environment("training", &find()?, &requirements, wanted, progress).map(|folder| interpreter(&folder))
}

/// A Python interpreter with Ray, numpy and pytest, for sweeps through Ray; made on first use.
///
/// # Errors
/// As [`python_env`].
pub fn cluster_env(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "the Python environment of sweeps through Ray";
    environment("cluster", &find()?, CLUSTER, wanted, progress).map(|folder| interpreter(&folder))
}

/// The folder of an environment of `python` with the packages of `requirements`, one per line; made on first use.
pub(crate) fn environment(
    name: &str,
    python: &Python,
    requirements: &str,
    wanted: &str,
    progress: &dyn Progress,
) -> Result<PathBuf> {
    let mut key = Sha256::new();
    key.update(requirements);
    key.update(&python.identity);
    let name = format!("{name}-{}", &cache::hex(&key.finalize())[..12]);
    let folder = cache::cache_dir()?.join(&name);
    let program = interpreter(&folder);
    let complete = folder.join("complete");
    if complete.is_file() && program.is_file() {
        return Ok(folder);
    }

    let _held = cache::lock(&name, progress)?;
    if complete.is_file() && program.is_file() {
        return Ok(folder);
    }
    let packages: Vec<&str> =
        requirements.lines().filter_map(|line| line.split_once("==")).map(|(name, _)| name).collect();
    let few = packages.iter().take(4).copied().collect::<Vec<_>>().join(", ");
    let more = if packages.len() > 4 { " and others" } else { "" };
    progress.start(&format!("making {wanted} ({few}{more} from PyPI)"));
    // An environment cannot be moved, so it is made in place and marked when complete.
    cache::remove(&folder)?;
    fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, &e))?;
    // Without its own pip: some distributions ship ensurepip apart, and the machine's pip can install into it.
    let made = process::run(Command::new(&python.program).args(["-m", "venv", "--without-pip"]).arg(&folder), |_| {})
        .map_err(|e| Error::io(&python.program, &e))?;
    if !made.status.success() {
        let cause = format!("\"{} -m venv\" failed:\n{}\n", python.program.display(), made.tail(3));
        return Err(Error::new(
            wanted,
            cause,
            "Install Python's venv module (Debian and Ubuntu: apt install python3-venv)",
        ));
    }
    let list = folder.join("requirements.txt");
    fs::write(&list, requirements).map_err(|e| Error::io(&list, &e))?;
    let (into, list) = (text(&program)?, text(&list)?);
    let arguments = ["--python", into, "install", "--quiet", "--only-binary=:all:", "--no-deps", "-r", list];
    pip(python, &arguments, wanted, &folder, progress)?;
    fs::write(&complete, &python.identity).map_err(|e| Error::io(&complete, &e))?;
    progress.done(&format!("{wanted}: {}", folder.display()));
    Ok(folder)
}

/// The interpreter of an environment.
pub(crate) fn interpreter(environment: &Path) -> PathBuf {
    environment.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" })
}

/// The folder with an environment's packages.
pub(crate) fn packages_of(environment: &Path) -> Result<PathBuf> {
    const QUESTION: &str = "import sysconfig; print(sysconfig.get_path('purelib'))";
    let program = interpreter(environment);
    let arguments = [&PRINT_UTF8[..], &["-c", QUESTION]].concat();
    let answer = process::run(Command::new(&program).args(arguments), |_| {}).map_err(|e| Error::io(&program, &e))?;
    Ok(PathBuf::from(answer.stdout.trim()))
}

/// Installs this repository's package `cairn` into the folder `into`, as a user does, but without dependencies: with the shared
/// library `library` in it, or with none.
///
/// # Errors
/// pip fails, for example because it cannot have setuptools, which builds the package.
pub fn install_package(library: Option<&Path>, into: &Path) -> Result<()> {
    let python = find()?;
    let mut command = Command::new(&python.program);
    command.args(["-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--no-deps", "--target"]);
    command.arg(into).arg(python_path()).env_remove("CAIRN_LIBRARY").envs(library.map(|file| ("CAIRN_LIBRARY", file)));
    let outcome = process::run(&mut command, |_| {}).map_err(|e| Error::io(&python.program, &e))?;
    if outcome.status.success() { Ok(()) } else { Err(explain("the package cairn", &outcome)) }
}

/// Builds this repository's package `cairn` as a wheel without a library in a new folder `into`, as a user does.
///
/// # Errors
/// As [`install_package`].
pub fn build_package(into: &Path) -> Result<PathBuf> {
    cache::remove(into)?;
    let python = find()?;
    let mut command = Command::new(&python.program);
    command.args(["-m", "pip", "--disable-pip-version-check", "--no-input", "wheel", "--quiet", "--no-deps"]);
    command.arg("--wheel-dir").arg(into).arg(python_path()).env_remove("CAIRN_LIBRARY");
    let outcome = process::run(&mut command, |_| {}).map_err(|e| Error::io(&python.program, &e))?;
    if !outcome.status.success() {
        return Err(explain("the package cairn", &outcome));
    }
    let files = fs::read_dir(into).map_err(|e| Error::io(into, &e))?;
    let wheel = files.flatten().map(|entry| entry.path()).find(|path| path.extension().is_some_and(|e| e == "whl"));
    wheel.ok_or_else(|| Error::new("the package cairn", "pip made no wheel", "Update pip"))
}

/// The folder of this repository's Python package, for `PYTHONPATH`.
pub fn python_path() -> PathBuf {
    repository().join("bindings").join("python")
}

/// A path as text, as pip's command line needs it.
pub(crate) fn text(path: &Path) -> Result<&str> {
    path.to_str().ok_or_else(|| {
        Error::new(
            path.display().to_string(),
            "the path is not valid Unicode",
            "Set CAIRN_CACHE_DIR to a folder with a plain name",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_requirement_is_pinned() {
        let packages: Vec<&str> = [REQUIREMENTS, TRAINING, CLUSTER, crate::wheels::AUDIT]
            .iter()
            .flat_map(|list| list.lines())
            .filter(|line| !line.starts_with('#'))
            .collect();
        assert!(packages.len() > 34);
        for package in packages {
            let (name, version) = package.split_once("==").unwrap_or_else(|| panic!("{package} is not pinned"));
            assert!(!name.is_empty() && version.starts_with(|c: char| c.is_ascii_digit()), "{package}");
        }
        let runtime = format!("onnxruntime=={}\n", crate::ONNXRUNTIME_VERSION);
        assert!(REQUIREMENTS.contains(&runtime), "the tests' ONNX Runtime is the library's");
    }

    #[test]
    fn versions_of_python_and_pip_are_read() {
        assert_eq!(version("3.11"), Some((3, 11)));
        assert_eq!(version("3"), None);
        let pip = |number: &str| {
            pip_version(&format!("pip {number} from /usr/lib/python3/dist-packages/pip (python 3.11)\n"))
        };
        assert_eq!(pip("23.0.1"), Some((23, 0)));
        assert_eq!(pip("25.0"), Some((25, 0)));
        assert!(pip("22.0.2") < Some(OLDEST_PIP) && pip("22.3") >= Some(OLDEST_PIP));
        assert_eq!(pip_version("another program"), None);
    }

    #[test]
    fn a_python_outside_the_supported_versions_is_refused() {
        assert!(python_at(Path::new("no-such-program-of-ours"), OLDEST).is_err_and(|why| why.is_none()));
        // No Python is as new as this one must be.
        let Err(why) = first_of(&NAMES.map(PathBuf::from), (4, 0), "none") else { panic!("a Python 4") };
        assert!(why.wanted.contains("4.0 to 3.14"), "{why}");
    }

    #[cfg(unix)]
    #[test]
    fn an_unreachable_index_and_a_missing_package_have_different_errors() {
        use std::os::unix::process::ExitStatusExt;
        let failed = |stderr: &str| ProcessOutput {
            status: std::process::ExitStatus::from_raw(256),
            stdout: String::new(),
            stderr: stderr.to_owned(),
        };
        let offline = explain(
            "numpy",
            &failed("WARNING: Retrying: Temporary failure in name resolution\nERROR: No matching distribution found"),
        );
        assert!(offline.to_string().contains("cannot reach"), "{offline}");
        let missing = explain("numpy", &failed("ERROR: No matching distribution found for numpy==9"));
        assert!(missing.to_string().contains("no such package"), "{missing}");
    }
}
