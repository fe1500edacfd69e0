//! The command line.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Condvar, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

use clap::{Parser, Subcommand};

use crate::checks::{self, CheckDefinition, Settings};
use crate::report::{Machine, Report, SCHEMA};
use crate::runner::{PATIENCE_WITH_EMULATION, Runner, run_one};
use crate::summary::{Progress, totals};
use crate::{compare, hardware, page};

/// Exit status of a command line or a file that cannot be used.
const UNUSABLE: u8 = 2;

/// Judges this machine's graphics adapter for Cairn: what is there, whether results on it are right, and how long they take.
///
/// Without options it runs every check in at most five minutes (on an emulated adapter as with --quick), and writes report.html and
/// report.json. The exit status is 0 if all passed, 1 if one failed, and 3 if none failed but some could not tell. Nothing is installed or sent;
/// the report names adapter, drivers, processor and system, and neither users nor folders. Each check runs in a process of its own, so that a
/// driver that crashes or hangs is a line of the report.
#[derive(Debug, Parser)]
#[command(name = "cairn-check", version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Run these checks or groups only, with commas between them; `cairn-check list` has their names
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    only: Vec<String>,
    /// Folder for report.html and report.json
    #[arg(long, default_value = ".", value_name = "FOLDER")]
    out: PathBuf,
    /// Minutes after which the running check ends and no further one starts
    #[arg(long, default_value_t = 5, value_name = "MINUTES", value_parser = clap::value_parser!(u32).range(1..=600))]
    minutes: u32,
    #[command(flatten)]
    settings: Settings,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// List the checks by group, and the adapters
    List,
    /// Compare two report.json: verdicts that differ, and figures with their ratio
    Compare {
        /// The first report
        a: PathBuf,
        /// The second report
        b: PathBuf,
    },
    /// Make the page of published reports, and refuse files that may not be published
    Hardware {
        /// Folder of the reports
        folder: PathBuf,
        /// File for the page, in Markdown; without it the page is printed
        #[arg(long, value_name = "FILE")]
        page: Option<PathBuf>,
    },
    /// Run a check in this process
    #[command(hide = true)]
    RunOne {
        /// Its name
        name: String,
        /// File for its finding
        #[arg(long)]
        result: PathBuf,
        #[command(flatten)]
        settings: Settings,
    },
    /// Describe the machine
    #[command(hide = true)]
    Describe {
        /// File for the description
        #[arg(long)]
        result: PathBuf,
        #[command(flatten)]
        settings: Settings,
    },
}

/// Runs the program with these arguments, the first of which is its own name.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    run_as(arguments, &[])
}

/// As [`run`]; the processes of checks are this program with `prefix` before their arguments.
pub fn run_as(arguments: impl IntoIterator<Item = OsString>, prefix: &[OsString]) -> ExitCode {
    let arguments = Arguments::parse_from(arguments);
    let ended = match arguments.command {
        None => check(&arguments, prefix),
        Some(Command::List) => {
            list();
            Ok(0)
        }
        Some(Command::Compare { a, b }) => compare_files(&a, &b),
        Some(Command::Hardware { folder, page }) => publish(&folder, page.as_deref()),
        Some(Command::RunOne { name, result, settings }) => match checks::ALL.iter().find(|check| check.name == name) {
            Some(check) => run_one(check, &settings, &result).map(|()| 0),
            None => Err(format!("there is no check {name}; cairn-check list has their names")),
        },
        Some(Command::Describe { result, settings }) => {
            let text = serde_json::to_string(&checks::machine::describe(&settings)).map_err(|e| e.to_string());
            text.and_then(|text| std::fs::write(&result, text).map_err(|e| e.to_string())).map(|()| 0)
        }
    };
    match ended {
        Ok(status) => ExitCode::from(status),
        Err(why) => {
            eprintln!("cairn-check: {why}");
            ExitCode::from(UNUSABLE)
        }
    }
}

