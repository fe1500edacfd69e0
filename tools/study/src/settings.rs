//! Settings of a rollout: everything that affects the bytes of its outputs, and nothing else.

use std::path::PathBuf;

use cairn::world::{OperatingPoint, Preset, WorldTime};
use cairn::{Error, ErrorKind, MAX_SIDE, Result};
use serde::{Deserialize, Serialize};

use crate::device::DeviceChoice;
use crate::generator::GeneratorChoice;
use crate::upscaler::UpscalerChoice;

/// Which media are written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Formats {
    /// `rollout.mp4`.
    pub mp4: bool,
    /// `frames/000000.png`, ...
    pub png: bool,
    /// `rollout.y4m`.
    pub y4m: bool,
}

impl Formats {
    /// Reads `mp4,png,y4m`.
    ///
    /// # Errors
    /// `InvalidArgument` for an unknown word, or for no word.
    pub fn parse(text: &str) -> Result<Self> {
        let mut formats = Self::default();
        for word in text.split(',').map(str::trim) {
            match word {
                "mp4" => formats.mp4 = true,
                "png" => formats.png = true,
                "y4m" => formats.y4m = true,
                _ => {
                    return Err(Error::new(ErrorKind::InvalidArgument, format!("{word:?} is no format"))
                        .field("--formats")
                        .remedy("List one or more of mp4, png and y4m, with commas between"));
                }
            }
        }
        Ok(formats)
    }
}

/// Settings as stored in the manifest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// The bundle; `None` for the library's own.
    pub world: Option<PathBuf>,
    /// PNG or JPEG; `None` for the built-in seed picture.
    pub seed_picture: Option<PathBuf>,
    /// None for the built-in script.
    pub script: Option<PathBuf>,
    /// Stored latents of an earlier rollout, which are decoded instead of making new ones. Seed picture, script and noise seed then have no
    /// effect.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latents: Option<PathBuf>,
    /// Name of the preset, if one was given: information only. `operating_point` counts.
    pub preset: Option<String>,
    /// In the text form of [`OperatingPoint`].
    pub operating_point: String,
    /// Decimal seconds of world time.
    pub seconds: String,
    /// Seed of the noise.
    pub seed: u64,
    /// `[width, height]` of the presented frames.
    pub size: [u32; 2],
    /// `lanczos`, `catmull-rom` or `fsr`.
    pub upscaler: String,
    /// Media.
    pub formats: Formats,
    /// Threads per pass; results depend on it. `None`: one per physical core, and the manifest has the number.
    pub threads: Option<usize>,
    /// Device of the world. A manifest has the device that `auto` resolved to.
    #[serde(default, skip_serializing_if = "DeviceChoice::is_cpu")]
    pub device: DeviceChoice,
    /// Generator of frames between anchors.
    #[serde(default, skip_serializing_if = "GeneratorChoice::is_cpu")]
    pub generator: GeneratorChoice,
}

/// Parsed settings.
pub(crate) struct ParsedSettings {
    pub(crate) point: OperatingPoint,
    pub(crate) duration: WorldTime,
    pub(crate) upscaler: UpscalerChoice,
    pub(crate) generator: GeneratorChoice,
}

impl Default for Settings {
    /// The demo: four seconds of `coherence` at 1920 x 1080 on the embedded world.
    fn default() -> Self {
        Self {
            world: None,
            seed_picture: None,
            script: None,
            latents: None,
            preset: Some(Preset::Coherence.name().into()),
            operating_point: Preset::Coherence.operating_point().to_string(),
            seconds: "4".into(),
            seed: 1,
            size: [1920, 1080],
            upscaler: "lanczos".into(),
            formats: Formats { mp4: true, ..Formats::default() },
            threads: None,
            device: DeviceChoice::Cpu,
            generator: GeneratorChoice::Cpu,
        }
    }
}

impl Settings {
    /// Parses the texts and checks the ranges; reads no file.
    pub(crate) fn check(&self) -> Result<ParsedSettings> {
        let [width, height] = self.size;
        let least = if self.formats.mp4 { 16 } else { 1 };
        if width < least || height < least || width > MAX_SIDE || height > MAX_SIDE {
            let what = if self.formats.mp4 { "frames and their MP4 video" } else { "frames" };
            return Err(Error::new(ErrorKind::InvalidArgument, format!("{what} cannot be {width}x{height}"))
                .field("--size")
                .remedy(format!("Use a width and a height from {least} to {MAX_SIDE}, such as 1920x1080")));
        }
        let point: OperatingPoint = self.operating_point.parse()?;
        let duration = WorldTime::parse(&self.seconds).map_err(|e| e.field("--seconds"))?;
        if duration == WorldTime::ZERO {
            return Err(Error::new(ErrorKind::InvalidArgument, "no time, no rollout")
                .field("--seconds")
                .remedy("Use more than 0"));
        }
        if self.formats == Formats::default() {
            return Err(Error::new(ErrorKind::InvalidArgument, "nothing would be written")
                .field("--formats")
                .remedy("List one or more of mp4, png and y4m"));
        }
        if let Some(threads @ (0 | 1025..)) = self.threads {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("{threads} threads cannot share a pass"))
                .field("--threads")
                .remedy("Use 1 to 1024"));
        }
        self.generator.check(&point)?;
        let upscaler: UpscalerChoice = self.upscaler.parse()?;
        upscaler.check(&point)?;
        Ok(ParsedSettings { point, duration, upscaler, generator: self.generator })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(settings: Settings) -> String {
        let error = settings.check().err().expect("must be refused");
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        error.to_string()
    }

    #[test]
    fn the_default_is_the_demo() {
        let checked = Settings::default().check().unwrap();
        let counts = checked.point.counts(checked.duration);
        assert_eq!((counts.latents, counts.presented), (61, 121));
    }

    #[test]
    fn sizes_that_cannot_be_are_refused_by_name() {
        for size in [[0, 1080], [1920, 0], [65_536, 1080], [1920, 65_536], [8, 8]] {
            let message = refused(Settings { size, ..Settings::default() });
            assert!(message.contains("--size") && message.contains(&size[0].to_string()), "{message}");
        }
        let formats = Formats { png: true, ..Formats::default() };
        assert!(Settings { size: [8, 8], formats, ..Settings::default() }.check().is_ok());
    }

    #[test]
    fn other_nonsense_is_refused_by_name() {
        let base = Settings::default;
        assert!(refused(Settings { seconds: "0".into(), ..base() }).contains("--seconds"));
        assert!(refused(Settings { seconds: "nan".into(), ..base() }).contains("--seconds"));
        assert!(refused(Settings { upscaler: "best".into(), ..base() }).contains("lanczos"));
        assert!(refused(Settings { threads: Some(0), ..base() }).contains("--threads"));
        assert!(refused(Settings { formats: Formats::default(), ..base() }).contains("--formats"));
        assert!(Formats::parse("mp4,avi").unwrap_err().to_string().contains("avi"));
    }
}
