//! The command line: code that all subcommands share. Each subcommand has a file of its own.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::{Error, ErrorKind, Result};
use clap::{Parser, Subcommand as Subcommands};

use crate::output::MANIFEST;
use crate::progress::Progress;

mod ablate;
mod cadence;
mod compare;
mod demo;
mod experiment;
mod interpolate;
mod motion;
mod pages;
mod play;
mod quality;
mod reconstruct;
mod replay;
mod rollout;
mod score;
mod seed_picture;
mod sweep;
mod weights;
mod world_quality;

const EXAMPLES: &str = "\
Examples:
  study demo --out target/demo
      A film of the four levels that the embedded world knows, four seconds of the paper's operating point on it, and two
      seconds of frame generation where the truth is known.

  study rollout --preset coherence --seconds 15 --out out/walk
      The same for 15 seconds: 226 anchors, 451 frames.

  study rollout --world waypoint.cairn --seed-picture forest.jpg --script walk.txt \\
                --preset baseline-128 --seconds 15 --seed 7 --out out/forest
      A world of your own, from a picture and a control script of your own.

  study rollout --context g256 --steps 12 --cache interval:4 --anchor-rate 15 --pictures 1 \\
                --present generated:60 --seconds 4 --formats mp4,png --out out/mine
      An operating point of your own.

  study replay out/forest/manifest.json
      Makes the same files again and compares them to the bit.

Exit status: 0 well, 1 failed or differs, 2 wrong usage or unusable input, 130 interrupted.
Pictures of a world with random weights mean nothing; the manifest and the contact sheet say so.";

/// Consequence for a command that writes all its files at the end.
const NOTHING_WRITTEN: &str = "nothing is written";
/// Consequence for a command that keeps finished cells.
const CELLS_KEPT: &str = "finished parts are kept, and the same command continues";

#[derive(Parser)]
#[command(name = "study", version, about = "Runs a world model from a seed picture and a control script to a video", after_help = EXAMPLES)]
struct Cli {
    /// Checks the command line and makes nothing; looks at no file
    #[arg(long, global = true)]
    dry_run: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommands)]
enum Command {
    /// Makes a rollout: anchors, generated frames, video, contact sheet and manifest
    #[command(after_help = EXAMPLES)]
    Rollout(Box<rollout::RolloutArgs>),
    /// Makes the rollout or the reconstruct of a manifest again and says what differs
    Replay(replay::ReplayArgs),
    /// A film of the embedded world's levels, four seconds at 1920x1080, and a short reconstruct
    Demo(demo::DemoArgs),
    /// A window in which you walk through the world by mouse and keyboard
    #[command(after_help = play::EXAMPLES)]
    Play(play::PlayArgs),
    /// The paper's experiment: the same walks, run fewer and better, more often, and in four other ways
    #[command(after_help = compare::EXAMPLES)]
    Compare(compare::CompareArgs),
    /// Generates frames between true anchors of a scene, and shows how near they are to the true frames
    #[command(after_help = reconstruct::EXAMPLES)]
    Reconstruct(reconstruct::ReconstructArgs),
    /// Generated frames against true ones, beside other ways to make them
    #[command(after_help = quality::EXAMPLES)]
    Quality(quality::QualityArgs),
    /// What each rule of the generator gains: frames made without it, against the true ones
    #[command(after_help = ablate::EXAMPLES)]
    Ablate(ablate::AblateArgs),
    /// Which motion is best: every source of motion and depth against the scenes' truth, and the frames made with each
    #[command(after_help = motion::EXAMPLES)]
    Motion(motion::MotionArgs),
    /// From 10 anchors a second to 60 frames, beside 15 to 60, 15 to 30 and 30 to 60, against the truth at every moment
    #[command(after_help = cadence::EXAMPLES)]
    Cadence(cadence::CadenceArgs),
    /// Operating points against each other: coherence against compute, and the best point for a budget
    #[command(after_help = sweep::EXAMPLES)]
    Sweep(sweep::SweepArgs),
    /// A world against the truth of the scenes: how near, how it follows the controls, what it remembers
    #[command(after_help = world_quality::EXAMPLES)]
    WorldQuality(world_quality::WorldQualityArgs),
    /// A world beside the same one with weights in 8 or 4 bits, in rollouts of a minute
    #[command(after_help = weights::EXAMPLES)]
    Weights(weights::WeightsArgs),
    /// Makes more frames a second of a video, or of a folder of pictures
    #[command(after_help = interpolate::EXAMPLES)]
    Interpolate(interpolate::InterpolateArgs),
    /// How near pictures are to the true ones: PSNR, SSIM and LPIPS
    #[command(after_help = score::EXAMPLES)]
    Score(score::ScoreArgs),
    /// Which published pages were made by today's generator, and which by an older one
    Pages(pages::PagesArgs),
    /// Writes the built-in seed picture, to paint over or to compare with
    SeedPicture(seed_picture::SeedPictureArgs),
}

/// Interface of every subcommand.
trait Subcommand {
    /// Checks everything in the options that needs no file. Fails with the same messages as [`run`](Self::run) would.
    fn check(&self) -> Result<()> {
        Ok(())
    }

    /// Runs the subcommand. An error `Cancelled` says that it was interrupted.
    fn run(&self) -> Result<ExitCode>;

    /// What an interruption leaves.
    fn when_interrupted(&self) -> &'static str {
        NOTHING_WRITTEN
    }
}

