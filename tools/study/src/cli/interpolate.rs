//! `study interpolate`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use cairn::Result;
use clap::Args;

use super::{Subcommand, encoder_hint, progress, stop_on_interrupt};
use crate::generator::GeneratorChoice;
use crate::interpolate::{self, Interpolation, Report, interpolate};
use crate::progress::duration;
use media::{ASSEMBLY, FrameRate, RealDisk};

pub(super) const EXAMPLES: &str = "\
Examples:
  study interpolate walk.y4m --multiplier 4
      Makes walk-4x.mp4 beside it, with four times the frames a second.

  study interpolate shots/ --rate 15 --multiplier 2 --out smooth.mp4
      From a folder of pictures: 1.png, 2.png, ... 10.png, or any other names with numbers.

  study interpolate film.mkv --multiplier 2 --out film.y4m
      From any video that an ffmpeg can read: one on the path, or the one that CAIRN_FFMPEG names.

The length stays: the last frame is shown for the time of all frames that would follow it. Across a cut nothing is
generated: the nearer frame is shown. Frames of the video itself stand where they stood, as 8-bit colour. Sound is left
aside. Interlaced video and Y4M of more than 8 bits are refused; the message says how to convert them.

Exit status: 0 well, 1 failed (what was made until then can be played), 2 wrong usage or unusable input,
130 interrupted.";

#[derive(Args)]
pub(super) struct InterpolateArgs {
    /// A Y4M file, a folder of PNG or JPEG pictures, or any video where there is an ffmpeg
    input: PathBuf,
    /// Frames to make of each: 2 to 16
    #[arg(long, value_name = "N", default_value_t = 2)]
    multiplier: u32,
    /// File that ends in .mp4 (AV1) or .y4m, or a folder for PNG pictures [default: INPUT-Nx.mp4, beside it]
    #[arg(long, value_name = "FILE|DIR")]
    out: Option<PathBuf>,
    /// Frames per second of the input, such as 15 or 30000/1001 [default: what it says; 30 for a folder]
    #[arg(long, value_name = "RATE")]
    rate: Option<String>,
    /// What makes frames between two: cpu, or on Windows shader or fsr (two of each), for which AMD's libraries lie in CAIRN_FFX_DIR or
    /// beside this program
    #[arg(long, value_name = "GENERATOR", default_value = "cpu")]
    generator: String,
    /// Replace an earlier output
    #[arg(long)]
    overwrite: bool,
    /// No progress, no summary
    #[arg(long)]
    quiet: bool,
}

impl InterpolateArgs {
    fn rate(&self) -> Result<Option<FrameRate>> {
        self.rate.as_deref().map(|text| FrameRate::parse(text).map_err(|e| e.field("--rate"))).transpose()
    }
}

impl Subcommand for InterpolateArgs {
    fn check(&self) -> Result<()> {
        interpolate::check(self.multiplier, self.rate()?, self.out.as_deref())?;
        self.generator.parse::<GeneratorChoice>()?.check_multiplier(self.multiplier)
    }

    fn run(&self) -> Result<ExitCode> {
        let progress = progress(self.quiet);
        let report = interpolate(&Interpolation {
            input: &self.input,
            multiplier: self.multiplier,
            rate: self.rate()?,
            generator: self.generator.parse()?,
            out: self.out.as_deref(),
            overwrite: self.overwrite,
            disk: Arc::new(RealDisk),
            stop: stop_on_interrupt()?,
            progress: &progress,
        })?;
        if !self.quiet {
            print!("{}", summary(&report));
        }
        Ok(status(&report))
    }
}

fn status(report: &Report) -> ExitCode {
    let kept = || {
        if report.has_output {
            format!("the {} frames until then are in {}", report.frames_out, report.out.display())
        } else {
            "nothing was kept".to_owned()
        }
    };
    match &report.failure {
        Some(error) => {
            eprintln!("error: {error}\n{}", kept());
            ExitCode::from(1)
        }
        None if report.interrupted => {
            eprintln!("interrupted: {}", kept());
            ExitCode::from(130)
        }
        None => ExitCode::SUCCESS,
    }
}

fn summary(report: &Report) -> String {
    let Report { size: (width, height), frames_in, frames_out, generated, cuts, repeats, .. } = report;
    let mut text = format!(
        "{frames_in} frames at {} a second became {frames_out} at {} a second, {width} x {height}, in {}\n\
         {generated} generated; {cuts} cuts found, {repeats} repeated frames\n",
        report.rate,
        report.new_rate,
        duration(report.total.as_secs_f64()),
    );
    for (stage, time) in &report.stages {
        let each = time.as_secs_f64() / (*frames_out).max(1) as f64;
        text += &format!("  {stage:<10} {each:>8.4} s a frame\n");
    }
    text += &format!("  {:<10} {:>8.4} s a frame; the stages work side by side\n", "on the clock", {
        report.total.as_secs_f64() / (*frames_out).max(1) as f64
    });
    for note in &report.notes {
        text += &format!("note: {note}\n");
    }
    if report.has_output {
        text += &format!("{}\n", crate::manifest::absolute(&report.out).display());
    }
    // PNG pictures are encoded too, and no assembly helps them.
    if report.out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mp4")) {
        let encoding =
            report.stages.iter().find(|(stage, _)| *stage == "encoding").map_or(0.0, |(_, t)| t.as_secs_f64());
        text += encoder_hint(encoding, report.total.as_secs_f64(), ASSEMBLY).unwrap_or_default();
    }
    text
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use crate::cli::Cli;

    #[test]
    fn slips_are_named_with_a_remedy() {
        for (arguments, option, remedy) in [
            (["--multiplier", "1"], "--multiplier", "2 to 16"),
            (["--multiplier", "17"], "--multiplier", "2 to 16"),
            (["--rate", "fast"], "--rate", "30000/1001"),
            (["--generator", "best"], "--generator", "cpu, shader or fsr"),
            (["--rate", "900"], "--rate", "960"),
            (["--out", "clip.avi"], "--out", ".y4m"),
        ] {
            let all = ["study", "interpolate", "clip.y4m"].iter().chain(&arguments);
            let cli = Cli::try_parse_from(all).unwrap_or_else(|e| panic!("{e}"));
            let error = cli.command.inner().check().unwrap_err().to_string();
            assert!(error.contains(option) && error.contains(remedy), "{error}");
        }
    }
}
