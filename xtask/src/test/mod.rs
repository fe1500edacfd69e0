//! `cargo xtask test`: runs named runners, two beside each other once everything is built, and sums up their results.

mod abi;
mod amd;
mod archive;
mod archive_check;
mod blocks;
mod book;
mod browser;
mod cargo;
mod check;
mod context;
mod cpp;
mod csharp;
mod directml;
mod disk_space;
mod dist;
mod ffx;
mod host;
mod junit;
mod lab;
mod nightly;
mod python;
mod quality;
mod readme;
mod recorder;
mod repository;
mod runners;
mod shaders;
mod skips;
mod study;
mod study_windows;
mod tally;
mod thorough;
mod thorough_record;
mod unity;
mod unreal;
mod validation;
mod webgpu;
mod wheels;
mod windows_build;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Instant;

use crate::cli::TestOptions;
use crate::shell::Log;
use crate::workspace::Workspace;
use context::Context;
use runners::{FIRST, GROUPS, Part, Runner, THOROUGH, parts, runners};
use skips::AllowedSkips;
use tally::Tally;
use thorough_record::Record;

pub(crate) use cargo::DENY_VERSION;
pub(crate) use lab::for_windows;
pub(crate) use recorder::with_recorder;

/// What [`run`] and the threads that run its runners share.
struct Session<'a> {
    context: Context<'a>,
    /// Numbers of the runners are of these.
    chosen: Vec<&'static Runner>,
    /// The skips that are allowed; none if every skip is.
    allowed: Option<AllowedSkips>,
    /// The commit that the record of thorough parts names, if they are recorded.
    commit: Option<String>,
}

/// What a runner has found, with its log.
struct RunnerOutcome {
    /// Among the chosen ones.
    index: usize,
    name: &'static str,
    tally: Tally,
    seconds: f64,
    log: PathBuf,
}

impl Session<'_> {
    /// Runs those of `runners` that are chosen, one after the other.
    fn run<'r>(&self, runners: impl IntoIterator<Item = &'r Runner>) -> Result<Vec<RunnerOutcome>, String> {
        let chosen = runners.into_iter().filter_map(|runner| {
            let index = self.chosen.iter().position(|chosen| chosen.name == runner.name)?;
            Some(self.run_one(index))
        });
        chosen.collect()
    }

    /// Runs the runner at this index of the chosen ones.
    fn run_one(&self, index: usize) -> Result<RunnerOutcome, String> {
        let (runner, workspace) = (self.chosen[index], self.context.workspace);
        let began = Instant::now();
        let path = workspace.target.join("xtask").join(format!("{}.log", runner.name));
        let title = format!("[{}/{}] {}: {}", index + 1, self.chosen.len(), runner.name, runner.what);
        let mut log = Log::new(&path, &title)?;
        let mut tally = (runner.run)(&self.context, &mut log).unwrap_or_else(Tally::broken);
        if tally.is_empty() {
            tally = Tally::broken("it ran no test and no check");
        }
        let (seconds, is_part) = (began.elapsed().as_secs(), parts().any(|part| part.name == runner.name));
        if is_part && seconds > 60 * thorough_record::LONGEST {
            let longest = thorough_record::LONGEST;
            tally.failures.push(format!("it took {} minutes, and a part may take {longest}: split it", seconds / 60));
        }
        if let Some(allowed) = &self.allowed {
            tally.fail_skips_unless(|skip| allowed.covers(skip));
        }
        if let Some(commit) = self.commit.as_ref().filter(|_| is_part) {
            thorough_record::append(workspace, runner.name, commit, seconds, &tally)?;
        }
        for failure in &tally.failures {
            log.line(&format!("failed: {failure}"))?;
        }
        log.end(&format!("{}: {}", runner.name, tally.with_checks()));
        Ok(RunnerOutcome { index, name: runner.name, tally, seconds: began.elapsed().as_secs_f64(), log: path })
    }
}

/// Width of the column of runners' names.
const NAME_WIDTH: usize = 22;

