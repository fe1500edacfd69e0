//! The recorder of Direct3D 12 calls: test programs run with `tests/d3d12-recorder` beside them as their `d3d12.dll`, and each broken rule of
//! Direct3D is a failure unless a test breaks it on purpose. The program `recorder` shows that the recorder finds each rule, and mutants of the
//! library's calls.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

use super::amd::Amd;
use super::tally::{Skip, Tally};
use super::validation::messages::{Message, separate};
use super::{Context, study_windows, windows_build};
use crate::counts::{self, Counts};
use crate::shell::{CommandOutput, Log};
use crate::workspace;

/// Broken rules that are no faults.
const LIST: &str = "xtask/recorder.toml";

/// Programs of every run, which the runner `lab` leaves to this one: those whose tests load no world.
const SHORT: [&str; 6] =
    ["d3d12", "d3d12_flow", "d3d12_generator", "d3d12_prepare", "d3d12_presenter", "d3d12_shaders"];

/// Another one, one of whose tests loads a world.
const SHORT_WORLDS: [&str; 1] = ["d3d12_drawer"];

/// The recorder's own program, and parts of the names of its tests that load worlds: the counts of a latent step run each time, failing calls
/// with `--thorough`.
const OWN: [&str; 1] = ["recorder"];
const OWN_WORLDS: [&str; 2] = [FAULTS_WORLDS, COUNTS];
const COUNTS: &str = "counts::";

/// All programs of every run.
pub(super) fn short() -> impl Iterator<Item = &'static str> {
    SHORT.into_iter().chain(SHORT_WORLDS).chain(OWN)
}

/// More programs. `host`, Unity's test double, always runs with the recorder: in the runners `lab` and `ffx`.
pub(super) const LONG: [&str; 7] = [
    "d3d12_interface",
    "d3d12_libraries",
    "d3d12_lifecycle",
    "d3d12_memory",
    "d3d12_residency",
    "d3d12_validation",
    "directml",
];

/// Programs of every run with test doubles of AMD's libraries, which they bring themselves.
const SHORT_AMD: [&str; 2] = ["ffx_interface", "ffx_upscale"];

/// More of these.
const LONG_AMD: [&str; 6] =
    ["ffx", "ffx_frames", "ffx_mutants", "ffx_presenter", "ffx_swapchain", "ffx_swapchain_interface"];

/// The study's comparison, as findings name it.
const COMPARISON: &str = "study compare";

/// Makes Windows load a `d3d12.dll` that is beside a program, and Wine's own by its whole path.
const OVERRIDES: &str = "mscoree,mshtml=;d3d12=n,b";

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    // That of an earlier run.
    workspace::remove(&counts_file(context))?;
    let mut tally = run_programs(
        context,
        &[
            (&OWN, |context, command| {
                windows_build::copy_descriptors(command.args(OWN_WORLDS.iter().flat_map(|name| ["--skip", name])));
                context.provide_windows_worlds(command)
            }),
            (&OWN, |context, command| {
                command.arg(COUNTS).env(counts::FILE_VARIABLE, counts_file(context));
                context.provide_windows_worlds(command)
            }),
            (&SHORT_WORLDS, |context, command| context.provide_windows_worlds(command)),
            (&SHORT, |context, command| {
                windows_build::copy_descriptors(command);
                context.provide_windows_worlds(command)
            }),
            (&SHORT_AMD, provide_amd),
        ],
        log,
    )?;
    if tally.skips.is_empty() {
        compare_counts(context, log, &mut tally)?;
    }
    Ok(tally)
}

/// Programs with doubles of AMD's libraries load no world.
fn provide_amd(context: &Context<'_>, command: &mut Command) -> Result<(), String> {
    windows_build::copy_descriptors(command);
    context.provide_windows_tools(command)
}

/// Where the program `recorder` writes the counts of a latent step.
fn counts_file(context: &Context<'_>) -> PathBuf {
    context.workspace.target.join("xtask").join("counts.json")
}

