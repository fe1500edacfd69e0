//! `study cadence`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::experiment::ExperimentArgs;
use super::{Subcommand, print_outcome, progress, stop_on_interrupt};
use crate::cadence::{self, Settings};

pub(super) const EXAMPLES: &str = "\
Examples:
  study cadence --quick
      One place of each kind, one moment of each and a second of the world's own walk.

  study cadence --publish
      The page docs/cadence.md: three places of each kind.

Generates 60 frames a second from 10 anchors a second, and 15 to 60, 15 to 30 and 30 to 60, and compares every generated frame with the
true one: between rendered anchors with rendered frames, and between a world's own pictures with those that its
decoder makes. The folder --out gets cadence.md, cadence.csv with every frame, and cadence.png.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct CadenceArgs {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// One place of each kind, one moment of each, a second of the world's own walk
    #[arg(long)]
    quick: bool,
    /// Folder for page, table and picture; earlier ones in it are replaced
    #[arg(long, value_name = "DIR", default_value = "target/cadence")]
    out: PathBuf,
}

impl CadenceArgs {
    fn settings(&self) -> Settings {
        self.experiment.settings(self.quick, &self.out)
    }
}

impl Subcommand for CadenceArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        let outcome = cadence::run(&self.settings(), &progress(self.experiment.quiet), stop_on_interrupt()?)?;
        print_outcome(&outcome.text, &outcome.files);
        Ok(ExitCode::SUCCESS)
    }
}