/// Runs the runners that `options` choose; returns whether nothing failed.
pub(crate) fn run(workspace: &Workspace, options: &TestOptions) -> Result<bool, String> {
    if options.list {
        runners().for_each(|runner| println!("{:NAME_WIDTH$}{}", runner.name, runner.what));
        println!("\nWith --thorough only:");
        let record = Record::read(workspace)?;
        for part in THOROUGH {
            println!("{:NAME_WIDTH$}{} ({})", part.runner.name, part.runner.what, record.duration(part));
        }
        return Ok(true);
    }
    let all: Vec<&Runner> = runners().chain(parts().filter(|_| options.thorough)).collect();
    if let Some(filter) = options.filters.iter().find(|f| !all.iter().any(|runner| runner.name.contains(f.as_str()))) {
        let [names, thorough] = [runners().collect::<Vec<_>>(), parts().collect()]
            .map(|runners| runners.iter().map(|runner| runner.name).collect::<Vec<_>>().join(", "));
        return Err(format!("no runner's name holds {filter:?}. There are {names}; with --thorough also {thorough}"));
    }
    let commit = if options.record { Some(thorough_record::commit(workspace)?) } else { None };
    let chosen = chosen(all, &options.filters);
    if options.filters.is_empty() {
        disk_space::require(workspace)?;
    }
    let must_allow = std::env::var_os("CI").is_some_and(|value| value == "true" || value == "1");
    // A mistake in the list is reported everywhere.
    let allowed = Some(AllowedSkips::read(&workspace.read("xtask/skips.toml")?)?).filter(|_| must_allow);

    if options.filters.is_empty() {
        prefetch(workspace);
    }
    let session = Session { context: Context::new(workspace), chosen, allowed, commit };
    let mut outcomes = session.run(FIRST)?;
    let queue = Mutex::new(GROUPS.iter());
    let next_group = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let run_groups = || session.run(std::iter::from_fn(next_group).copied().flatten());
    let both = thread::scope(|scope| {
        let (one, other) = (scope.spawn(run_groups), run_groups());
        [one.join().map_err(|_| "a runner has panicked".to_owned()).flatten(), other]
    });
    for of_one in both {
        outcomes.extend(of_one?);
    }
    outcomes.sort_by_key(|outcome| outcome.index);
    outcomes.extend(session.run(parts())?);
    Ok(report(outcomes))
}

/// The runners whose names hold one of the words; of a runner's whole name, that runner alone. All, if there are no words.
fn chosen<'a>(all: Vec<&'a Runner>, words: &[String]) -> Vec<&'a Runner> {
    let is_name = |word: &String| all.iter().any(|runner| runner.name == word);
    let fits = |runner: &Runner, word: &String| match is_name(word) {
        true => runner.name == word,
        false => runner.name.contains(word.as_str()),
    };
    all.iter().filter(|runner| words.is_empty() || words.iter().any(|word| fits(runner, word))).copied().collect()
}

/// Prints failures with their logs, a table of the runners, and what was skipped; returns whether nothing failed.
fn report(outcomes: Vec<RunnerOutcome>) -> bool {
    for outcome in outcomes.iter().filter(|outcome| !outcome.tally.failures.is_empty()) {
        println!("{}", describe_failures(outcome));
    }
    println!("\n{:NAME_WIDTH$}{}{:>11}", "runner", Tally::column_heads(), "time");
    let mut skipped = String::new();
    let mut total = Tally::default();
    for RunnerOutcome { name, tally, seconds, .. } in outcomes {
        println!("{name:NAME_WIDTH$}{}{seconds:>9.1} s", tally.columns());
        for skip in &tally.skips {
            _ = writeln!(skipped, "  {name}: {} ({})", skip.name, skip.reason);
        }
        total.add(tally);
    }
    println!("{:NAME_WIDTH$}{}", "all", total.columns());
    if !skipped.is_empty() {
        println!("\nSkipped:\n{skipped}");
    }
    println!("\n{total}");
    total.failures.is_empty()
}

/// Fetches the runners' tools and packages on another thread, while the first runners compile. A runner that needs an item before it is
/// complete waits for its lock. Errors are ignored here: the runner that needs the item tries again and reports them.
fn prefetch(workspace: &Workspace) {
    let workspace = workspace.clone();
    thread::spawn(move || _ = crate::demo::provide_all(&workspace, &provision::Silent));
}

/// A failed runner's whole log, and its failures.
fn describe_failures(RunnerOutcome { name, tally, log, .. }: &RunnerOutcome) -> String {
    let output = std::fs::read_to_string(log).unwrap_or_else(|e| format!("the log is lost: {e}\n"));
    let mut text = format!("\n---- {name}: {} ----\n{output}\n", log.display());
    for failure in &tally.failures {
        _ = writeln!(text, "{name} failed: {failure}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_name_chooses_one_runner_and_a_part_all_that_hold_it() {
        let of = |word: &str| -> Vec<&str> {
            let all = runners().chain(parts()).collect();
            chosen(all, &[word.to_owned()]).iter().map(|runner| runner.name).collect()
        };
        assert_eq!(of("recorder"), ["recorder"]);
        assert_eq!(of("recorder-"), ["recorder-all", "recorder-amd"]);
        assert_eq!(of("faults-amd"), ["faults-amd"]);
    }
}
