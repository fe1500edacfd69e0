//! `study ablate`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::{Subcommand, print_outcome, progress, stop_on_interrupt};
use crate::quality::{AblationSettings, ablate};

pub(super) const EXAMPLES: &str = "\
Examples:
  study ablate --smoke
      One frame of a small scene without each rule, in a minute.

  study ablate --clips moving-forest,bunny --seeds 4 --lpips none
      While a rule is worked on.

  study ablate --publish
      The page docs/generator-rules.md.

Leaves out one rule of the generator or of picture_flow at a time, and compares the frames with those that all rules make.
The folder --out gets generator-rules.md, and generator-rules.csv with every frame.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct AblateArgs {
    /// The clips: all, scenes, moving, real, or a list as that of study quality
    #[arg(long, value_name = "LIST", default_value = "all")]
    clips: String,
    /// Seeds of the scenes
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [5])]
    seeds: Vec<u64>,
    /// Network of LPIPS: alex, vgg or none; its weights are fetched once (64 MB)
    #[arg(long, value_name = "NET", default_value = "alex")]
    lpips: String,
    /// One frame of one scene at a small size, without LPIPS
    #[arg(long, conflicts_with_all = ["clips", "seeds", "lpips", "publish"])]
    smoke: bool,
    /// Write docs/generator-rules.md as well
    #[arg(long)]
    publish: bool,
    /// Folder for page and table; earlier ones in it are replaced
    #[arg(long, value_name = "DIR", default_value = "target/ablate")]
    out: PathBuf,
    /// No progress, no summary
    #[arg(long)]
    quiet: bool,
}

impl AblateArgs {
    fn settings(&self) -> AblationSettings {
        let (clips, seeds, lpips) = if self.smoke {
            ("forest".into(), vec![4], "none".into())
        } else {
            (self.clips.clone(), self.seeds.clone(), self.lpips.clone())
        };
        AblationSettings { clips, seeds, lpips, smoke: self.smoke, publish: self.publish, out: self.out.clone() }
    }
}

impl Subcommand for AblateArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        let outcome = ablate(&self.settings(), &progress(self.quiet), stop_on_interrupt()?)?;
        outcome.left_out.iter().for_each(|left_out| eprintln!("left out: {left_out}"));
        print_outcome(if self.quiet { "" } else { &outcome.text }, &outcome.files);
        Ok(ExitCode::SUCCESS)
    }
}
