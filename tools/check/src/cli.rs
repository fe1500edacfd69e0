//! The command line.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::checks::{CHECKS, Check};
use crate::settings::Settings;
use crate::{child, compare, report::Report, run};

const EXIT_STATUS: &str = "\
Exit status: 0 if every line passes, 1 if one fails, 2 if none fails but one cannot be told.
Run it on mains power, with no other program that uses the GPU.";

/// Judges this machine for Cairn: what is there, whether results are right, how long they take
///
/// Takes at most five minutes, installs nothing and changes nothing. Writes report.html and report.json, without names of the user or
/// the machine.
#[derive(Parser)]
#[command(name = "cairn-check", version, after_help = EXIT_STATUS, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Job>,
    #[command(flatten)]
    run: RunArguments,
}

#[derive(Args)]
struct RunArguments {
    /// Folder for report.html and report.json; made if it is not there
    #[arg(long, value_name = "FOLDER", default_value = "cairn-check-report")]
    out: PathBuf,
    /// Only these checks or groups, separated by commas; --list names them
    #[arg(long, value_name = "IDS", value_delimiter = ',')]
    only: Vec<String>,
    /// Prints the checks and ends
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    settings: SettingsArguments,
}

#[derive(Args)]
struct SettingsArguments {
    /// Small pictures and few repetitions: shows that everything runs; its figures say nothing
    #[arg(long)]
    short: bool,
    /// Index of the adapter, as the line `adapters` lists them; the first that is not a software adapter if left out
    #[arg(long, value_name = "INDEX")]
    adapter: Option<usize>,
}

impl SettingsArguments {
    fn settings(&self) -> Settings {
        Settings { short: self.short, adapter: self.adapter }
    }
}

#[derive(Subcommand)]
enum Job {
    /// Compares two reports: verdicts, facts and figures that differ
    ///
    /// Exit status: 0 if B is nowhere worse, 1 if it is, 2 if they have no line in common or one cannot be read.
    Compare {
        /// report.json of the earlier run
        a: PathBuf,
        /// report.json of the later run
        b: PathBuf,
        /// Difference of a figure that counts, in percent
        #[arg(long, value_name = "PERCENT", default_value_t = 10.0)]
        tolerance: f64,
    },
    /// Runs one check in this process and prints its result for the process that started it
    #[command(hide = true)]
    RunCheck {
        id: String,
        #[command(flatten)]
        settings: SettingsArguments,
    },
}

/// Exit status for arguments that cannot be used: nothing was told.
const CANNOT_TELL: u8 = 2;

pub(crate) fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let ended = match arguments.command {
        Some(Job::Compare { a, b, tolerance }) => compare_files(&a, &b, tolerance),
        Some(Job::RunCheck { id, settings }) => run_check(&id, &settings.settings()),
        None => judge(&arguments.run),
    };
    match ended {
        Ok(status) => ExitCode::from(status),
        Err(why) => {
            eprintln!("cairn-check: {why}");
            ExitCode::from(CANNOT_TELL)
        }
    }
}

fn judge(arguments: &RunArguments) -> Result<u8, String> {
    let chosen = choose(&arguments.only)?;
    if arguments.list {
        for check in chosen {
            println!("{:12} {:22} {}", check.group.id(), check.id, check.title);
        }
        return Ok(0);
    }
    let report = run::run(&chosen, &arguments.settings.settings(), &arguments.out)?;
    Ok(report.verdict.exit_status())
}

/// The checks of these ids and groups, in the usual order; all if none are given.
fn choose(only: &[String]) -> Result<Vec<&'static Check>, String> {
    let fits = |check: &Check, name: &str| check.id == name || check.group.id() == name;
    if let Some(unknown) = only.iter().find(|name| !CHECKS.iter().any(|check| fits(check, name))) {
        return Err(format!("--only: no check or group is named {unknown}. Use names that --list prints"));
    }
    Ok(CHECKS.iter().filter(|check| only.is_empty() || only.iter().any(|name| fits(check, name))).collect())
}

fn run_check(id: &str, settings: &Settings) -> Result<u8, String> {
    let check = CHECKS.iter().find(|check| check.id == id).ok_or_else(|| format!("no check is named {id}"))?;
    child::print_result(&check.judge(settings));
    Ok(0)
}

fn compare_files(a: &std::path::Path, b: &std::path::Path, tolerance: f64) -> Result<u8, String> {
    if !(0.0..=1000.0).contains(&tolerance) {
        return Err(format!("--tolerance: {tolerance} is no percentage. Use a number from 0 to 1000"));
    }
    let compared = compare::compare(&Report::read(a)?, &Report::read(b)?, tolerance / 100.0);
    print!("{}", compared.text);
    Ok(compared.verdict.exit_status())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn checks_are_chosen_by_name_and_by_group() {
        let names = |only: &[&str]| {
            let only: Vec<String> = only.iter().map(|name| (*name).to_owned()).collect();
            choose(&only).map(|all| all.iter().map(|check| check.id).collect::<Vec<_>>())
        };
        assert_eq!(names(&[]).map(|all| all.len()), Ok(CHECKS.len()));
        assert_eq!(names(&["cpu-generator"]), Ok(vec!["cpu-generator"]));
        let there = names(&["there"]).expect("a group");
        assert!(there.contains(&"adapters") && !there.contains(&"cpu-generator"), "{there:?}");
        assert!(names(&["nothing"]).is_err_and(|e| e.contains("nothing") && e.contains("--list")));
    }

    #[test]
    fn ids_are_unique() {
        let mut ids: Vec<_> = CHECKS.iter().map(|check| check.id).collect();
        ids.sort_unstable();
        let count = ids.len();
        ids.dedup();
        assert_eq!(ids.len(), count);
    }
}
