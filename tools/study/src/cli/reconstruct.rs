//! `study reconstruct`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use cairn::{Error, ErrorKind, Result};
use clap::{Args, ValueEnum};
use scenes::LANDSCAPES;

use super::{Subcommand, encoder_hint, progress, size, status, stop_on_interrupt};
use crate::metrics::{Lpips, Net};
use crate::output::{self, Folder, SHEET};
use crate::progress::duration;
use crate::reconstruct::{
    ANCHOR_RATE, ReconstructOutcome, ReconstructSettings, Reconstruction, TruthOrPicture, reconstruct,
};
use crate::settings::Formats;
use media::{ASSEMBLY, RealDisk};

pub(super) const EXAMPLES: &str = "\
Examples:
  study reconstruct --out out/forest
      Two seconds of forest, from 15 to 60 frames a second, beside the true frames.

  study reconstruct --scene all --seconds 4 --multiplier 6 --out out/all
      All four scenes to 90 frames a second, each in a folder of its own.

  study reconstruct --scene sword --guidance truth --size 1280x720 --out out/sword
      With the scene's own motion and depth, as a renderer gives them.

  study replay out/forest/manifest.json
      Makes the same files again and compares them to the bit.

The folder gets reconstruct.mp4 (what is presented), comparison.mp4 (truth, generated, difference, side by side),
comparison.png (the same of the median and the worst frame), contact-sheet.png, scores.csv (every frame) and manifest.json.

