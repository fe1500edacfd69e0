//! The Python tests: the package's, which use the bundle builder and the shared library, the runtime's parity with the
//! oracle, and the training of the miniature world, whose tests that take minutes are thorough.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::Context;
use super::abi;
use super::junit;
use super::tally::Tally;
use crate::shell::Log;
use crate::workspace;

/// Their folders; each has its own settings, so each is a separate run.
const FOLDERS: [&str; 3] = [PACKAGE, PARITY, TRAINING];
const PACKAGE: &str = "bindings/python";
const PARITY: &str = "tests/parity";
/// The one that needs JAX.
const TRAINING: &str = "samples/worlds/miniature";

/// The largest number of processes that run tests of a folder: each may take 2 GiB of memory.
const MOST_PROCESSES: usize = 4;

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    // The tests use the library and a program of the workspace.
    context.build_programs(log)?;
    let mut tally = Tally::default();
    for folder in FOLDERS {
        let found = suite(context, log, folder, "not long")?;
        tally.add(if found.is_empty() { Tally::broken(format!("{folder} ran no test")) } else { found });
    }
    let library = abi::library(context, log)?;
    for included_library in [Some(library.as_path()), None] {
        tally.test(installed(context, log, &library, included_library)?);
    }
    Ok(tally)
}

/// The training's tests that take minutes.
pub(super) fn long_training(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    context.build_programs(log)?;
    suite(context, log, TRAINING, "long")
}

/// Installs the package as its page says, and checks that it contains the library and finds it without further settings.
fn installed(
    context: &Context<'_>,
    log: &mut Log,
    library: &Path,
    included_library: Option<&Path>,
) -> Result<Option<String>, String> {
    let site = context.workspace.target.join("xtask").join("package");
    workspace::remove(&site)?;
    provision::install_package(included_library, &site).map_err(|e| e.to_string())?;
    let inside = site.join("cairn").join(library.file_name().unwrap_or_default());
    if included_library.is_none() {
        return Ok(inside.exists().then(|| format!("{} is there, and nobody asked for it", inside.display())));
    }
    let mut command = Command::new(context.python()?);
    command
        .args(["-c", "from cairn._library import library; print(library().path)"])
        .current_dir(&context.workspace.target);
    let ended = log.run(command.env("PYTHONPATH", &site).env_remove("CAIRN_LIBRARY"))?;
    let found = ended.success && ended.output.trim() == inside.to_string_lossy();
    Ok((!found).then(|| format!("the installed package does not find its library: {}", ended.output.trim())))
}

/// Runs the tests of a folder whose markers `chosen` takes.
fn suite(context: &Context<'_>, log: &mut Log, folder: &str, chosen: &str) -> Result<Tally, String> {
    let python = if folder == TRAINING { context.training_python()? } else { context.python()? };
    let mut command = Command::new(python);
    command
        .env("PYTHONPATH", provision::python_path())
        .env("CAIRN_LIBRARY", abi::library(context, log)?)
        .env("PARITY_TRACE", context.workspace.program("debug", "parity-trace"))
        .env("SCENES", context.workspace.program("debug", "scenes"));
    context.provide_worlds(&mut command)?;
    if folder == TRAINING {
        context.provide_lpips(&mut command)?;
    }
    let processes = std::thread::available_parallelism().map_or(1, |cores| cores.get().min(MOST_PROCESSES)).to_string();
    // Most tests use one core: they compile, or wait. Those of a file share what its fixtures make; the training's files are too few.
    let side_by_side: &[&str] = match folder {
        TRAINING => &["-n", &processes, "--dist", "worksteal"],
        PACKAGE => &["-n", &processes, "--dist", "loadfile"],
        // Rollouts that several tests share are made once, with every core.
        _ => &[],
    };
    let options = [&["-m", chosen], side_by_side].concat();
    pytest(context, log, command, folder, (&folder.replace('/', "-"), &options))
}

/// Sweeps through Ray, in the only Python environment that has it.
pub(super) fn cluster(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    context.build_programs(log)?;
    let mut command = Command::new(context.cluster_python()?);
    command
        .env("PYTHONPATH", provision::python_path())
        .env("CAIRN_STUDY", context.workspace.program("debug", "study"))
        // Ray sends no usage report, and leaves nothing in the home directory.
        .env("RAY_USAGE_STATS_ENABLED", "0")
        .env("RAY_AUTH_MODE", "disabled")
        // Otherwise its workers would run at a lower priority than every other program.
        .env("RAY_worker_niceness", "0");
    context.provide_worlds(&mut command)?;
    pytest(context, log, command, PACKAGE, ("bindings-python-cluster", &["cluster"]))
}

/// Runs the tests of `folder`, or those that `options` of pytest choose, with a Python that has the packages that they need; the report is
/// called `name`.
pub(super) fn pytest(
    context: &Context<'_>,
    log: &mut Log,
    mut python: Command,
    folder: &str,
    (name, options): (&str, &[&str]),
) -> Result<Tally, String> {
    let report = context.workspace.target.join("xtask").join(format!("{name}.xml"));
    workspace::remove(&report)?;
    python
        .args(["-m", "pytest", "-v", "-ra", "-p", "no:cacheprovider", "--junitxml"])
        .arg(&report)
        .args(options)
        .current_dir(context.workspace.root.join(folder))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("PYTHONUNBUFFERED", "1");
    let ended = log.run(&mut python)?;
    let xml = fs::read_to_string(&report).map_err(|e| format!("pytest left no report of {folder}: {e}"))?;
    let mut tally = junit::read(&xml)?;
    if !ended.success && tally.failures.is_empty() {
        tally.failures.push(format!("pytest failed outside of a test of {folder}"));
    }
    Ok(tally)
}