/// Compares the counts of a latent step with the record.
fn compare_counts(context: &Context<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let recorded = Counts::read(context.workspace)?;
    let differences = match counts::from_run(context.workspace, &counts_file(context), context.python()?, log) {
        Ok(counted) => Counts::differences(&recorded, &counted),
        Err(why) => vec![why],
    };
    tally.test((!differences.is_empty()).then(|| format!("what a latent step runs: {}", differences.join("; "))));
    Ok(())
}

/// The programs that the short form leaves out.
pub(super) fn run_all(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_programs(context, &[(&LONG, |context, command| context.provide_windows_worlds(command))], log)
}

/// Programs with doubles of AMD's libraries that the short form leaves out, and the study's comparison.
pub(super) fn run_amd_and_study(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = run_programs(context, &[(&LONG_AMD, provide_amd)], log)?;
    if tally.skips.is_empty() {
        run_comparison(context, log, &mut tally)?;
    }
    Ok(tally)
}

/// Names of the tests in which calls fail, by what a host does meanwhile, and which calls fail.
const FAULTS_FRAMES: &str = "faults::frames::";
const FAULTS_AMD: &str = "faults::amd::";
const FAULTS_AMD_SWAPCHAIN: &str = "faults::amd_swapchain::";
const FAULTS_WORLDS: &str = "faults::worlds::";
/// Tests that end the process over AMD's own libraries, which read a null pointer where one of some calls to Direct3D fails, with the reason.
const AMDS_CRASHES: [(&str, &str); 2] = [
    (
        "faults::amd_swapchain::the_device_may_be_removed_at_each_call_to_direct3d",
        "AMD's own swap chain reads a null pointer where Direct3D fails (docs/fsr.md)",
    ),
    (
        "faults::amd::each_call_to_direct3d_beneath_may_fail_once",
        "AMD's own frame generation reads a null pointer where some calls to Direct3D fail once (docs/fsr.md)",
    ),
];
const EVERY_FAILURE: &str = "CAIRN_EVERY_FAILURE";

/// Every call to Direct3D fails while a host makes a device and frames.
pub(super) fn run_faults_frames(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_faults(context, log, FAULTS_FRAMES, "1", &Amd::None)
}

/// Every call of AMD's libraries, and to Direct3D beneath them, fails.
pub(super) fn run_faults_amd(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_faults_over_amd(context, log, FAULTS_AMD)
}

/// Every call of AMD's swap chain, and to Direct3D beneath it, fails.
pub(super) fn run_faults_amd_swapchain(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_faults_over_amd(context, log, FAULTS_AMD_SWAPCHAIN)
}

/// Over doubles, and where this machine has AMD's own libraries, over these.
fn run_faults_over_amd(context: &Context<'_>, log: &mut Log, tests: &str) -> Result<Tally, String> {
    let mut tally = Tally::default();
    context.with_and_without_amd(&mut tally, |amd| run_faults(context, log, tests, "1", amd))?;
    Ok(tally)
}

/// A call of each place in the program fails while a host loads a world on DirectML and rolls it out.
pub(super) fn run_faults_worlds(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_faults(context, log, FAULTS_WORLDS, "places", &Amd::None)
}

