//! `study play`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::world::{OperatingPoint, WorldTime};
use cairn::{Error, ErrorKind, Result};
use clap::Args;
use scenes::{Family, LANDSCAPES};

use super::{Subcommand, size};
use crate::play::playback::MULTIPLIERS;
use crate::play::{self, PlayOptions};

/// Examples, and the keys, which a test holds against [`HELP`](play::controls::HELP).
pub(super) const EXAMPLES: &str = "\
Keys:
  W A S D, arrows   walk
  Shift             run
  mouse             look round: click to capture it, or drag
  1 2 3 4           forest, meadow, desert, snow
  F                 between anchors: generated frames, the world's own, none
  + -               more or fewer generated frames
  G                 picture, motion, depth
  T                 graph of frame times
  R                 start a recording, or stop and write it
  P                 pause
  Backspace         start the level again
  H                 help: line, all keys, nothing
  Esc               free the mouse; quit if it is free

A recording is the whole walk since the start of the level, as a control script. The world is shown in real time if this machine keeps up,
else in slow motion; the line at the top says how fast.

Examples:
  study play --level snow
      Walks through the snow.

  study play --preset coherence --multiplier 24
      More denoise passes for each latent, and slow motion in small steps.

  study play --replay target/play/walk-forest-1.txt
      Repeats a recorded walk, says whether its latents are the same bits, and goes on with your controls.";

#[derive(Args)]
pub(super) struct PlayArgs {
    /// forest, sword (the meadow), desert or snow [default: forest, or that of the replayed walk]
    #[arg(long, value_name = "LEVEL")]
    level: Option<String>,
    /// World bundle, a folder or a .cairn file [default: the one inside the library]
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// A preset or an operating point, such as stock, coherence or stock,g64 [default: stock, or that of the replayed walk]
    #[arg(long, value_name = "POINT")]
    preset: Option<String>,
    /// Frames shown for each anchor at first: 1, 2, 3, 4, 6, 8, 12, 16 or 24
    #[arg(long, value_name = "N", default_value_t = 4)]
    multiplier: u32,
    /// Seed of the noise [default: 1, or that of the replayed walk]
    #[arg(long)]
    seed: Option<u64>,
    /// Where the world runs: auto, cpu, d3d12 or webgpu for the best adapter, or d3d12:N or webgpu:N for number N of its list
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: String,
    /// Threads of a pass; the same number gives the same bits [default: one to a physical core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Size of the window
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: String,
    /// Closes the window after this much world time
    #[arg(long)]
    seconds: Option<String>,
    /// A recorded walk, or any control script, that is repeated before your controls count
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// Records from the start, as the key R does
    #[arg(long)]
    record: bool,
    /// Folder for recordings
    #[arg(long, value_name = "DIR", default_value = "target/play")]
    out: PathBuf,
    /// Draws nothing over the picture at first; the key H does the same
    #[arg(long)]
    plain: bool,
    /// Shows anchors only at first; the key F changes it
    #[arg(long)]
    anchors: bool,
}

impl PlayArgs {
    /// The options, with those of a replayed walk where none are given.
    fn options(&self, replay: Option<play::WalkFile>) -> Result<PlayOptions> {
        let invalid = |field: &str, cause: String, remedy: String| {
            Error::new(ErrorKind::InvalidArgument, cause).field(field).remedy(remedy)
        };
        let recorded = |value: fn(&play::WalkFile) -> Option<String>| replay.as_ref().and_then(value);
        let level = self.level.clone().or(recorded(|walk| walk.level.clone()));
        let level = level.map_or(Ok(Family::Forest), |name| {
            let found = LANDSCAPES.into_iter().find(|family| family.name() == name);
            found.ok_or_else(|| {
                let names = LANDSCAPES.map(Family::name).join(", ");
                invalid("--level", format!("there is no level {name:?}"), format!("Use one of {names}"))
            })
        })?;
        let point = self.preset.clone().or(recorded(|walk| walk.operating_point.clone()));
        let point: OperatingPoint =
            point.as_deref().unwrap_or("stock").parse().map_err(|e: Error| e.field("--preset"))?;
        if !MULTIPLIERS.contains(&self.multiplier) {
            return Err(invalid(
                "--multiplier",
                format!("{} frames cannot be shown for an anchor", self.multiplier),
                format!("Use one of {MULTIPLIERS:?}"),
            ));
        }
        let size = size(&self.size)?;
        if size.iter().any(|side| !(16..=8192).contains(side)) {
            return Err(invalid("--size", "no window has this size".into(), "Use sides from 16 to 8192".into()));
        }
        let seconds = self.seconds.as_deref().map(WorldTime::parse).transpose().map_err(|e| e.field("--seconds"))?;
        let rate = point.latents_per_second;
        Ok(PlayOptions {
            world: self.world.clone(),
            level,
            multiplier: self.multiplier,
            seed: self.seed.or(replay.as_ref().and_then(|walk| walk.seed)).unwrap_or(1),
            device: self.device.parse()?,
            threads: self.threads,
            size,
            latents: seconds.map(|time| time.covering_steps(rate)),
            point,
            replay,
            out: self.out.clone(),
            record: self.record,
            plain: self.plain,
            anchors: self.anchors,
        })
    }
}

impl Subcommand for PlayArgs {
    fn check(&self) -> Result<()> {
        self.options(None).map(drop)
    }

    fn run(&self) -> Result<ExitCode> {
        let replay = self.replay.as_deref().map(play::WalkFile::read).transpose()?;
        play::run(self.options(replay)?).map(|()| ExitCode::SUCCESS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_teaches_every_key() {
        for (key, action) in play::controls::HELP {
            assert!(EXAMPLES.contains(&format!("  {key:<17} {action}\n")), "{key} {action}");
        }
    }
}
