//! `study demo`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use cairn::world::{GuidanceSource, OperatingPoint, Presentation, Preset};
use clap::Args;

use super::{Subcommand, progress, reconstruct, rollout, size, stop_on_interrupt};
use crate::demo::{self, levels::LevelsFilm};
use crate::settings::Settings;

#[derive(Args)]
pub(super) struct DemoArgs {
    /// Folder for everything that is made; an earlier demo in it is replaced
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    out: PathBuf,
    /// World bundle [default: the one inside the library]
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// World time of the rollout, and of the walk through each level
    #[arg(long, default_value = "4")]
    seconds: String,
    /// Size of the rollout's presented frames
    #[arg(long, value_name = "WxH", default_value = "1920x1080")]
    size: String,
    /// Where the world runs: auto, cpu, d3d12 or webgpu for the best adapter, or d3d12:N or webgpu:N for number N of its list; auto is the
    /// first of d3d12, webgpu and cpu on which the world loads, and says why not an earlier one
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

/// What an interruption leaves of the film.
const FILM_LEFT: &str = "the film ends where it was stopped";

impl DemoArgs {
    /// What the options ask for.
    fn settings(&self) -> Result<Settings> {
        let point = Preset::Coherence.operating_point();
        // The preset's own motion is the paper's.
        let presentation = match point.presentation {
            Presentation::Generated { rate, .. } => Presentation::Generated { rate, guidance: GuidanceSource::BEST },
            native => native,
        };
        Ok(Settings {
            preset: None,
            operating_point: OperatingPoint { presentation, ..point }.to_string(),
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
        let seconds = settings.check()?.duration.seconds();
        let film = LevelsFilm { world: settings.world.as_deref(), device: settings.device, seconds, out: &self.out };
        let files = film.make(&progress(self.quiet), stop_on_interrupt()?)?;
        if !self.quiet {
            files.iter().for_each(|file| println!("  {}", file.display()));
            println!("{}", demo::SECOND_PART);
        }
        let ended = rollout::make(&settings, &self.out, true, self.quiet)?;
        if ended != ExitCode::SUCCESS {
            return Ok(ended);
        }
        if !self.quiet {
            println!("{}", demo::THIRD_PART);
        }
        reconstruct::make(&demo::reconstruct(), &self.out.join(demo::RECONSTRUCT), true, self.quiet)
    }

    fn when_interrupted(&self) -> &'static str {
        FILM_LEFT
    }
}