/// The checks that `names` choose: all if there are none.
fn chosen(names: &[String]) -> Result<Vec<&'static CheckDefinition>, String> {
    let fits = |check: &CheckDefinition, name: &String| check.name == name || check.group.name() == name;
    if let Some(unknown) = names.iter().find(|name| !checks::ALL.iter().any(|check| fits(check, name))) {
        return Err(format!("there is no check or group {unknown}; cairn-check list has their names"));
    }
    let is_chosen = |check: &&CheckDefinition| names.is_empty() || names.iter().any(|name| fits(check, name));
    Ok(checks::ALL.iter().filter(is_chosen).collect())
}

fn check(arguments: &Arguments, prefix: &[OsString]) -> Result<u8, String> {
    let chosen = chosen(&arguments.only)?;
    let start = Instant::now();
    let out = &arguments.out;
    let unusable = |e: std::io::Error| format!("{}: {e}; choose another with --out", out.display());
    std::fs::create_dir_all(out).map_err(unusable)?;
    let shared = tempfile::Builder::new().prefix("cairn-check-").tempdir_in(out).map_err(unusable)?;
    let mut runner = Runner {
        program: std::env::current_exe().map_err(|e| format!("this program's own file: {e}"))?,
        arguments: prefix.to_vec(),
        settings: arguments.settings.clone(),
        deadline: start + Duration::from_secs(60 * u64::from(arguments.minutes)),
        patience: 1,
        folder: shared.path().to_owned(),
    };
    let machine = runner.describe();
    if machine.emulated {
        runner.patience = PATIENCE_WITH_EMULATION;
        runner.settings.quick = true;
        runner.settings.starting_state = Some(shared.path().join("starting-state"));
    }
    let at_once = checks_at_once(&machine);
    let mut report = Report {
        schema: SCHEMA,
        cairn: env!("CARGO_PKG_VERSION").to_owned(),
        optimised: !cfg!(debug_assertions),
        quick: runner.settings.quick,
        seconds: 0.0,
        verdict: Report::worst(&[]),
        machine,
        checks: Vec::new(),
    };
    let progress = Progress::new(chosen.len());
    let (queue, lines) = (CheckQueue::new(&chosen, at_once), mpsc::channel());
    std::thread::scope(|scope| -> Result<(), String> {
        for _ in 0..at_once {
            let (to, runner, queue, progress) = (lines.0.clone(), &runner, &queue, &progress);
            scope.spawn(move || {
                while let Some(check) = queue.next() {
                    progress.start(check);
                    let line = runner.run(check);
                    queue.ended(check);
                    if to.send(line).is_err() {
                        break;
                    }
                }
            });
        }
        drop(lines.0);
        for line in lines.1 {
            progress.done(&line);
            report.checks.push(line);
            report.checks.sort_by_key(|line| chosen.iter().position(|check| check.name == line.name));
            report.verdict = Report::worst(&report.checks);
            report.seconds = start.elapsed().as_secs_f64();
            // Written after each check: the user may end the program before the last.
            write(&report, out)?;
        }
        Ok(())
    })?;
    progress.finish();
    println!("\n{}", totals(&report));
    println!("{} and report.json beside it", out.join("report.html").display());
    Ok(report.verdict.exit_status())
}

/// Number of checks that run at a time: one, so that none disturbs another's times; two where a processor emulates the adapter, since times
/// show nothing there.
fn checks_at_once(machine: &Machine) -> usize {
    if machine.emulated && machine.threads > 1 { 2 } else { 1 }
}

/// Checks that have not started: in their order where one runs at a time. Of two that run at a time only one may load a world, for which memory
/// could be too small; since those take the most time, they start first.
struct CheckQueue {
    state: Mutex<QueueState>,
    changed: Condvar,
}

struct QueueState {
    remaining: Vec<&'static CheckDefinition>,
    has_world: bool,
}

impl QueueState {
    /// Takes the first check that may start.
    fn take(&mut self) -> Option<&'static CheckDefinition> {
        let may_start = |check: &&CheckDefinition| !(self.has_world && check.has_world());
        let at = self.remaining.iter().position(may_start)?;
        let check = self.remaining.remove(at);
        self.has_world |= check.has_world();
        Some(check)
    }
}

