//! `study weights`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::rollout::preset;
use super::{CELLS_KEPT, Subcommand, print_outcome, progress, stop_on_interrupt};
use crate::level::HELD_OUT_SECONDS;
use crate::workers::usual_jobs;
use crate::world_quality::weights::{self, Settings};

pub(super) const EXAMPLES: &str = "\
Examples:
  study weights --walks 1 --seconds 5
      The world inside the library in 16, 8 and 4 bits, one short walk of each level. The worlds are made on first use.

  study weights --walks 8 --jobs 4 --out out/weights
      All held-out walks of 60 seconds: hours. Finished rollouts are stored below --out, so that it goes on where it was stopped.

  python -m cairn.build quantise mine --weights 8 --out mine-8bit
  study weights --world mine mine-8bit
      A world of your own beside the same one in 8 bits.

Every rollout starts from the first true picture of a walk through one of the four levels that training refused, and gets the
controls. All worlds have the same controls and the same noise. Their pictures are compared with the true ones twice a second.
The folder --out gets weights.md with means, differences and their intervals, and weights.csv with every score.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct WeightsArgs {
    /// Worlds with other weights [default: the one inside the library in 8 and in 4 bits]
    #[arg(value_name = "BUNDLE", conflicts_with = "publish")]
    others: Vec<PathBuf>,
    /// The world that they are compared with: a folder or a .cairn file; without one, the one inside the library
    #[arg(long, value_name = "BUNDLE", requires = "others")]
    world: Option<PathBuf>,
    /// Operating point
    #[arg(long, value_name = "NAME", default_value = "stock")]
    preset: String,
    /// Held-out walks of each level, 1 to 8
    #[arg(long, value_name = "N", default_value_t = weights::WALKS)]
    walks: u32,
    /// Length of a walk, 1 to 60
    #[arg(long, value_name = "SECONDS", default_value_t = HELD_OUT_SECONDS)]
    seconds: u32,
    /// Walks made at a time; no number depends on it [default: one to each processor]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Leave LPIPS and horizons out; its weights are fetched once otherwise (64 MB)
    #[arg(long, conflicts_with = "publish")]
    no_lpips: bool,
    /// Also write the published page into docs/, of the embedded world
    #[arg(long, conflicts_with = "world")]
    publish: bool,
    /// Folder for tables; finished rollouts in it are not made again
    #[arg(long, value_name = "DIR", default_value = "target/weights")]
    out: PathBuf,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

impl WeightsArgs {
    fn settings(&self) -> Result<Settings> {
        Ok(Settings {
            world: self.world.clone(),
            others: self.others.clone(),
            preset: preset(&self.preset)?,
            walks: self.walks,
            seconds: self.seconds,
            lpips: !self.no_lpips,
            jobs: self.jobs.unwrap_or_else(|| usual_jobs(1)),
            publish: self.publish,
            out: self.out.clone(),
        })
    }
}

impl Subcommand for WeightsArgs {
    fn check(&self) -> Result<()> {
        self.settings()?.check()
    }

    fn run(&self) -> Result<ExitCode> {
        let outcome = weights::run(&self.settings()?, &progress(self.quiet), stop_on_interrupt()?)?;
        print_outcome(&outcome.text, &outcome.files);
        Ok(ExitCode::SUCCESS)
    }

    fn when_interrupted(&self) -> &'static str {
        CELLS_KEPT
    }
}
