//! `study world-quality`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::experiment::ExperimentArgs;
use super::{CELLS_KEPT, Subcommand, print_outcome, progress, stop_on_interrupt};
use crate::world_quality::{self, Settings};

pub(super) const EXAMPLES: &str = "\
Examples:
  study world-quality --quick
      One walk of each level and one place that was never seen, five seconds, and a short look away.

  study world-quality --world miniature.cairn --walks 8 --seconds 60 --looks-away 8 --out out/miniature
      All held-out walks, of a world of your own: hours. Finished walks are kept below --out, so that it goes on where it was stopped.

A rollout starts from the first true picture of a walk through one of the four levels that training refused, or of a place that
no world was trained in, and gets the controls. Its pictures are scored against the true ones, beside showing the first picture
all the time and beside the autoencoder's reconstruction of it. The folder --out gets world-quality.txt, world-quality.csv with
every score, world-quality-lasting.csv with brightness and detail second by second, world-quality-poses.csv with the nearest true
poses, and the walks it shows best and worst as world-quality-good.png and world-quality-bad.png, truth above the world's pictures.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct WorldQualityArgs {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// One walk of each level, five seconds, looks away of two seconds
    #[arg(long)]
    quick: bool,
    /// Held-out walks of each level, 1 to 8, and the number of places that were never seen
    #[arg(long, value_name = "N", default_value_t = world_quality::WALKS)]
    walks: u32,
    /// Length of a walk, 1 to 60
    #[arg(long, value_name = "SECONDS", default_value_t = world_quality::SECONDS)]
    seconds: u32,
    /// Walks of each level in which the memory test runs: the camera turns away and back; 0 leaves it out
    #[arg(long, value_name = "N", default_value_t = 1)]
    looks_away: u32,
    /// Folder for tables and pictures; earlier ones in it are replaced
    #[arg(long, value_name = "DIR", default_value = "target/world-quality")]
    out: PathBuf,
}

impl WorldQualityArgs {
    fn settings(&self) -> Settings {
        let Self { experiment, quick, walks, seconds, looks_away, out } = self;
        let (walks, seconds, looks_away) = (*walks, *seconds, *looks_away);
        Settings { common: experiment.settings(*quick, out), walks, seconds, looks_away }
    }
}

impl Subcommand for WorldQualityArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        let outcome = world_quality::run(&self.settings(), &progress(self.experiment.quiet), stop_on_interrupt()?)?;
        print_outcome(&outcome.text, &outcome.files);
        Ok(ExitCode::SUCCESS)
    }

    fn when_interrupted(&self) -> &'static str {
        CELLS_KEPT
    }
}
