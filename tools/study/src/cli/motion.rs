//! `study motion`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use cairn::world::GuidanceSource;
use clap::Args;

use super::{NOTHING_WRITTEN, Subcommand, interrupted, print_outcome, progress, stop_on_interrupt};
use crate::motion::{self, Settings};

pub(super) const EXAMPLES: &str = "\
Examples:
  study motion --quick
      One place of each kind and two frames of each, in a minute.

  study motion --publish
      The page docs/motion.md: three places of each kind, eight frames of each.

  study motion --world waypoint.cairn --seeds 41,42,43,44 --check
      With the latents of a world of your own; fails where another source is better than the one that \"best\" names.

Motion from latents as the paper has it and calibrated, from what looks alike in latents, from pictures, from the controls, and the
truth's; each is held against the truth, and so are the frames made with it. The folder --out gets motion.md, motion.csv with every
frame, and motion.png.

Exit status: 0 well, 1 failed or, with --check, \"best\" is not the best, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct MotionArgs {
    /// The world whose autoencoder makes latents: a folder or a .cairn file; without one, the one inside the library
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// One place of each kind, two frames of each
    #[arg(long)]
    quick: bool,
    /// Scene seeds, of those that are held out [default: 41, with --quick, else 41,42,43]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    seeds: Vec<u64>,
    /// Leave LPIPS out; its weights are fetched once otherwise (64 MB)
    #[arg(long)]
    no_lpips: bool,
    /// Fail where another source than the one that "best" names makes the better frames
    #[arg(long)]
    check: bool,
    /// Write docs/motion.md and its picture as well: with the embedded world
    #[arg(long, conflicts_with = "world")]
    publish: bool,
    /// Folder for page, table and picture; earlier ones in it are replaced
    #[arg(long, value_name = "DIR", default_value = "target/motion")]
    out: PathBuf,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

impl MotionArgs {
    fn settings(&self) -> Settings {
        let Self { world, quick, seeds, no_lpips, publish, out, .. } = self;
        let (world, seeds, out) = (world.clone(), seeds.clone(), out.clone());
        Settings { world, seeds, quick: *quick, lpips: !no_lpips, publish: *publish, out }
    }
}

impl Subcommand for MotionArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        match motion::run(&self.settings(), &progress(self.quiet), stop_on_interrupt()?) {
            Ok(outcome) => {
                print_outcome(&outcome.text, &outcome.files);
                Ok(ExitCode::from(u8::from(self.check && outcome.best != Some(GuidanceSource::BEST))))
            }
            Err(error) => interrupted(error, NOTHING_WRITTEN),
        }
    }
}
