//! `study rollout`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use cairn::world::{CacheMode, MAX_POINTS, OperatingPoint, Presentation, Preset, Schedule, parse_global_window};
use cairn::{Error, ErrorKind, Result};
use clap::Args;

use super::{Subcommand, encoder_hint, progress, size, status, stop_on_interrupt};
use crate::demo;
use crate::job::{Job, run as run_job};
use crate::settings::{Formats, Settings};
use media::{ASSEMBLY, RealDisk};

#[derive(Args)]
pub(super) struct RolloutArgs {
    /// World bundle, a folder or a .cairn file [default: the one inside the library]
    #[arg(long, value_name = "BUNDLE")]
    world: Option<PathBuf>,
    /// PNG or JPEG of any size; what does not fit the world's aspect is cut off [default: the start of the level of desert]
    #[arg(long, value_name = "FILE")]
    seed_picture: Option<PathBuf>,
    /// Control script [default: four seconds of walking and looking round]
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// Decode the latents that an earlier rollout stored instead of making new ones; picture, script and --seed then decide
    /// nothing
    #[arg(long, value_name = "FILE")]
    latents: Option<PathBuf>,
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
    /// What takes the world's pictures to that size: lanczos, which is spatial, catmull-rom, or on Windows fsr, which makes anchors larger
    /// before frames are generated between them
    #[arg(long, default_value = "lanczos")]
    upscaler: String,
    /// What makes frames between anchors: cpu, or on Windows shader or fsr, for which AMD's libraries lie in CAIRN_FFX_DIR or beside
    /// this program
    #[arg(long, value_name = "GENERATOR", default_value = "cpu")]
    generator: String,
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
    /// Where the world runs: auto, cpu, d3d12 or webgpu for the best adapter, or d3d12:N or webgpu:N for number N of its list; auto is the
    /// first of d3d12, webgpu and cpu on which the world loads, and says why not an earlier one
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    device: String,
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

impl RolloutArgs {
    /// What the options ask for.
    fn settings(&self) -> Result<Settings> {
        let point = operating_point(&self.point)?;
        Ok(Settings {
            world: self.world.clone(),
            seed_picture: self.seed_picture.clone(),
            script: self.script.clone(),
            latents: self.latents.clone(),
            preset: Some(self.point.preset.clone().unwrap_or_else(|| Preset::Coherence.name().into())),
            operating_point: point.to_string(),
            seconds: self.seconds.clone(),
            seed: self.seed,
            size: size(&self.size)?,
            upscaler: self.upscaler.clone(),
            formats: Formats::parse(&self.formats)?,
            threads: self.run.threads,
            device: self.run.device.parse()?,
            generator: self.generator.parse()?,
        })
    }
}

impl Subcommand for RolloutArgs {
    fn check(&self) -> Result<()> {
        self.settings()?.check().map(|_| ())
    }

    fn run(&self) -> Result<ExitCode> {
        make(&self.settings()?, &self.run.out, self.run.overwrite, self.run.quiet)
    }
}

/// Makes a rollout and tells what came of it.
pub(super) fn make(settings: &Settings, out: &Path, overwrite: bool, quiet: bool) -> Result<ExitCode> {
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
        if let Some(why) = &outcome.fallback {
            println!("It ran on {}: {}", outcome.manifest.settings.device, why.cause());
        }
        print!("{}", demo::summary(&outcome, out));
        let seconds = |stage: &str| outcome.manifest.timings.get(stage).copied().unwrap_or(0.0);
        print!("{}", encoder_hint(seconds("recorder"), seconds("total"), ASSEMBLY).unwrap_or_default());
    }
    let counts = &outcome.manifest.counts;
    Ok(status(outcome.failure.as_ref(), outcome.interrupted, [counts.presented, counts.planned], out))
}

/// The preset of that name.
///
/// # Errors
/// `InvalidArgument`.
pub(super) fn preset(name: &str) -> Result<Preset> {
    Preset::from_name(name).ok_or_else(|| {
        let names: Vec<&str> = Preset::ALL.iter().map(|preset| preset.name()).collect();
        Error::new(ErrorKind::InvalidArgument, format!("there is no preset {name:?}"))
            .field("--preset")
            .remedy(format!("Use one of {}", names.join(", ")))
    })
}

/// A preset with single items changed.
fn operating_point(args: &PointArgs) -> Result<OperatingPoint> {
    let preset = args.preset.as_deref().map_or(Ok(Preset::Coherence), preset)?;
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
        point.set_presentation(present).map_err(named("--present"))?;
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

/// What a whole command line asks for, the program's name first.
#[cfg(test)]
pub(crate) fn settings_of(arguments: impl IntoIterator<Item = std::ffi::OsString>) -> Result<Settings> {
    use clap::Parser;
    match super::Cli::try_parse_from(arguments).unwrap_or_else(|e| panic!("{e}")).command {
        super::Command::Rollout(args) => args.settings(),
        _ => unreachable!("another subcommand"),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::{Cli, Command};

    fn point(arguments: &[&str]) -> Result<OperatingPoint> {
        let all = ["study", "rollout"].iter().chain(arguments);
        match Cli::try_parse_from(all).unwrap_or_else(|e| panic!("{e}")).command {
            Command::Rollout(args) => operating_point(&args.point),
            _ => unreachable!(),
        }
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
    }
}
