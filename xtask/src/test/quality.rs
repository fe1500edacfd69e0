//! A part of the runner `study`: the quality table at its smallest, through the program as a user starts it; the floors of a dozen frames;
//! and two frames by each third-party program. The whole table is `study quality --publish`, which takes minutes.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::Context;
use super::tally::{Skip, Tally};
use crate::shell::Log;
use crate::workspace;

/// Rows that need no third-party program; each is scored on two frames.
const ROWS: [&str; 7] = ["repeat", "blend", "none", "paper", "cairn-flow", "cairn-engine", "cairn-truth"];
/// Rows that a third-party program makes, and the clip that one plays.
const DRIVERS: [&str; 4] = ["minterpolate", "flowfps", "rife", "rife4"];
const GAME: &str = "vizdoom";
/// The program's error for a package without a network.
const UNREACHABLE: &str = "cannot reach the package index";
/// The program's error for a package that needs a newer Python than this machine has.
const NO_PYTHON: &str = "only other versions were found";
const FRAMES: usize = 2;

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    context.build_programs(log)?;
    let folder = context.workspace.target.join("xtask").join("quality");
    workspace::remove(&folder)?;
    let mut tally = smoke(context, log, &folder)?;
    tally.add(floors(context, log, &folder.join("floors"))?);
    tally.add(drivers(context, log, &folder.join("drivers"))?);
    Ok(tally)
}

/// `study quality` with an option that chooses a short form of it.
fn quality(context: &Context<'_>, option: &str, out: &Path) -> Result<Command, String> {
    let mut command = Command::new(context.workspace.program("debug", "study"));
    command.current_dir(&context.workspace.root).args(["quality", option, "--out"]).arg(out);
    context.provide_lpips(&mut command)?;
    Ok(command)
}

/// Every frame and every claim that the program judges is a test.
fn floors(context: &Context<'_>, log: &mut Log, folder: &Path) -> Result<Tally, String> {
    let ended = log.run(quality(context, "--floors", folder)?.arg("--quiet"))?;
    let mut tally = Tally::default();
    for line in ended.output.lines() {
        if line.starts_with("held ") {
            tally.test(None);
        } else if let Some(failure) = line.strip_prefix("FAILED ") {
            tally.test(Some(failure.to_owned()));
        }
    }
    if !ended.success && tally.failures.is_empty() {
        tally.test(Some("the floors could not be compared".to_owned()));
    }
    // A dozen frames of two rows, at least.
    tally.check((tally.passed + tally.failures.len() < 24).then(|| "not every floor was compared".to_owned()));
    Ok(tally)
}

/// Two frames by each third-party program. One that cannot be fetched is skipped, which fails in continuous integration.
fn drivers(context: &Context<'_>, log: &mut Log, folder: &Path) -> Result<Tally, String> {
    let ended = log.run(quality(context, "--drivers", folder)?.arg("--fresh"))?;
    let unavailable = |name: &str| {
        let start = format!("left out: {name}: ");
        ended.output.lines().find_map(|line| line.strip_prefix(&start).map(str::to_owned))
    };
    let frames = fs::read_to_string(folder.join("quality-frames.csv")).unwrap_or_default();
    let game = unavailable(GAME);
    let mut tally = Tally::default();
    for row in DRIVERS {
        match unavailable(row).or_else(|| game.clone()) {
            Some(why) if why.contains(UNREACHABLE) || why.contains(NO_PYTHON) => {
                tally.skips.push(Skip { name: format!("{row} on {GAME}"), reason: why });
            }
            Some(why) => tally.test(Some(format!("{row} on {GAME} cannot be provided: {why}"))),
            None => {
                let scores = frames.lines().filter(|line| is_score(line, row)).count();
                tally.test(
                    (scores != FRAMES).then(|| format!("{row} has {scores} whole scores of {GAME}, not {FRAMES}")),
                );
            }
        }
    }
    Ok(tally)
}

/// The quality table of the rows that need no third-party program.
fn smoke(context: &Context<'_>, log: &mut Log, folder: &Path) -> Result<Tally, String> {
    let mut tally = Tally::default();
    let ended = log.run(quality(context, "--smoke", folder)?.arg("--fresh"))?;
    tally.test((!ended.success).then(|| "the table could not be made".to_owned()));
    let read = |name: &str| fs::read_to_string(folder.join(name)).map_err(|e| format!("{name}: {e}"));
    let (page, frames) = (read("quality.md")?, read("quality-frames.csv")?);
    for row in ROWS {
        let scores = frames.lines().filter(|line| is_score(line, row)).count();
        tally.test((scores != FRAMES).then(|| format!("{row} has {scores} whole scores, not {FRAMES}")));
        tally.check((!page.contains(&format!("(`{row}`)"))).then(|| format!("quality.md does not tell of {row}")));
    }
    Ok(tally)
}

/// Whether a line of the table of frames belongs to `row` and ends with PSNR, SSIM and LPIPS as numbers.
fn is_score(line: &str, row: &str) -> bool {
    let fields: Vec<&str> = line.split(',').collect();
    fields.get(1) == Some(&row)
        && fields.len() > 5
        && fields[fields.len() - 3..].iter().all(|f| f.parse::<f64>().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_score_without_lpips_is_not_whole() {
        assert!(is_score("forest-4,blend,14,1/2,2,28.0912,0.79570,0.10180", "blend"));
        assert!(!is_score("forest-4,blend,14,1/2,2,28.0912,0.79570,", "blend"));
        assert!(!is_score("forest-4,repeat,14,1/2,2,28.0912,0.79570,0.1", "blend"));
        assert!(!is_score("clip,row,anchor,phase,multipliers,psnr,ssim,lpips", "row"));
    }
}
