//! The command line.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::world::{CacheMode, MAX_POINTS, OperatingPoint, Presentation, Preset, Schedule, parse_global_window};
use cairn::{Error, ErrorKind, Result};
use clap::{Args, Parser, Subcommand};

use crate::demo;
use crate::inputs::Overrides;
use crate::job::{Job, Outcome, run as run_job};
use crate::landscape;
use crate::media::{RealDisk, encode_png, write_whole};
use crate::output::MANIFEST;
use crate::progress::Progress;
use crate::replay::{Replay, replay};
use crate::settings::{Formats, Settings};

const EXAMPLES: &str = "\
Examples:
  study demo --out target/demo
      Four seconds of the paper's operating point on a small world with random weights.

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

#[derive(Parser)]
#[command(name = "study", version, about = "Runs a world model from a seed picture and a control script to a video", after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Makes a rollout: anchors, generated frames, video, contact sheet and manifest
    #[command(after_help = EXAMPLES)]
    Rollout(Box<RolloutArgs>),
    /// Makes the rollout of a manifest again and says what differs
    Replay(ReplayArgs),
    /// Four seconds at 1920x1080 on the demo's world
    Demo(DemoArgs),
    /// Writes the built-in seed picture, to paint over or to compare with
    SeedPicture {
        /// The PNG file to write
        #[arg(long, value_name = "FILE", default_value = "seed.png")]
        out: PathBuf,
        /// Its width and height
        #[arg(long, value_name = "WxH", default_value = "1280x720")]
        size: String,
    },
}

#[derive(Args)]
struct RolloutArgs {
    /// World bundle, a folder or a .cairn file [default: the demo's world, built where it is missing]
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// PNG or JPEG of any size; what does not fit the world's aspect is cut off [default: a painted landscape]
    #[arg(long, value_name = "FILE")]
    seed_picture: Option<PathBuf>,
    /// Control script [default: four seconds of walking and looking round]
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    #[command(flatten)]
    point: PointArgs,
    /// World time
    #[arg(long, default_value = "4")]
    seconds: String,
    /// Seed of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Size of the presented frames
    #[arg(long, value_name = "WxH", default_value = "1920x1080")]
    size: String,
    /// What takes the world's pictures to that size: lanczos or catmull-rom
    #[arg(long, default_value = "lanczos")]
    upscaler: String,
    /// Any of mp4, png and y4m, with commas between
    #[arg(long, default_value = "mp4")]
    formats: String,
    #[command(flatten)]
    run: RunArgs,
}

#[derive(Args)]
struct PointArgs {
    /// coherence, baseline-128, baseline-112, baseline-doubled, decoded-60, heavy or stock [default: coherence];
    /// the options below change single items of it
    #[arg(long)]
    preset: Option<String>,
    /// Global window in latents, such as g384
    #[arg(long, value_name = "G")]
    context: Option<String>,
    /// Denoise passes of a refined schedule; short for --schedule refined:N
    #[arg(long, value_name = "N", conflicts_with = "schedule")]
    steps: Option<u32>,
    /// stock, refined:N, or explicit:1:0.8:0.4:0
    #[arg(long)]
    schedule: Option<String>,
    /// separate, fused or interval:K
    #[arg(long, value_name = "MODE")]
    cache: Option<String>,
    /// Latents per second of world time
    #[arg(long, value_name = "RATE")]
    anchor_rate: Option<u32>,
    /// Decoded pictures used of each latent: 1, 2 or 4
    #[arg(long, value_name = "N")]
    pictures: Option<u32>,
    /// native, or generated:RATE with the frames presented per second
    #[arg(long, value_name = "HOW")]
    present: Option<String>,
    /// Where motion and depth of generated frames come from: paper, from latents, or picture, optical flow between
    /// anchors
    #[arg(long, value_name = "SOURCE")]
    guidance: Option<String>,
}

#[derive(Args)]
struct RunArgs {
    /// Threads of a pass; the same number gives the same bits [default: one to a physical core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Folder for everything that is made
    #[arg(long, value_name = "DIR", default_value = "target/study")]
    out: PathBuf,
    /// Replace an earlier rollout in that folder
    #[arg(long)]
    overwrite: bool,
    /// No progress, no summary
    #[arg(long)]
    quiet: bool,
}

#[derive(Args)]
struct ReplayArgs {
    /// The manifest.json of the rollout
    manifest: PathBuf,
    /// Folder for what is made again [default: replay, beside the manifest]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace an earlier replay in that folder
    #[arg(long)]
    overwrite: bool,
    /// Where the world is now
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// Where the seed picture is now
    #[arg(long, value_name = "FILE")]
    seed_picture: Option<PathBuf>,
    /// Where the script is now
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

#[derive(Args)]
struct DemoArgs {
    /// Folder for everything that is made; an earlier demo in it is replaced
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    out: PathBuf,
    /// World bundle [default: the demo's world, built where it is missing]
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// World time
    #[arg(long, default_value = "4")]
    seconds: String,
    /// Size of the presented frames
    #[arg(long, value_name = "WxH", default_value = "1920x1080")]
    size: String,
    /// No progress, no summary
    #[arg(long)]
    quiet: bool,
}

/// Runs the program with its arguments, the first of which is its name.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let done = match cli.command {
        Command::Rollout(args) => rollout(&args),
        Command::Replay(args) => compare(&args),
        Command::Demo(args) => demonstrate(args),
        Command::SeedPicture { out, size } => paint(&out, &size),
    };
    done.unwrap_or_else(|error| {
        eprintln!("error: {error}");
        ExitCode::from(if error.kind() == ErrorKind::InvalidArgument { 2 } else { 1 })
    })
}