/// Runs tests of the program `recorder` in which all or most calls fail.
fn run_faults(context: &Context<'_>, log: &mut Log, tests: &str, which: &str, amd: &Amd) -> Result<Tally, String> {
    if let Err(why) = provision::lab::possible() {
        let skip = Skip { name: "every failing call on the device".to_owned(), reason: format!("needs lab: {why}") };
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    let known = KnownFindings::parse(&context.workspace.read(LIST)?)?;
    let mut run = |arguments: &[&str]| {
        let mut command = context.windows_tests(["recorder"], log)?;
        command.args(["--", "--test-threads=1", "--nocapture"]).args(arguments);
        context.provide_windows_worlds(&mut command)?;
        amd.provide(&mut command);
        // Over AMD's own, in particular: with real descriptors, one of its calls on a removed device takes 23 GB of the lab's device memory.
        if tests != FAULTS_WORLDS {
            windows_build::copy_descriptors(&mut command);
        }
        command.env(EVERY_FAILURE, which);
        with_recorder(&context.windows_programs(), &mut command, |command| log.run(command))
    };
    let CommandOutput { success, output } = match amd {
        Amd::Own(_) => {
            // In a process each: what AMD's libraries lose stays until the process ends.
            let listed = run(&["--list", tests])?.output;
            let names = listed.lines().filter_map(|line| line.strip_suffix(": test"));
            let mut all = CommandOutput { success: true, output: String::new() };
            for name in names.filter(|name| AMDS_CRASHES.iter().all(|(test, _)| test != name)) {
                let ended = run(&["--exact", name])?;
                all.success &= ended.success;
                all.output += &ended.output;
            }
            all
        }
        _ => run(&[tests])?,
    };
    let (output, mut messages) = separate(&output)?;
    let mut tally = windows_build::judge(&CommandOutput { success, output }, &[tests]);
    remove_amds(&mut messages, amd);
    if let Amd::Own(_) = amd {
        // What AMD's library loses when it throws keeps the device. The tests count its references where nothing fails.
        messages.retain(|message| message.id != "D3D12_MESSAGE_ID_LIVE_DEVICE");
        let skips = AMDS_CRASHES.iter().filter(|(test, _)| test.starts_with(tests));
        tally.skips.extend(skips.map(|(test, reason)| Skip { name: (*test).to_owned(), reason: (*reason).to_owned() }));
    }
    tally.failures.extend(known.others(&messages));
    Ok(tally)
}

/// Rules that AMD's own swap chain breaks only if the host's callback for generation has failed.
const AFTER_FAILED_CALLBACKS: [&str; 2] =
    ["D3D12_MESSAGE_ID_COMMAND_ALLOCATOR_CANNOT_RESET", "D3D12_MESSAGE_ID_COMMAND_ALLOCATOR_RESET"];

/// Removes the rules that AMD's own library breaks with objects of its own: it leaves textures in states that its next call does not expect and
/// descriptors unwritten, and loses what it had created when it throws. The host's textures are in states that Cairn states.
fn remove_amds(messages: &mut Vec<Message>, amd: &Amd) {
    if let Amd::Own(_) = amd {
        let is_amds = |message: &Message| message.text.contains(" by amd_fidelityfx_framegeneration_dx12.dll ");
        messages.retain(|message| !is_amds(message) || AFTER_FAILED_CALLBACKS.contains(&&*message.id));
    }
}

/// Gives a command its variables.
type Provide = for<'a, 'b, 'c> fn(&'a Context<'b>, &'c mut Command) -> Result<(), String>;

