//! The study program end to end, as a user starts it: a short rollout, its replay, a small comparison of motion sources, the smallest
//! sweep, and the smallest quality table.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::tally::Tally;
use super::{Context, quality};
use crate::shell::Log;
use crate::workspace;

/// Files that a rollout writes.
const OUTPUTS: [&str; 2] = ["manifest.json", "contact-sheet.png"];

/// Half a second of a small world: 15 anchors a second and a generated frame between every two.
const SHORT: &[&str] = &[
    "--preset",
    "coherence",
    "--context",
    "g16",
    "--schedule",
    "stock",
    "--seconds",
    "0.5",
    "--size",
    "256x144",
    "--formats",
    "mp4,png,y4m",
];

/// The video of the short rollout, which is made here if the `study` runner has not made it.
pub(super) fn rollout_video(context: &Context<'_>, log: &mut Log) -> Result<PathBuf, String> {
    let folder = context.workspace.target.join("xtask").join("study").join("rollout");
    if find_video(&folder).is_none() {
        rollouts(context, log)?;
    }
    find_video(&folder).ok_or_else(|| format!("{} holds no video", folder.display()))
}

/// The report of a comparison over a fifth of a second of one scene.
pub(super) fn comparison_report(context: &Context<'_>, log: &mut Log) -> Result<PathBuf, String> {
    context.build_programs(log)?;
    let folder = context.workspace.target.join("xtask").join("compare");
    let report = folder.join("report.html");
    workspace::remove(&report)?;
    let mut compare = study(context)?;
    compare.args([
        "compare",
        "--scene",
        "sword",
        "--seconds",
        "0.2",
        "--size",
        "256x144",
        "--no-lpips",
        "--quiet",
        "--out",
    ]);
    if !log.run(compare.arg(&folder))?.success {
        return Err("the comparison failed".to_owned());
    }
    Ok(report)
}

fn find_video(folder: &Path) -> Option<PathBuf> {
    let entries = fs::read_dir(folder).ok()?;
    entries.flatten().map(|entry| entry.path()).find(|path| path.extension().is_some_and(|e| e == "mp4"))
}

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = rollouts(context, log)?;
    tally.add(quality::run(context, log)?);
    Ok(tally)
}

/// The rollout with its replay, the comparison of motion sources, and the sweep.
fn rollouts(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    context.build_programs(log)?;
    let folder = context.workspace.target.join("xtask").join("study");
    workspace::remove(&folder)?;
    let first = folder.join("rollout");
    let mut tally = Tally::default();

    let mut rollout = study(context)?;
    rollout.arg("rollout").arg("--world").arg(context.bundle("tiny")?).args(SHORT).arg("--out").arg(&first);
    tally.test((!log.run(&mut rollout)?.success).then(|| "the rollout failed".to_owned()));
    for name in OUTPUTS {
        tally.check(missing(&first.join(name)));
    }
    tally.test(video(&first));

    let mut replay = study(context)?;
    replay.arg("replay").arg(first.join("manifest.json")).arg("--out").arg(folder.join("replay"));
    tally.test((!log.run(&mut replay)?.success).then(|| "the replay differs from the rollout, or failed".to_owned()));

    // With the embedded world, whose latents are meaningful.
    let motion_folder = folder.join("motion");
    let mut motion = study(context)?;
    motion.args(["motion", "--quick", "--no-lpips", "--check", "--quiet", "--out"]).arg(&motion_folder);
    tally.test(
        (!log.run(&mut motion)?.success).then(|| "another motion is better than the best, or none was made".into()),
    );
    for name in ["motion.md", "motion.csv", "motion.png"] {
        tally.check(missing(&motion_folder.join(name)));
    }

    let sweep_folder = folder.join("sweep");
    let mut sweep = study(context)?;
    sweep.args(["sweep", "tools/study/sweeps/smoke.toml", "--quiet", "--out"]).arg(&sweep_folder);
    tally.test((!log.run(&mut sweep)?.success).then(|| "the sweep failed".to_owned()));
    for name in ["smoke.md", "smoke.html", "smoke.csv", "figures/smoke-pareto-ssim.svg"] {
        tally.check(missing(&sweep_folder.join(name)));
    }
    Ok(tally)
}

fn study(context: &Context<'_>) -> Result<Command, String> {
    let mut command = Command::new(context.workspace.program("debug", "study"));
    command.current_dir(&context.workspace.root);
    context.provide_worlds(&mut command)?;
    Ok(command)
}

/// The error if a file is missing or empty.
pub(super) fn missing(path: &Path) -> Option<String> {
    match fs::metadata(path) {
        Ok(data) if data.len() > 0 => None,
        Ok(_) => Some(format!("{} is empty", path.display())),
        Err(e) => Some(format!("{}: {e}", path.display())),
    }
}

/// An MP4 file starts with its `ftyp` box.
fn video(folder: &Path) -> Option<String> {
    match find_video(folder).map(fs::read) {
        Some(Ok(bytes)) if bytes.get(4..8) == Some(b"ftyp") => None,
        Some(Ok(_)) => Some("the video is no MP4 file".to_owned()),
        Some(Err(e)) => Some(format!("the video cannot be read: {e}")),
        None => Some(format!("{} holds no video", folder.display())),
    }
}
