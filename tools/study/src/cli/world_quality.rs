//! `study world-quality`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::experiment::ExperimentArgs;
use super::{NOTHING_WRITTEN, Subcommand, interrupted, print_outcome, progress, stop_on_interrupt};
use crate::world_quality::{self, Settings};

pub(super) const EXAMPLES: &str = "\
Examples:
  study world-quality --quick
      One place of each kind, five seconds, and a short look away; with --publish into docs/world.md.

  study world-quality --world miniature.cairn --out out/miniature
      Of a world of your own: eight places of each kind for fifteen seconds, looks away of 2, 4 and 8 seconds; an hour.

A rollout starts from the first true picture of a place that no world was trained on and gets the controls of the scene's own
script. Its pictures are scored against the true ones, beside showing the first picture all the time and beside the
autoencoder's reconstruction of it. The folder --out gets world-quality.txt, world-quality.csv with
every score, world-quality-lasting.csv with the brightness of every place second by second, and the places it shows best and
worst as world-quality-good.png and world-quality-bad.png, truth above the world's pictures.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct WorldQualityArgs {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// One place of each kind, five seconds, looks away of two seconds
    #[arg(long)]
    quick: bool,
    /// Leave the looks away out: what the world remembers
    #[arg(long)]
    no_memory: bool,
    /// Folder for tables and pictures; earlier ones in it are replaced
    #[arg(long, value_name = "DIR", default_value = "target/world-quality")]
    out: PathBuf,
}

impl WorldQualityArgs {
    fn settings(&self) -> Settings {
        Settings { common: self.experiment.settings(self.quick, &self.out), memory: !self.no_memory }
    }
}

impl Subcommand for WorldQualityArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        match world_quality::run(&self.settings(), &progress(self.experiment.quiet), stop_on_interrupt()?) {
            Ok(outcome) => {
                print_outcome(&outcome.text, &outcome.files);
                Ok(ExitCode::SUCCESS)
            }
            Err(error) => interrupted(error, NOTHING_WRITTEN),
        }
    }
}
