//! `study demo`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::{Subcommand, reconstruct, rollout, size};
use crate::demo;
use crate::settings::Settings;

#[derive(Args)]
pub(super) struct DemoArgs {
    /// Folder for everything that is made; an earlier demo in it is replaced
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    out: PathBuf,
    /// World bundle [default: the one inside the library]
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// World time of the rollout
    #[arg(long, default_value = "4")]
    seconds: String,
    /// Size of the rollout's presented frames
    #[arg(long, value_name = "WxH", default_value = "1920x1080")]
    size: String,
    /// Where the world runs: auto, cpu, d3d12 for the best adapter, or d3d12:N for number N of the system's list; auto is that
    /// adapter where the world loads on it, else the processor, and says why
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: String,
    /// What takes the world's pictures to that size: lanczos, which is spatial, catmull-rom, or on Windows fsr, which makes anchors larger
    /// before frames are generated between them
    #[arg(long, default_value = "lanczos")]
    upscaler: String,
    /// What makes frames between anchors: cpu, or on Windows shader or fsr, for which AMD's libraries lie in CAIRN_FFX_DIR or beside
    /// this program
    #[arg(long, value_name = "GENERATOR", default_value = "cpu")]
    generator: String,
    /// No progress, no summary
    #[arg(long)]
    quiet: bool,
}

impl DemoArgs {
    /// What the options ask for.
    fn settings(&self) -> Result<Settings> {
        Ok(Settings {
            world: self.world.clone(),
            seconds: self.seconds.clone(),
            size: size(&self.size)?,
            upscaler: self.upscaler.clone(),
            device: self.device.parse()?,
            generator: self.generator.parse()?,
            ..Settings::default()
        })
    }
}

impl Subcommand for DemoArgs {
    fn check(&self) -> Result<()> {
        self.settings()?.check()?;
        demo::reconstruct().check().map(drop)
    }

    fn run(&self) -> Result<ExitCode> {
        let settings = self.settings()?;
        if !self.quiet {
            println!("{}", demo::WELCOME);
        }
        let ended = rollout::make(&settings, &self.out, true, self.quiet)?;
        if ended != ExitCode::SUCCESS {
            return Ok(ended);
        }
        if !self.quiet {
            println!("{}", demo::SECOND_PART);
        }
        reconstruct::make(&demo::reconstruct(), &self.out.join(demo::RECONSTRUCT), true, self.quiet)
    }
}
