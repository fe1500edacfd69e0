//! `study world-quality`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::{NOTHING_WRITTEN, Subcommand, interrupted, print_outcome, progress, stop_on_interrupt};
use crate::experiment;
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
    /// The world: a folder or a .cairn file; without one, the one inside the library
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// One place of each kind, five seconds, looks away of two seconds
    #[arg(long)]
    quick: bool,
    /// Scene seeds, of those that are held out [default: 41, with --quick, else 41 to 48]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    seeds: Vec<u64>,
    /// Leave LPIPS out; its weights are fetched once otherwise (64 MB)
    #[arg(long)]
    no_lpips: bool,
    /// Leave the looks away out: what the world remembers
    #[arg(long)]
    no_memory: bool,
    /// Write docs/world.md and its pictures as well: of the embedded world
    #[arg(long, conflicts_with = "world")]
    publish: bool,
    /// Folder for tables and pictures; earlier ones in it are replaced
    #[arg(long, value_name = "DIR", default_value = "target/world-quality")]
    out: PathBuf,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

impl WorldQualityArgs {
    fn settings(&self) -> Settings {
        let Self { world, quick, seeds, no_lpips, no_memory, publish, out, .. } = self;
        let (world, seeds, out) = (world.clone(), seeds.clone(), out.clone());
        let common = experiment::Settings { world, seeds, quick: *quick, lpips: !no_lpips, publish: *publish, out };
        Settings { common, memory: !no_memory }
    }
}

impl Subcommand for WorldQualityArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        match world_quality::run(&self.settings(), &progress(self.quiet), stop_on_interrupt()?) {
            Ok(outcome) => {
                print_outcome(&outcome.text, &outcome.files);
                Ok(ExitCode::SUCCESS)
            }
            Err(error) => interrupted(error, NOTHING_WRITTEN),
        }
    }
}
