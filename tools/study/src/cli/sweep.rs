//! `study sweep`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::{CELLS_KEPT, Subcommand, print_outcome, progress, stop_on_interrupt};
use crate::sweep::{self, Settings};
use crate::workers::check_jobs;

pub(super) const EXAMPLES: &str = "\
Examples:
  study sweep tools/study/sweeps/smoke.toml
      Four operating points for a fifth of a second: whether everything works.

  study sweep tools/study/sweeps/paper.toml --out out/sweeps --jobs 2
      Windows and passes around the paper's own, with the curve of its \"heavier is not better\". It may be interrupted, even
      killed, at any time: the same command goes on, and makes nothing again that is whole.

  study sweep mine.toml --list-jobs
      What there is to make, as JSON; with --only NAME one of them is made. So schedulers of clusters make a sweep; for Ray,
      python -m cairn.sweep does that.

A sweep is a file in TOML:

  scenes = [\"forest\", \"sword\"]     # forest, sword, desert, snow; all without it
  places = 3                       # of each kind; intervals need two places or more
  seconds = 15                     # of world time
  size = [320, 180]                # at which everything is compared
  base = \"coherence\"               # what the axes change: a preset, and what differs from it
  budgets = [170, 192]             # in GFLOP for a second of world time: the report names the best point of each

  [sweep]                          # every combination of:
  window = [112, 256, 384, 512]    # g, in latents
  steps = [8, 10, 12]              # denoise passes, of refined schedules
  schedule = [\"stock\"]             # or whole schedules in their place: stock, refined:10, explicit:1:0.5:0
  cache = [\"separate\", \"fused\", \"interval:4\"]
  anchor_rate = [10, 20]           # latents a second
  multiplier = [3, 6]              # frames shown for each anchor; with the anchor rate, a multiple of 30 a second
  motion = [\"best\", \"paper\"]       # best, picture, latent, paper
  generator = [\"cpu\"]              # cpu; on Windows shader and fsr as well

steps and schedule are one axis, of which a file names one. Besides: world = \"a.cairn\" (from where the file lies), device = \"cpu\",
threads = 1, lpips = true, measure = \"horizon\" (or lpips, ssim, psnr), cost = \"gflop\" (or seconds, as measured). docs/sweep.md
tells what each of them means.

The folder --out gets a folder for every place with one for each point in it, and of the sweep NAME.toml the report as NAME.html and
NAME.md and every rollout as NAME.csv. Sweeps of the same size, time and world may share it: points that they have in common are made once.
Frames are kept as PNG: about 30 MB for 15 seconds at 320x180.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct SweepArgs {
    /// The sweep, in TOML
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Rollouts made at a time; no number depends on it, but times do [default: one to as many processors as a rollout has
    /// threads, 1 on a graphics device]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Folder for everything; what is whole in it is kept
    #[arg(long, value_name = "DIR", default_value = "target/sweep")]
    out: PathBuf,
    /// Writes the report, its figures and the CSV into this folder too
    #[arg(long, value_name = "DIR")]
    publish: Option<PathBuf>,
    /// Makes no rollout: says as JSON which there are, and whether they are whole
    #[arg(long, conflicts_with_all = ["jobs", "publish", "only"])]
    list_jobs: bool,
    /// Makes this one, where it is not whole, and no report
    #[arg(long, value_name = "NAME", conflicts_with_all = ["jobs", "publish"])]
    only: Option<String>,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

impl Subcommand for SweepArgs {
    fn check(&self) -> Result<()> {
        check_jobs(self.jobs.unwrap_or(1))
    }

    fn run(&self) -> Result<ExitCode> {
        self.check()?;
        let settings = Settings::read(&self.file, self.out.clone(), self.jobs, self.publish.clone())?;
        let (progress, stop) = (progress(self.quiet), stop_on_interrupt()?);
        if self.list_jobs {
            print!("{}", sweep::list(&settings, &progress)?);
        } else if let Some(name) = &self.only {
            sweep::only(&settings, name, &progress, stop)?;
        } else {
            let outcome = sweep::run(&settings, &progress, stop)?;
            print_outcome(&outcome.text, &outcome.files);
        }
        Ok(ExitCode::SUCCESS)
    }

    fn when_interrupted(&self) -> &'static str {
        CELLS_KEPT
    }
}
