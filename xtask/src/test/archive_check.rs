//! `cairn-check` from the unpacked archives alone: it starts, finds the libraries in the folders beside its own, and its checks pass.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::check::{Verdicts, place_double};
use super::ffx::AMD;
use super::tally::Tally;
use super::{Context, lab};
use crate::shell::Log;
use crate::workspace;

/// Makes `cairn-check` load libraries that AMD has not signed.
const UNSIGNED: &str = "CAIRN_FFX_UNSIGNED";

/// The tarball's program, on what runs on the processor.
pub(super) fn on_linux(
    context: &Context<'_>,
    log: &mut Log,
    root: &Path,
    work: &Path,
    tally: &mut Tally,
) -> Result<(), String> {
    let program = root.join("bin").join("cairn-check");
    let out = fresh(work, "check-linux")?;
    let listed = log.run(Command::new(&program).arg("list").current_dir(&out))?;
    tally.test(failure_of_list(listed.success, &listed.output));
    let mut command = Command::new(&program);
    context.provide_worlds(command.current_dir(&out))?;
    let ended = log.run(command.args(["--quick", "--minutes", "30", "--only", "processor"]))?;
    tally.test((!ended.success).then(|| format!("cairn-check of the tarball: {}", ended.output)));
    let compared = log.run(Command::new(&program).args(["compare", "report.json", "report.json"]).current_dir(&out))?;
    let is_right = compared.success && compared.output.contains("Verdicts that differ: none");
    tally.test((!is_right).then(|| format!("cairn-check of the tarball compares no reports: {}", compared.output)));
    Ok(())
}

/// The program of the Windows archives, with an empty environment. Only the full archive has Microsoft's libraries; a double of AMD's is put
/// where its page says.
pub(super) fn on_windows(
    context: &Context<'_>,
    log: &mut Log,
    [full, slim]: [&Path; 2],
    work: &Path,
    tally: &mut Tally,
) -> Result<(), String> {
    let mut list = lab::with_empty_environment(&program(full))?;
    let listed = log.run(list.arg("list"))?;
    tally.test(failure_of_list(listed.success, &listed.output));

    let amd = full.join("amd");
    place_double(context, &amd)?;
    let verdicts = checked(log, full, &fresh(work, "check-windows")?, "libraries,cpu-world,fsr")?;
    for file in [AMD.to_owned(), format!("{AMD}.txt")] {
        fs::remove_file(amd.join(&file)).map_err(|e| format!("{file}: {e}"))?;
    }
    verdicts.require(&["libraries", "cpu-world", "fsr"], &[], tally);

    let verdicts = checked(log, slim, &fresh(work, "check-slim")?, "libraries,cpu-world,fsr")?;
    for name in ["libraries", "cpu-world", "fsr"] {
        let verdict = verdicts.of(name);
        let wrong = || format!("cairn-check of the slim archive, {name}, which lacks its library: {verdict}");
        tally.test((verdict != "cannot-tell").then(wrong));
    }
    Ok(())
}

fn program(root: &Path) -> PathBuf {
    root.join("bin").join("cairn-check.exe")
}

/// Runs checks of an unpacked Windows archive.
fn checked(log: &mut Log, root: &Path, out: &Path, only: &str) -> Result<Verdicts, String> {
    let mut command = lab::with_empty_environment(&program(root))?;
    command.args(["--quick", "--minutes", "30", "--only", only, "--out"]).arg(lab::windows_path(out));
    log.run(command.env(UNSIGNED, "1"))?;
    Verdicts::read(out)
}

/// An empty folder for reports.
fn fresh(work: &Path, name: &str) -> Result<PathBuf, String> {
    let out = work.join(name);
    workspace::make_empty(&out).map(|()| out)
}

/// The failure if a list of checks lacks its groups.
fn failure_of_list(success: bool, output: &str) -> Option<String> {
    let has_groups = ["there: ", "processor: ", "times: "].iter().all(|group| output.contains(group));
    (!success || !has_groups).then(|| format!("cairn-check of an archive lists no checks: {output}"))
}