Exit status: 0 well, 1 failed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct ReconstructArgs {
    /// forest, sword, desert, snow, indoors, town, or all for the four landscapes
    #[arg(long, value_name = "SCENE", default_value = "forest")]
    scene: String,
    /// Which place of that kind
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Size of all frames
    #[arg(long, value_name = "WxH", default_value = "640x360")]
    size: String,
    /// World time
    #[arg(long, default_value = "2")]
    seconds: String,
    /// Frames presented for each of the 15 anchors a second: 2 to 8, so that 2, 4 and 6 give 30, 60 and 90
    #[arg(long, value_name = "N", default_value_t = 4)]
    multiplier: u32,
    /// Where motion and depth come from: truth, the scene's own, or picture, optical flow between anchors
    #[arg(long, value_name = "SOURCE", default_value = "picture")]
    guidance: String,
    /// What makes frames between anchors: cpu, or on Windows shader or fsr (two frames to an anchor), for which AMD's libraries lie in
    /// CAIRN_FFX_DIR or beside this program
    #[arg(long, value_name = "GENERATOR", default_value = "cpu")]
    generator: String,
    /// Media of what is presented: any of mp4, png and y4m, with commas between
    #[arg(long, default_value = "mp4")]
    formats: String,
    /// Whether LPIPS is measured: auto, where its weights are there, yes, which fetches them, or no
    #[arg(long, value_enum, value_name = "WHEN", default_value = "auto", hide_possible_values = true)]
    lpips: WhenLpips,
    /// Folder for everything that is made
    #[arg(long, value_name = "DIR", default_value = "target/reconstruct")]
    out: PathBuf,
    /// Replace an earlier one in that folder
    #[arg(long)]
    overwrite: bool,
    /// No progress, no summary
    #[arg(long)]
    quiet: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum WhenLpips {
    Auto,
    Yes,
    No,
}

impl ReconstructArgs {
    /// One to a scene, with the folder for it. `lpips` says whether its weights are there.
    fn settings(&self, lpips: impl FnOnce() -> bool) -> Result<Vec<(PathBuf, ReconstructSettings)>> {
        let guidance = match self.guidance.as_str() {
            "truth" => TruthOrPicture::Truth,
            "picture" => TruthOrPicture::Picture,
            other => {
                return Err(Error::new(ErrorKind::InvalidArgument, format!("{other:?} is no source of motion"))
                    .field("--guidance")
                    .remedy("Use truth or picture"));
            }
        };
        let mut settings = ReconstructSettings {
            scene: self.scene.clone(),
            seed: self.seed,
            size: size(&self.size)?,
            seconds: self.seconds.clone(),
            multiplier: self.multiplier,
            guidance,
            formats: Formats::parse(&self.formats)?,
            lpips: false,
            generator: self.generator.parse()?,
        };
        settings.lpips = match self.lpips {
            WhenLpips::Yes => true,
            WhenLpips::No => false,
            WhenLpips::Auto => settings.size.iter().all(|side| *side >= Net::Alex.smallest_side()) && lpips(),
        };
        let all = if self.scene == "all" {
            let scene = |name: &str| ReconstructSettings { scene: name.to_owned(), ..settings.clone() };
            LANDSCAPES.iter().map(|family| (self.out.join(family.name()), scene(family.name()))).collect()
        } else {
            vec![(self.out.clone(), settings)]
        };
        all.iter().try_for_each(|(_, settings)| settings.check().map(drop))?;
        Ok(all)
    }
}

impl Subcommand for ReconstructArgs {
    fn check(&self) -> Result<()> {
        self.settings(|| false).map(drop)
    }

    fn run(&self) -> Result<ExitCode> {
        let all = self.settings(|| Lpips::find(Net::Alex).is_ok())?;
        // Before the first scene takes its time, not after it.
        all.iter().try_for_each(|(out, _)| Folder::check(out, self.overwrite).map(drop))?;
        for (out, settings) in &all {
            let ended = make(settings, out, self.overwrite, self.quiet)?;
            if ended != ExitCode::SUCCESS {
                return Ok(ended);
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Makes one and says what was made.
pub(super) fn make(settings: &ReconstructSettings, out: &Path, overwrite: bool, quiet: bool) -> Result<ExitCode> {
    let progress = progress(quiet);
    let outcome = reconstruct(&Reconstruction {
        settings,
        out,
        overwrite,
        disk: Arc::new(RealDisk),
        stop: stop_on_interrupt()?,
        progress: &progress,
        limit: None,
    })?;
    if !quiet {
        print!("{}", summary(&outcome, out));
    }
    let counts = &outcome.manifest.counts;
    Ok(status(outcome.failure.as_ref(), outcome.interrupted, [counts.presented, counts.planned], out))
}

/// Says what was made, how near it is to the truth, and what to open.
fn summary(outcome: &ReconstructOutcome, out: &Path) -> String {
    let manifest = &outcome.manifest;
    let (settings, counts) = (&manifest.settings, manifest.counts);
    let took = manifest.timings.get("total").copied().unwrap_or(0.0);
    let mut text = format!(
        "{}, seed {}: {} frames at {} a second from {} anchors at {ANCHOR_RATE} ({} generated, {} across a cut) in {}\n",
        settings.scene,
        settings.seed,
        counts.presented,
        settings.rate(),
        counts.anchors,
        counts.generated,
        counts.cut_fallbacks,
        duration(took),
    );
    if let Some(scores) = manifest.scores {
        let lpips = scores.lpips.map(|value| format!(", LPIPS {value:.4}")).unwrap_or_default();
        text += &format!("  generated against true: PSNR {:.2} dB, SSIM {:.4}{lpips}\n", scores.psnr_db, scores.ssim);
        let at = scores.worst_frame as f64 / f64::from(settings.rate());
        text += &format!(
            "  median {:.2} dB, worst {:.2} dB (frame {}, {at:.3} s); the nearer anchor instead: {:.2} dB\n",
            scores.median_psnr_db, scores.worst_psnr_db, scores.worst_frame, scores.psnr_of_anchor_db
        );
    }
    for (name, what) in [
        (output::reconstruct::VIDEO, "what is presented"),
        (output::reconstruct::COMPARISON_VIDEO, "truth, generated, difference"),
        (output::reconstruct::COMPARISON, "the same of the median and the worst frame"),
        (SHEET, "anchors, generated frames, motion, depth"),
        (output::reconstruct::TABLE, "every frame"),
    ] {
        if manifest.outputs.iter().any(|output| output.path == name) {
            text += &format!("  {}   {what}\n", crate::manifest::absolute(&out.join(name)).display());
        }
    }
    let encoding = manifest.timings.get("encoding").copied().unwrap_or(0.0);
    text += encoder_hint(encoding, took, ASSEMBLY).unwrap_or_default();
    text
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use crate::cli::Cli;

    #[test]
    fn slips_are_named_with_a_remedy() {
        for (arguments, option, remedy) in [
            (["--scene", "moon"], "--scene", "forest"),
            (["--multiplier", "9"], "--multiplier", "2 to 8"),
            (["--guidance", "paper"], "--guidance", "truth or picture"),
            (["--size", "8x8"], "--size", "16 to 8192"),
            (["--seconds", "0.05"], "--seconds", "0.067"),
            (["--formats", "gif"], "--formats", "mp4"),
        ] {
            let all = ["study", "reconstruct"].iter().chain(&arguments);
            let cli = Cli::try_parse_from(all).unwrap_or_else(|e| panic!("{e}"));
            let error = cli.command.inner().check().unwrap_err().to_string();
            assert!(error.contains(option) && error.contains(remedy), "{error}");
        }
    }
}