impl Command {
    fn inner(&self) -> &dyn Subcommand {
        match self {
            Self::Rollout(args) => args.as_ref(),
            Self::Replay(args) => args,
            Self::Demo(args) => args,
            Self::Play(args) => args,
            Self::Compare(args) => args,
            Self::Reconstruct(args) => args,
            Self::Quality(args) => args,
            Self::Ablate(args) => args,
            Self::Motion(args) => args,
            Self::Cadence(args) => args,
            Self::Sweep(args) => args,
            Self::WorldQuality(args) => args,
            Self::Weights(args) => args,
            Self::Interpolate(args) => args,
            Self::Score(args) => args,
            Self::Pages(args) => args,
            Self::SeedPicture(args) => args,
        }
    }
}

#[cfg(test)]
pub(crate) use rollout::settings_of as rollout_settings;

/// Runs the program with its arguments, the first of which is its name.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let command = cli.command.inner();
    let done = if cli.dry_run { command.check().map(|()| ExitCode::SUCCESS) } else { command.run() };
    done.unwrap_or_else(|error| {
        let code = match error.kind() {
            ErrorKind::Cancelled => {
                eprintln!("interrupted: {}", command.when_interrupted());
                return ExitCode::from(130);
            }
            ErrorKind::InvalidArgument => 2,
            _ => 1,
        };
        eprintln!("error: {error}");
        ExitCode::from(code)
    })
}

fn progress(quiet: bool) -> Progress {
    if quiet { Progress::quiet() } else { Progress::console() }
}

/// Reads `1920x1080`. The range is checked with the rest of the settings.
fn size(text: &str) -> Result<[u32; 2]> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sides.ok_or_else(|| {
        Error::new(ErrorKind::InvalidArgument, format!("{text:?} is no size"))
            .field("--size")
            .remedy("Write width and height in pixels, such as 1920x1080")
    })
}

/// A flag that Ctrl-C sets, the same one for all parts of a command. A second Ctrl-C ends the program at once.
fn stop_on_interrupt() -> Result<&'static AtomicBool> {
    static STOP: AtomicBool = AtomicBool::new(false);
    static WATCHING: OnceLock<std::result::Result<(), String>> = OnceLock::new();
    let watch = || {
        ctrlc::set_handler(|| {
            if STOP.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
            eprintln!("\nfinishing the current frame; press Ctrl-C again to end at once");
        })
        .map_err(|e| format!("Ctrl-C cannot be caught: {e}"))
    };
    WATCHING.get_or_init(watch).clone().map_err(|cause| Error::new(ErrorKind::Unsupported, cause))?;
    Ok(&STOP)
}

/// Prints the written files to standard error, and the summary to standard output.
fn print_outcome(text: &str, files: &[PathBuf]) {
    files.iter().for_each(|file| eprintln!("  {}", file.display()));
    print!("{text}");
}

/// Exit status of a command that leaves a manifest in `out`. Prints a message if it did not finish. `frames`: complete, planned.
fn status(failure: Option<&Error>, interrupted: bool, [complete, planned]: [u64; 2], out: &Path) -> ExitCode {
    if let Some(error) = failure {
        eprintln!("error: {error}");
        eprintln!(
            "{complete} of {planned} frames are complete; {} says which files are whole",
            out.join(MANIFEST).display()
        );
        return ExitCode::from(1);
    }
    if interrupted {
        eprintln!("interrupted: what is finished is kept, and the manifest says \"complete\": false");
        return ExitCode::from(130);
    }
    ExitCode::SUCCESS
}

/// Hint for when video encoding took most of the time although an encoder with assembly kernels would take a fifth of it.
/// Both times are in seconds.
fn encoder_hint(encoding: f64, total: f64, assembly: bool) -> Option<&'static str> {
    (!assembly && encoding > 5.0 && 2.0 * encoding > total).then_some(
        "hint: most of the time went into encoding; with nasm on the path, \"cargo run --release -p study --features asm\" \
         encodes about five times as fast, the same bytes\n",
    )
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_size_is_two_numbers() {
        assert_eq!(size("1920x1080").unwrap(), [1920, 1080]);
        for text in ["1920", "1920x", "x1080", "-1x5", "99999999999x5"] {
            assert!(size(text).unwrap_err().to_string().contains("1920x1080"));
        }
    }

    #[test]
    fn the_hint_comes_where_it_helps() {
        assert!(encoder_hint(30.0, 40.0, false).is_some_and(|hint| hint.contains("--features asm")));
        for (encoding, total, assembly) in [(30.0, 40.0, true), (30.0, 80.0, false), (2.0, 3.0, false)] {
            assert_eq!(encoder_hint(encoding, total, assembly), None);
        }
    }

    #[test]
    fn every_example_in_the_help_parses() {
        let all = [
            EXAMPLES,
            compare::EXAMPLES,
            reconstruct::EXAMPLES,
            quality::EXAMPLES,
            ablate::EXAMPLES,
            motion::EXAMPLES,
            cadence::EXAMPLES,
            sweep::EXAMPLES,
            interpolate::EXAMPLES,
            score::EXAMPLES,
            play::EXAMPLES,
        ];
        let joined = all.join("\n").replace("\\\n", " ");
        let examples: Vec<&str> = joined.lines().map(str::trim).filter(|l| l.starts_with("study ")).collect();
        assert!(examples.len() >= 27);
        for example in examples {
            let parsed = Cli::try_parse_from(example.split_whitespace()).unwrap_or_else(|e| panic!("{example}: {e}"));
            parsed.command.inner().check().unwrap_or_else(|e| panic!("{example}: {e}"));
        }
    }
}
