//! `study compare`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::{Error, ErrorKind, Result};
use clap::Args;
use scenes::LANDSCAPES;

use super::{CELLS_KEPT, Subcommand, interrupted, progress, size, stop_on_interrupt};
use crate::compare::{self, Settings};
use crate::device::DeviceChoice;
use crate::scene_id::landscape;

pub(super) const EXAMPLES: &str = "\
Examples:
  study compare --smoke --scene forest --out out/smoke
      Every branch for one second at a small size, with the whole report.

  study compare --scene all --out out/paper
      The paper's experiment: four scenes of 15 seconds in five branches. It may be interrupted at any time: the same
      command goes on, and makes nothing again that is whole.

  study compare --scene sword --seeds 3 --out out/sword
      Three places of one kind: figures with intervals.

With --world waypoint.cairn --device d3d12 --generator fsr --size 1920x1080, on Windows, a Radeon and Waypoint's weights, the second
command is the experiment of the paper itself.

A place is drawn by the scenes, none of them is known to the world inside the library, and all branches of a place share seed
picture, control script and seed of the noise:

  coherence          15 anchors a second at g384 with 10 passes, 30 frames a second by generation
  baseline           30 native pictures a second at g128 (forest) or g112 with 9 passes
  baseline-doubled   30 latents a second at the baseline's window
  heavy              g512 with 12 passes, else as coherence: a probe
  decoded-60         the latents of coherence with all four decoded pictures shown

The folder --out has a folder for each place with one for each branch in it, the figures of every frame as series.csv and all streams
side by side as side-by-side.mp4, and the report as report.md with its figures, and in one page with players as report.html. Frames are kept as PNG: about 150 MB
for 15 seconds of a branch at 640x360.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

/// Seconds of world time: the paper's.
const SECONDS: &str = "15";
/// The working size.
const SIZE: [u32; 2] = [640, 360];
/// Seconds and size of `--smoke`.
const SMOKE: (&str, [u32; 2]) = ("1", [320, 180]);

#[derive(Args)]
pub(super) struct CompareArgs {
    /// forest, sword, desert, snow or all
    #[arg(long, value_name = "NAME", default_value = "all")]
    scene: String,
    /// Places of each kind
    #[arg(long, value_name = "N", default_value_t = 1)]
    seeds: u64,
    /// World time [default: 15]
    #[arg(long)]
    seconds: Option<String>,
    /// Size at which everything is compared [default: 640x360]
    #[arg(long, value_name = "WxH")]
    size: Option<String>,
    /// One second at 320x180: whether everything works
    #[arg(long, conflicts_with_all = ["seconds", "size"])]
    smoke: bool,
    /// World bundle, a folder or a .cairn file [default: the one inside the library]
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// Where the world runs: auto, cpu, d3d12 or webgpu for the best adapter, or d3d12:N or webgpu:N
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    device: String,
    /// What makes frames between anchors: cpu, or on Windows shader or fsr, for which AMD's libraries lie in CAIRN_FFX_DIR or beside
    /// this program
    #[arg(long, value_name = "GENERATOR", default_value = "cpu")]
    generator: String,
    /// What takes the world's pictures to that size: lanczos or catmull-rom
    #[arg(long, default_value = "lanczos")]
    upscaler: String,
    /// Threads of a pass; numbers depend on it, a little
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Rollouts made at a time; no number depends on it, but times do [default: one to --threads processors, 1 on a graphics
    /// device]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Leave LPIPS out; its weights are fetched once otherwise (64 MB)
    #[arg(long)]
    no_lpips: bool,
    /// Folder for everything; what is whole in it is kept
    #[arg(long, value_name = "DIR", default_value = "target/compare")]
    out: PathBuf,
    /// Writes the report into this folder too, as report.md with compressed figures and without report.html
    #[arg(long, value_name = "DIR")]
    publish: Option<PathBuf>,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

impl CompareArgs {
    fn settings(&self) -> Result<Settings> {
        let families = match self.scene.as_str() {
            "all" => LANDSCAPES.to_vec(),
            name => vec![landscape(name).ok_or_else(|| {
                Error::new(ErrorKind::InvalidArgument, format!("there is no scene {name:?}"))
                    .field("--scene")
                    .remedy("Use forest, sword, desert, snow or all")
            })?],
        };
        let (seconds, small) = if self.smoke { SMOKE } else { (SECONDS, SIZE) };
        let device: DeviceChoice = self.device.parse()?;
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = match device {
            DeviceChoice::Cpu => (processors / self.threads.max(1)).max(1),
            _ => 1,
        };
        Ok(Settings {
            families,
            scenes_per_family: self.seeds,
            seconds: self.seconds.clone().unwrap_or_else(|| seconds.into()),
            size: self.size.as_deref().map_or(Ok(small), size)?,
            world: self.world.clone(),
            device,
            generator: self.generator.parse()?,
            upscaler: self.upscaler.clone(),
            threads: self.threads,
            lpips: !self.no_lpips,
            jobs: self.jobs.unwrap_or(jobs),
            out: self.out.clone(),
            publish: self.publish.clone(),
        })
    }
}

impl Subcommand for CompareArgs {
    fn check(&self) -> Result<()> {
        self.settings()?.check()
    }

    fn run(&self) -> Result<ExitCode> {
        match compare::run(&self.settings()?, &progress(self.quiet), stop_on_interrupt()?) {
            Ok(outcome) => {
                print!("{}", outcome.text);
                outcome.files.iter().for_each(|file| eprintln!("  {}", file.display()));
                Ok(ExitCode::SUCCESS)
            }
            Err(error) => interrupted(error, CELLS_KEPT),
        }
    }
}
