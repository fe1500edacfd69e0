//! ffmpeg's `minterpolate` filter.

use std::path::PathBuf;
use std::process::Command;

use cairn::{Error, ErrorKind, Picture, Result};
use provision::Progress;

use super::program::{Scratch, not_provided, read_pictures, run};
use super::{Interval, Row};
use crate::quality::clips::Phase;

/// Chosen on the scenes' seed for tuning, see `study quality --tune minterpolate`: overlapped blocks of 8.
pub(in crate::quality) const SETTINGS: &str = "mi_mode=mci:mc_mode=aobmc:me_mode=bilat:vsbmc=1:mb_size=8";
/// Conversion to the filter's YUV, lossless except for rounding: full range, full chroma.
const TO_YUV: &str = "scale=out_color_matrix=bt709:out_range=full:flags=accurate_rnd+full_chroma_int,format=yuv444p";
const TO_RGB: &str = "scale=in_color_matrix=bt709:in_range=full:flags=accurate_rnd+full_chroma_int,format=rgb24";
/// Nominal anchors a second; the filter's pictures do not depend on it.
const RATE: u32 = 15;

pub(in crate::quality) struct Minterpolate {
    pub(in crate::quality) program: PathBuf,
    version: String,
    settings: String,
}

impl Minterpolate {
    pub(in crate::quality) fn open(progress: &dyn Progress) -> Result<Self> {
        Self::with(SETTINGS, progress)
    }

    /// With `settings` as the filter's options.
    pub(super) fn with(settings: &str, progress: &dyn Progress) -> Result<Self> {
        let program = provision::baselines::ffmpeg(progress).map_err(|e| not_provided(&e))?;
        let said = run("ffmpeg", Command::new(&program).args(["-hide_banner", "-version"]))?;
        let version = said.split_whitespace().nth(2).unwrap_or("of an unknown version").to_owned();
        Ok(Self { program, version, settings: settings.to_owned() })
    }
}

impl Row for Minterpolate {
    fn version(&self) -> String {
        format!("ffmpeg {}, `minterpolate={}` on 8-bit YUV 4:4:4", self.version, self.settings)
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let scratch = Scratch::new()?;
        let (width, height) = interval.current().size();
        let input = scratch.pictures("anchors.rgb", interval.anchors)?;
        let output = scratch.path("frames.rgb");
        let multiplier = Phase::common(phases);
        // The filter delays the last pictures, and those after the interval are not needed.
        let needed = (interval.at as u32 + 1) * multiplier;
        let mut command = Command::new(&self.program);
        command
            .args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &RATE.to_string(), "-i"])
            .arg(&input)
            .args(["-vf", &format!("{TO_YUV},minterpolate=fps={}:{},{TO_RGB}", RATE * multiplier, self.settings)])
            .args(["-frames:v", &needed.to_string(), "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .arg(&output);
        run("ffmpeg", &mut command)?;
        let made = read_pictures(&output, (width, height))?;
        let first = interval.at as u32 * multiplier;
        let steps = phases.iter().map(|phase| phase.step(multiplier).map(|step| (first + step) as usize));
        let found: Option<Vec<Picture>> = steps.map(|step| made.get(step?).cloned()).collect();
        found.ok_or_else(|| {
            Error::new(ErrorKind::Unsupported, format!("it gave {} pictures of {needed}", made.len())).field("ffmpeg")
        })
    }
}