/// Names of test programs, and what gives their command its variables.
type Programs<'a> = (&'a [&'a str], Provide);

fn run_programs(context: &Context<'_>, groups: &[Programs<'_>], log: &mut Log) -> Result<Tally, String> {
    if let Err(why) = provision::lab::possible() {
        let skip = Skip { name: "Direct3D 12 through the recorder".to_owned(), reason: format!("needs lab: {why}") };
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    let mut tally = Tally::default();
    for (programs, provide) in groups {
        let mut command = context.windows_tests(programs.iter().copied(), log)?;
        command.arg("--");
        provide(context, &mut command)?;
        Amd::None.provide(&mut command);
        tally.add(run_tests(context, log, &mut command, programs, &Amd::None)?);
    }
    Ok(tally)
}

/// Runs a command of cargo, which ends in arguments of test programs, with the recorder. Each broken rule that is not in the list is a
/// failure, and each entry for these programs that is not needed.
pub(super) fn run_tests(
    context: &Context<'_>,
    log: &mut Log,
    command: &mut Command,
    programs: &[&str],
    amd: &Amd,
) -> Result<Tally, String> {
    let known = KnownFindings::parse(&context.workspace.read(LIST)?)?;
    // One test at a time, so that a finding follows the name of its test.
    command.arg("--test-threads=1");
    let CommandOutput { success, output } =
        with_recorder(&context.windows_programs(), command, |command| log.run(command))?;
    let (output, mut messages) = separate(&output)?;
    remove_amds(&mut messages, amd);
    let mut tally = windows_build::judge(&CommandOutput { success, output }, &[]);
    tally.failures.extend(known.others(&messages));
    tally.failures.extend(known.missing(&messages, programs));
    Ok(tally)
}

/// The study's comparison on DirectML: its program makes the worlds' frames and those between them. The study's own tests start it as a
/// process whose output they keep.
fn run_comparison(context: &Context<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let mut command = study_windows::comparison_by_shaders(context, "study-recorder")?;
    let (ended, failures, count) =
        run_program(context, log, &mut command, &context.windows_programs(), COMPARISON, &Amd::None)?;
    tally.test((!ended.success).then(|| "the study's comparison fails with the recorder".to_owned()));
    // DirectML's own calls are in the list, so that their absence shows that nothing was recorded.
    tally.test((count == 0).then(|| "the recorder was not loaded by the study's program".to_owned()));
    tally.failures.extend(failures);
    Ok(())
}

/// Runs a program that is no test program, and is in `folder`, with the recorder. Returns its output, a line for each group of broken rules
/// that are not in the list, and the number of all broken rules. Entries of the list name it `name`.
pub(super) fn run_program(
    context: &Context<'_>,
    log: &mut Log,
    command: &mut Command,
    folder: &Path,
    name: &str,
    amd: &Amd,
) -> Result<(CommandOutput, Vec<String>, usize), String> {
    let known = KnownFindings::parse(&context.workspace.read(LIST)?)?;
    command.env("WINEDLLOVERRIDES", OVERRIDES);
    let CommandOutput { success, output } =
        beside(&context.windows_programs().join("d3d12_recorder.dll"), folder, || log.run(command))?;
    let (output, mut messages) = separate(&output)?;
    remove_amds(&mut messages, amd);
    messages.iter_mut().for_each(|message| name.clone_into(&mut message.test));
    Ok((CommandOutput { success, output }, known.others(&messages), messages.len()))
}

/// Runs a command of cargo that runs test programs, with the recorder in cargo's folder of programs for Windows.
pub(crate) fn with_recorder<T>(
    built: &Path,
    command: &mut Command,
    run: impl FnOnce(&mut Command) -> Result<T, String>,
) -> Result<T, String> {
    command.env("WINEDLLOVERRIDES", OVERRIDES);
    beside(&built.join("d3d12_recorder.dll"), &built.join("deps"), || run(command))
}

/// Runs something while the recorder is in a folder as `d3d12.dll`.
fn beside<T>(recorder: &Path, folder: &Path, run: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let library = folder.join("d3d12.dll");
    // A new file each time: a program that another run has started keeps the one that it has loaded.
    _ = fs::remove_file(&library);
    fs::copy(recorder, &library).map_err(|e| format!("{}: {e}", recorder.display()))?;
    let ran = run();
    _ = fs::remove_file(&library);
    ran
}

/// Broken rules that are no faults of the library.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownFindings {
    #[serde(default, rename = "finding")]
    entries: Vec<Entry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    id: String,
    /// A part of the text.
    #[serde(default)]
    text: String,
    /// Program and test that break the rule.
    shown_by: String,
    /// Whether other tests may break it as well.
    #[serde(default)]
    everywhere: bool,
    reason: String,
}

impl KnownFindings {
    fn parse(text: &str) -> Result<Self, String> {
        let list: Self = toml::from_str(text).map_err(|e| format!("{LIST}: {e}"))?;
        let is_empty = |text: &String| text.trim().is_empty();
        match list.entries.iter().find(|entry| [&entry.id, &entry.shown_by, &entry.reason].into_iter().any(is_empty)) {
            Some(entry) => Err(format!("{LIST}: the entry \"{}\" needs an id, a test and a reason", entry.id)),
            None => Ok(list),
        }
    }