fn rollout(args: &RolloutArgs) -> Result<ExitCode> {
    let point = operating_point(&args.point)?;
    let settings = Settings {
        world: args.world.clone(),
        seed_picture: args.seed_picture.clone(),
        script: args.script.clone(),
        preset: Some(args.point.preset.clone().unwrap_or_else(|| Preset::Coherence.name().into())),
        operating_point: point.to_string(),
        seconds: args.seconds.clone(),
        seed: args.seed,
        size: size(&args.size)?,
        upscaler: args.upscaler.clone(),
        formats: Formats::parse(&args.formats)?,
        threads: args.run.threads,
    };
    make(&settings, &args.run.out, args.run.overwrite, args.run.quiet)
}

fn demonstrate(args: DemoArgs) -> Result<ExitCode> {
    let settings =
        Settings { world: args.world, seconds: args.seconds, size: size(&args.size)?, ..Settings::default() };
    if !args.quiet {
        println!("{}", demo::WELCOME);
    }
    make(&settings, &args.out, true, args.quiet)
}

/// Makes a rollout and tells what came of it.
fn make(settings: &Settings, out: &std::path::Path, overwrite: bool, quiet: bool) -> Result<ExitCode> {
    let progress = progress(quiet);
    let outcome = run_job(&Job {
        settings,
        out,
        overwrite,
        disk: Arc::new(RealDisk),
        stop: stop_on_interrupt()?,
        progress: &progress,
        limit: None,
    })?;
    if !quiet {
        if let Some(note) = &outcome.manifest.note {
            println!("{note}");
        }
        print!("{}", demo::summary(&outcome, out));
    }
    Ok(status(&outcome, out))
}

fn status(outcome: &Outcome, out: &std::path::Path) -> ExitCode {
    if let Some(error) = &outcome.failure {
        eprintln!("error: {error}");
        eprintln!(
            "{} of {} frames are complete; {} says which files are whole",
            outcome.manifest.counts.presented,
            outcome.manifest.counts.planned,
            out.join(MANIFEST).display()
        );
        return ExitCode::from(1);
    }
    if outcome.interrupted {
        eprintln!("interrupted: what is finished is kept, and the manifest says \"complete\": false");
        return ExitCode::from(130);
    }
    ExitCode::SUCCESS
}

fn compare(args: &ReplayArgs) -> Result<ExitCode> {
    let progress = progress(args.quiet);
    let compared = replay(&Replay {
        manifest: &args.manifest,
        out: args.out.as_deref(),
        overwrite: args.overwrite,
        overrides: Overrides {
            world: args.world.clone(),
            seed_picture: args.seed_picture.clone(),
            script: args.script.clone(),
        },
        stop: stop_on_interrupt()?,
        progress: &progress,
    })?;
    for difference in &compared.differences {
        println!("{difference}");
    }
    for path in &compared.skipped {
        println!("output {path}: not whole in the first rollout, not compared");
    }
    if compared.interrupted {
        eprintln!("interrupted before there was something to compare");
        return Ok(ExitCode::from(130));
    }
    if compared.differences.iter().any(crate::Difference::is_failure) {
        println!("The replay is NOT the same.");
        return Ok(ExitCode::from(1));
    }
    println!("The replay is the same: {} files are equal to the bit ({}).", compared.equal, compared.out.display());
    Ok(ExitCode::SUCCESS)
}

fn paint(out: &std::path::Path, text: &str) -> Result<ExitCode> {
    let [width, height] = size(text)?;
    let picture = landscape::paint(width, height).map_err(|e| e.field("--size"))?;
    write_whole(&RealDisk, out, &encode_png(&picture)?)?;
    println!("{}", out.display());
    Ok(ExitCode::SUCCESS)
}

fn progress(quiet: bool) -> Progress {
    if quiet { Progress::quiet() } else { Progress::console() }
}

