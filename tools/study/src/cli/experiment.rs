//! Options that the experiments `motion`, `cadence` and `world-quality` share.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::experiment::Settings;

#[derive(Args)]
pub(super) struct ExperimentArgs {
    /// The world: a folder or a .cairn file; without one, the one inside the library
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// Held-out scene seeds [default: those of the published page; with --quick, 41]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    seeds: Vec<u64>,
    /// Leave LPIPS out; its weights are fetched once otherwise (64 MB)
    #[arg(long)]
    no_lpips: bool,
    /// Also write the published page and its pictures into docs/, of the embedded world
    #[arg(long, conflicts_with = "world")]
    publish: bool,
    /// No progress
    #[arg(long)]
    pub(super) quiet: bool,
}

impl ExperimentArgs {
    /// The settings of an experiment that writes to `out`; `quick` for fewer scenes and less of each.
    pub(super) fn settings(&self, quick: bool, out: &Path) -> Settings {
        let Self { world, seeds, no_lpips, publish, .. } = self;
        let (world, seeds, out) = (world.clone(), seeds.clone(), out.to_owned());
        Settings { world, seeds, quick, lpips: !no_lpips, publish: *publish, out }
    }
}
