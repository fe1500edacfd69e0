//! `study replay`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::{Subcommand, progress, stop_on_interrupt};
use crate::inputs::Overrides;
use crate::replay::{Difference, Replay, replay};

#[derive(Args)]
pub(super) struct ReplayArgs {
    /// The manifest.json of the rollout or the reconstruct
    manifest: PathBuf,
    /// Folder for what is made again [default: replay, beside the manifest]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace an earlier replay in that folder
    #[arg(long)]
    overwrite: bool,
    /// Where the world is now
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// Where the seed picture is now
    #[arg(long, value_name = "FILE")]
    seed_picture: Option<PathBuf>,
    /// Where the script is now
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

impl Subcommand for ReplayArgs {
    fn run(&self) -> Result<ExitCode> {
        let progress = progress(self.quiet);
        let compared = replay(&Replay {
            manifest: &self.manifest,
            out: self.out.as_deref(),
            overwrite: self.overwrite,
            overrides: Overrides {
                world: self.world.clone(),
                seed_picture: self.seed_picture.clone(),
                script: self.script.clone(),
            },
            stop: stop_on_interrupt()?,
            progress: &progress,
        })?;
        for difference in &compared.differences {
            println!("{difference}");
        }
        for path in &compared.skipped {
            println!("output {path}: not whole in the first rollout, not compared");
        }
        if compared.interrupted {
            eprintln!("interrupted before there was something to compare");
            return Ok(ExitCode::from(130));
        }
        if compared.differences.iter().any(Difference::is_failure) {
            println!("The replay is NOT the same.");
            return Ok(ExitCode::from(1));
        }
        println!("The replay is the same: {} files are equal to the bit ({}).", compared.equal, compared.out.display());
        Ok(ExitCode::SUCCESS)
    }
}