/// A preset with single items changed.
fn operating_point(args: &PointArgs) -> Result<OperatingPoint> {
    let preset = match args.preset.as_deref() {
        None => Preset::Coherence,
        Some(name) => Preset::from_name(name).ok_or_else(|| {
            let names: Vec<&str> = Preset::ALL.iter().map(|preset| preset.name()).collect();
            Error::new(ErrorKind::InvalidArgument, format!("there is no preset {name:?}"))
                .field("--preset")
                .remedy(format!("Use one of {}", names.join(", ")))
        })?,
    };
    let mut point = preset.operating_point();
    let named = |option: &'static str| move |error: Error| error.field(option);
    if let Some(context) = &args.context {
        point.global_window = parse_global_window(context).map_err(named("--context"))?;
    }
    if let Some(steps) = args.steps {
        if !(4..MAX_POINTS as u32).contains(&steps) {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a refined schedule cannot have {steps} steps"),
            )
            .field("--steps")
            .remedy(format!("Use 4 to {}, or --schedule explicit:...", MAX_POINTS - 1)));
        }
        point.schedule = Schedule::Refined(steps);
    }
    if let Some(schedule) = &args.schedule {
        point.schedule = schedule.parse().map_err(named("--schedule"))?;
    }
    if let Some(cache) = &args.cache {
        point.cache_mode = cache.parse::<CacheMode>().map_err(named("--cache"))?;
    }
    if let Some(rate) = args.anchor_rate {
        point.latents_per_second = rate;
    }
    if let Some(pictures) = args.pictures {
        point.pictures_per_latent = pictures;
    }
    if let Some(present) = &args.present {
        point.present(present).map_err(named("--present"))?;
    }
    if let Some(text) = &args.guidance {
        let source = text.parse().map_err(named("--guidance"))?;
        let Presentation::Generated { guidance, .. } = &mut point.presentation else {
            return Err(Error::new(ErrorKind::InvalidArgument, "nothing is generated that could be guided")
                .field("--guidance")
                .remedy("Use it with --present generated:RATE"));
        };
        *guidance = source;
    }
    point.check()?;
    Ok(point)
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

/// A flag that Ctrl-C sets. A second Ctrl-C ends the program at once.
fn stop_on_interrupt() -> Result<&'static AtomicBool> {
    static STOP: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
        eprintln!("\nfinishing the current frame; press Ctrl-C again to end at once");
    })
    .map_err(|e| Error::new(ErrorKind::Unsupported, format!("Ctrl-C cannot be caught: {e}")))?;
    Ok(&STOP)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn point(arguments: &[&str]) -> Result<OperatingPoint> {
        let all = ["study", "rollout"].iter().chain(arguments);
        match Cli::try_parse_from(all).unwrap_or_else(|e| panic!("{e}")).command {
            Command::Rollout(args) => operating_point(&args.point),
            _ => unreachable!(),
        }
    }

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_preset_is_changed_item_by_item() {
        assert_eq!(point(&[]).unwrap(), Preset::Coherence.operating_point());
        let mine =
            point(&["--preset", "stock", "--context", "g256", "--steps", "12", "--cache", "interval:4"]).unwrap();
        assert_eq!(mine.to_string(), "g256,refined:12,interval:4,latents:15,pictures:4,native");
        let mine = point(&["--anchor-rate", "10", "--pictures", "1", "--present", "generated:60"]).unwrap();
        assert_eq!((mine.latents_per_second, mine.presented_rate()), (10, 60));
        let shown = |arguments: &[&str]| point(arguments).unwrap().presentation.to_string();
        assert_eq!(shown(&["--present", "generated:60"]), "generated:60:paper");
        assert_eq!(shown(&["--guidance", "picture"]), "generated:30:picture");
        assert_eq!(shown(&["--present", "generated:60:picture"]), "generated:60:picture");
        let stock = ["--preset", "stock", "--pictures", "1", "--present", "generated:60"];
        assert_eq!(shown(&stock), "generated:60:picture");
    }

    #[test]
    fn slips_are_named_with_a_remedy() {
        for (arguments, option, remedy) in [
            (["--preset", "best"], "--preset", "baseline-112"),
            (["--cache", "sometimes"], "--cache", "interval"),
            (["--context", "all"], "--context", "g384"),
            (["--present", "fast"], "--present", "native"),
            (["--guidance", "guess"], "--guidance", "picture"),
            (["--schedule", "quick"], "--schedule", "refined"),
        ] {
            let error = point(&arguments).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidArgument);
            let text = error.to_string();
            assert!(text.contains(option) && text.contains(remedy), "{text}");
        }
        let idle = point(&["--preset", "stock", "--guidance", "picture"]).unwrap_err();
        assert_eq!(idle.offending_field(), Some("--guidance"));
        for text in ["1920", "1920x", "x1080", "-1x5", "99999999999x5"] {
            assert!(size(text).unwrap_err().to_string().contains("1920x1080"));
        }
    }

    #[test]
    fn every_example_in_the_help_parses() {
        let joined = EXAMPLES.replace("\\\n", " ");
        let examples: Vec<&str> = joined.lines().map(str::trim).filter(|l| l.starts_with("study ")).collect();
        assert!(examples.len() >= 5);
        for example in examples {
            let parsed = Cli::try_parse_from(example.split_whitespace()).unwrap_or_else(|e| panic!("{example}: {e}"));
            if let Command::Rollout(args) = parsed.command {
                operating_point(&args.point).unwrap_or_else(|e| panic!("{example}: {e}"));
            }
        }
    }
}
