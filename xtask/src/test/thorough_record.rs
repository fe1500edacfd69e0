//! When each part of the thorough tests last ran: `xtask/thorough.toml`, which `--record` appends to, and the page that is made from it.

use std::fmt::Write as _;
use std::fs;
use std::process::Command;

use jiff::Timestamp;
use serde::Deserialize;

use super::tally::Tally;
use super::{Part, THOROUGH};
use crate::shell::output;
use crate::workspace::Workspace;

/// The record.
pub(super) const RECORD: &str = "xtask/thorough.toml";
/// The page.
pub(super) const PAGE: &str = "docs/thorough.md";
/// No part may take longer, in minutes.
pub(super) const LONGEST: u64 = 60;

/// All recorded runs, oldest first.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    #[serde(default, rename = "run")]
    runs: Vec<Run>,
}

/// One run of a part.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Run {
    part: String,
    /// Day of the run, in UTC.
    date: String,
    /// The tested commit.
    commit: String,
    seconds: u64,
    /// The counts, as the last line of a run shows them.
    result: String,
    passed: bool,
}

impl Record {
    pub(super) fn read(workspace: &Workspace) -> Result<Self, String> {
        Self::parse(&workspace.read(RECORD)?)
    }

    fn parse(text: &str) -> Result<Self, String> {
        let record: Self = toml::from_str(text).map_err(|e| format!("{RECORD}: {e}"))?;
        // The part may have been renamed or removed since: only what is written by the command has these forms.
        match record.runs.iter().find(|run| run.date.len() != 10 || run.commit.is_empty() || run.part.is_empty()) {
            Some(run) => {
                Err(format!("{RECORD}: the run of \"{}\" at {} is not one that a command wrote", run.part, run.date))
            }
            None => Ok(record),
        }
    }

    fn last<'a>(&'a self, part: &str, counts: impl Fn(&Run) -> bool + 'a) -> Option<&'a Run> {
        let part = part.to_owned();
        self.runs.iter().rev().find(move |run| run.part == part && counts(run))
    }

    /// Expected duration of a part: that of its last passed run, or the estimate.
    pub(super) fn duration(&self, part: &Part) -> String {
        match self.last(part.runner.name, |run| run.passed) {
            Some(run) => format!("{} min", run.seconds.div_ceil(60)),
            None => format!("about {} min, not yet recorded", part.minutes),
        }
    }

    /// The page.
    fn page(&self) -> String {
        let mut text = format!(
            "# The thorough tests\n\n\
             `cargo xtask test` runs on every change. These parts take longer, {LONGEST} minutes at most each, and are run one by one before a release:\n\n\
             ```sh\ncargo xtask test --list\ncargo xtask test --thorough --record soak-frames\n```\n\n\
             `--record` appends the result to `{RECORD}` and writes this page.\n\n\
             | part | what | last passed | commit | took | last result |\n|---|---|---|---|--:|---|\n"
        );
        for Part { runner, .. } in THOROUGH {
            _ = write!(text, "| `{}` | {} |", runner.name, runner.what);
            match self.last(runner.name, |run| run.passed) {
                Some(run) => {
                    _ = write!(text, " {} | `{}` | {} min |", run.date, run.commit, run.seconds.div_ceil(60));
                }
                None => text += " not yet recorded | | |",
            }
            match self.last(runner.name, |_| true) {
                Some(run) => _ = writeln!(text, " {} at `{}`: {} |", run.date, run.commit, run.result),
                None => text += " |\n",
            }
        }
        text
    }
}

impl Run {
    /// As a table of the record. No value has quotation marks.
    fn text(&self) -> String {
        let Self { part, date, commit, seconds, result, passed } = self;
        format!(
            "\n[[run]]\npart = \"{part}\"\ndate = \"{date}\"\ncommit = \"{commit}\"\nseconds = {seconds}\n\
             result = \"{result}\"\npassed = {passed}\n"
        )
    }
}

/// The commit that a record names.
///
/// Fails if tracked files differ from it, except the record and its page.
pub(super) fn commit(workspace: &Workspace) -> Result<String, String> {
    let git = |arguments: &[&str]| output(Command::new("git").args(arguments).current_dir(&workspace.root));
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    let differs = |line: &&str| ![RECORD, PAGE].iter().any(|own| line.ends_with(own));
    match changed.lines().find(differs) {
        Some(line) => Err(format!("a record names a commit, and {} is in none: commit it first", line.trim())),
        None => Ok(git(&["rev-parse", "--short=7", "HEAD"])?.trim().to_owned()),
    }
}

/// Appends a part's result to the record, and writes the page.
pub(super) fn append(
    workspace: &Workspace,
    part: &str,
    commit: &str,
    seconds: u64,
    tally: &Tally,
) -> Result<(), String> {
    let run = Run {
        part: part.to_owned(),
        date: Timestamp::now().strftime("%Y-%m-%d").to_string(),
        commit: commit.to_owned(),
        seconds,
        result: tally.with_checks(),
        // A part of which everything was skipped has shown nothing.
        passed: tally.failures.is_empty() && tally.passed + tally.checks > 0,
    };
    let text = workspace.read(RECORD)? + &run.text();
    let write = |name: &str, text: &str| fs::write(workspace.root.join(name), text).map_err(|e| format!("{name}: {e}"));
    let record = Record::parse(&text)?;
    write(RECORD, &text)?;
    write(PAGE, &record.page())
}

/// The failure if the page is not what the record says.
pub(super) fn page_differs(workspace: &Workspace) -> Result<Option<String>, String> {
    let differs = workspace.read(PAGE)? != Record::read(workspace)?.page();
    Ok(differs
        .then(|| format!("{PAGE} is not what {RECORD} says; `cargo xtask test --thorough --record PART` writes both")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(part: &str, date: &str, passed: bool) -> Run {
        Run {
            part: part.into(),
            date: date.into(),
            commit: format!("c{}", date.replace('-', "")),
            seconds: 61,
            result: if passed {
                "2 passed, 0 failed, 0 skipped, 0 checks"
            } else {
                "1 passed, 1 failed, 0 skipped, 0 checks"
            }
            .into(),
            passed,
        }
    }

    #[test]
    fn the_page_shows_the_last_pass_and_the_last_result_of_every_part() {
        let name = THOROUGH[0].runner.name;
        let runs = [run(name, "2026-01-02", true), run(name, "2026-01-03", true), run(name, "2026-01-04", false)];
        let text: String = runs.iter().map(Run::text).collect();
        let record = Record::parse(&text).unwrap();
        let page = record.page();
        let line = page.lines().find(|line| line.starts_with(&format!("| `{name}` |"))).unwrap();
        assert!(
            line.contains("| 2026-01-03 | `c20260103` | 2 min | 2026-01-04 at `c20260104`: 1 passed, 1 failed"),
            "{line}"
        );
        assert_eq!(page.matches("not yet recorded").count(), THOROUGH.len() - 1);
        assert_eq!(record.duration(&THOROUGH[0]), "2 min");
        assert!(record.duration(&THOROUGH[1]).ends_with("not yet recorded"));
        assert!(THOROUGH.iter().all(|part| u64::from(part.minutes) <= LONGEST));
    }

    #[test]
    fn a_record_that_no_command_wrote_is_refused() {
        assert!(Record::parse("").is_ok());
        assert!(Record::parse(&run("soak", "yesterday", true).text()).is_err());
        assert!(Record::parse(&run("soak", "2026-01-02", true).text().replace("seconds = 61\n", "")).is_err());
    }
}