    /// One line per test, rule and function of findings that are not in the list, with the first text.
    fn others(&self, messages: &[Message]) -> Vec<String> {
        let mut groups: Vec<(&Message, usize)> = Vec::new();
        for message in messages.iter().filter(|message| !self.entries.iter().any(|entry| entry.covers(message))) {
            let key = |m: &Message| (m.test.clone(), m.id.clone(), m.function.clone());
            match groups.iter_mut().find(|(first, _)| key(first) == key(message)) {
                Some((_, count)) => *count += 1,
                None => groups.push((message, 1)),
            }
        }
        let line = |(m, count): (&Message, usize)| {
            format!("{}: {} in {}, {count} times: {}", m.test, m.id, m.function, m.text)
        };
        groups.into_iter().map(line).collect()
    }

    /// Entries of these programs that are no longer needed.
    fn missing(&self, messages: &[Message], programs: &[&str]) -> Vec<String> {
        let has_run =
            |entry: &&Entry| entry.shown_by.split(' ').next().is_some_and(|program| programs.contains(&program));
        let is_shown = |entry: &&Entry| messages.iter().any(|m| m.test == entry.shown_by && entry.covers(m));
        let unneeded = self.entries.iter().filter(has_run).filter(|entry| !is_shown(entry));
        let line = |entry: &Entry| {
            format!("{LIST}: {} no longer breaks {}, or the recorder was not loaded", entry.shown_by, entry.id)
        };
        unneeded.map(line).collect()
    }
}

impl Entry {
    fn covers(&self, message: &Message) -> bool {
        let is_there = self.everywhere || message.test == self.shown_by;
        message.id == self.id && message.text.contains(&self.text) && is_there
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[[finding]]\nid = \"OPEN\"\nshown_by = \"d3d12 removed\"\nreason = \"to remove the device\"\n";

    fn message(id: &str, test: &str) -> Message {
        Message { id: id.into(), function: "Execute".into(), text: "list 1".into(), test: test.into() }
    }

    #[test]
    fn only_the_rule_and_the_test_of_an_entry_are_known() {
        let list = KnownFindings::parse(TEXT).unwrap();
        let intended = message("OPEN", "d3d12 removed");
        assert_eq!(list.others(std::slice::from_ref(&intended)), [""; 0]);
        let other = [
            message("OPEN", "d3d12 other"),
            message("OPEN", "d3d12 other"),
            message("SYNC", "d3d12 removed"),
            intended,
        ];
        assert_eq!(
            list.others(&other),
            ["d3d12 other: OPEN in Execute, 2 times: list 1", "d3d12 removed: SYNC in Execute, 1 times: list 1"]
        );
    }

    #[test]
    fn an_entry_for_every_test_still_needs_its_text() {
        let list = KnownFindings::parse(&format!("{TEXT}text = \"list 1\"\neverywhere = true\n")).unwrap();
        let other = message("OPEN", "d3d12_flow pairs");
        assert_eq!(list.others(std::slice::from_ref(&other)), [""; 0]);
        assert_eq!(list.others(&[Message { text: "list 2".into(), ..other }]).len(), 1);
    }

    #[test]
    fn an_entry_that_nothing_breaks_is_reported_if_its_program_ran() {
        let list = KnownFindings::parse(TEXT).unwrap();
        assert_eq!(list.missing(&[], &["d3d12_flow"]), [""; 0]);
        assert_eq!(list.missing(&[], &["d3d12"]).len(), 1);
        assert_eq!(list.missing(&[message("OPEN", "d3d12 removed")], &["d3d12"]), [""; 0]);
    }

    #[test]
    fn the_committed_list_is_readable_and_an_entry_without_a_reason_is_refused() {
        assert!(!KnownFindings::parse(include_str!("../../recorder.toml")).unwrap().entries.is_empty());
        assert!(KnownFindings::parse(&TEXT.replace("to remove the device", " ")).is_err());
    }
}
