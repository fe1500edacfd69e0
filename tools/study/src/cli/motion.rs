//! `study motion`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use cairn::world::GuidanceSource;
use clap::Args;

use super::experiment::ExperimentArgs;
use super::{Subcommand, print_outcome, progress, stop_on_interrupt};
use crate::motion::{self, Settings};

pub(super) const EXAMPLES: &str = "\
Examples:
  study motion --quick
      One place of each kind and two frames of each, in a minute.

  study motion --publish
      The page docs/motion.md: three places of each kind, eight frames of each.

  study motion --world waypoint.cairn --seeds 41,42,43,44 --check
      With the latents of a world of your own; fails where another source is better than the one that \"best\" names.

Compares sources of motion with the true motion, and the frames made with each with the true frames: the paper's latent gradients, the
same calibrated, optical flow between latents, optical flow between pictures, and the controls. The folder
--out gets motion.md, motion.csv with every frame, and motion.png.

Exit status: 0 well, 1 failed or, with --check, \"best\" is not the best, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct MotionArgs {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// One place of each kind, two frames of each
    #[arg(long)]
    quick: bool,
    /// Fail where another source than the one that "best" names makes the better frames
    #[arg(long)]
    check: bool,
    /// Folder for page, table and picture; earlier ones in it are replaced
    #[arg(long, value_name = "DIR", default_value = "target/motion")]
    out: PathBuf,
}

impl MotionArgs {
    fn settings(&self) -> Settings {
        self.experiment.settings(self.quick, &self.out)
    }
}

impl Subcommand for MotionArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        let outcome = motion::run(&self.settings(), &progress(self.experiment.quiet), stop_on_interrupt()?)?;
        print_outcome(&outcome.text, &outcome.files);
        if !self.check {
            return Ok(ExitCode::SUCCESS);
        }
        let mut is_best = true;
        for (pictures, best) in [("the renderer's", outcome.best), ("the autoencoder's", outcome.best_decoded)] {
            let found = best.map_or("no source that all measures agree on".to_owned(), |best| best.to_string());
            eprintln!("between {pictures} pictures: {found} (the library uses {})", GuidanceSource::BEST);
            is_best &= best == Some(GuidanceSource::BEST);
        }
        Ok(ExitCode::from(u8::from(!is_best)))
    }
}