impl CheckQueue {
    fn new(checks: &[&'static CheckDefinition], at_once: usize) -> Self {
        let mut remaining = checks.to_vec();
        if at_once > 1 {
            remaining.sort_by_key(|check| !check.has_world());
        }
        let state = QueueState { remaining, has_world: false };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// The next check that may start, after a wait if there is none yet; `None` if all have started.
    fn next(&self) -> Option<&'static CheckDefinition> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some(check) = state.take() {
                return Some(check);
            }
            if state.remaining.is_empty() {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// A check has ended.
    fn ended(&self, check: &CheckDefinition) {
        if check.has_world() {
            self.state.lock().unwrap_or_else(PoisonError::into_inner).has_world = false;
            self.changed.notify_all();
        }
    }
}

fn write(report: &Report, folder: &Path) -> Result<(), String> {
    for (name, text) in [("report.json", report.to_json()?), ("report.html", page::html(report))] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|e| format!("{}: {e}; choose another with --out", path.display()))?;
    }
    Ok(())
}

fn list() {
    for group in checks::Group::ALL {
        println!("{}: {}", group.name(), group.title());
        for check in checks::ALL.iter().filter(|check| check.group == group) {
            println!("  {:18} {}", check.name, check.title);
        }
    }
    println!("\nAdapters, for --adapter:");
    let adapters = checks::machine::adapters();
    for (index, adapter) in adapters.iter().enumerate() {
        println!("  {index}  {}", adapter.name);
    }
    if adapters.is_empty() {
        println!("  none with Direct3D 12");
    }
}

fn compare_files(a: &Path, b: &Path) -> Result<u8, String> {
    let read = |path: &Path| {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        Report::from_json(&text).map_err(|e| format!("{}: {e}", path.display()))
    };
    let (a, b) = (read(a)?, read(b)?);
    print!("{}", compare::text(&a, &b));
    Ok(0)
}

/// Writes or prints the page of a folder's reports.
fn publish(folder: &Path, page: Option<&Path>) -> Result<u8, String> {
    let text = hardware::page(&hardware::read(folder)?);
    match page {
        Some(path) => {
            std::fs::write(path, text).map_err(|e| format!("{}: {e}; choose another with --page", path.display()))?;
        }
        None => print!("{text}"),
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn checks_are_chosen_by_name_and_by_group() {
        let count = |names: &[&str]| {
            chosen(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>()).map(|all| all.len())
        };
        assert_eq!(count(&[]), Ok(checks::ALL.len()));
        assert_eq!(count(&["adapters"]), Ok(1));
        assert!(count(&["there"]).is_ok_and(|found| found > 1));
        assert!(count(&["adapters", "nothing"]).is_err_and(|why| why.contains("no check or group nothing")));
    }

    #[test]
    fn one_world_is_loaded_at_a_time_and_other_checks_run_beside_it() {
        let chosen = chosen(&["frames", "directml", "states"].map(str::to_owned)).expect("checks");
        let name = |check: Option<&CheckDefinition>| check.map(|check| check.name);
        assert_eq!(name(CheckQueue::new(&chosen, 1).next()), Some("frames"));
        let queue = CheckQueue::new(&chosen, 2);
        let first = queue.next().expect("a check");
        assert_eq!(first.name, "directml");
        assert_eq!(name(queue.next()), Some("frames"));
        assert!(queue.state.lock().expect("no panic").take().is_none());
        queue.ended(first);
        assert_eq!((name(queue.next()), name(queue.next())), (Some("states"), None));
    }

    #[test]
    fn names_differ_and_groups_are_no_names_of_checks() {
        for (i, check) in checks::ALL.iter().enumerate() {
            assert!(checks::ALL[..i].iter().all(|other| other.name != check.name), "{}", check.name);
            assert!(checks::Group::ALL.iter().all(|group| group.name() != check.name), "{}", check.name);
        }
    }
}
