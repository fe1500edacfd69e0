//! A part of the runner `study`: the quality table at its smallest, through the program as a user starts it. The whole table is
//! `study quality --publish`, which needs third-party programs and takes minutes.

use std::fs;
use std::process::Command;

use super::Context;
use super::tally::Tally;
use crate::shell::Log;

/// Rows that need no third-party program; each is scored on two frames.
const ROWS: [&str; 4] = ["repeat", "blend", "cairn-flow", "cairn-truth"];
const FRAMES: usize = 2;

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    context.build_programs(log)?;
    let folder = context.workspace.target.join("xtask").join("quality");
    match fs::remove_dir_all(&folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(format!("{}: {e}", folder.display())),
        _ => {}
    }
    let mut quality = Command::new(context.workspace.program("debug", "study"));
    quality.current_dir(&context.workspace.root).args(["quality", "--smoke", "--fresh", "--out"]).arg(&folder);
    context.provide_lpips(&mut quality)?;

    let mut tally = Tally::default();
    tally.test((!log.run(&mut quality)?.success).then(|| "the table could not be made".to_owned()));
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
