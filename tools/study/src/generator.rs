//! Generator of frames between anchors: `--generator`.

use std::fmt;
use std::str::FromStr;

use cairn::framegen::FrameGenerator;
use cairn::framegen::cpu::CpuGenerator;
use cairn::runtime::Device;
use cairn::world::{OperatingPoint, Presentation};
use cairn::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

/// The requested generator.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum GeneratorChoice {
    /// The CPU. Also meant by manifests without a generator.
    #[default]
    Cpu,
    /// The library's shaders on Direct3D 12.
    Shader,
    /// AMD's FSR on Direct3D 12, from the libraries in `CAIRN_FFX_DIR` or beside the program.
    Fsr,
}

/// The choices and their names.
const NAMES: [(GeneratorChoice, &str); 3] =
    [(GeneratorChoice::Cpu, "cpu"), (GeneratorChoice::Shader, "shader"), (GeneratorChoice::Fsr, "fsr")];

impl FromStr for GeneratorChoice {
    type Err = Error;

    /// Reads `cpu`, `shader` or `fsr`.
    fn from_str(text: &str) -> Result<Self> {
        let found = NAMES.iter().find(|(_, name)| *name == text).map(|(choice, _)| *choice);
        found.ok_or_else(|| {
            Error::new(ErrorKind::InvalidArgument, format!("{text:?} is no generator"))
                .field("--generator")
                .remedy("Use cpu, shader or fsr")
        })
    }
}

impl fmt::Display for GeneratorChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(NAMES.iter().find(|(choice, _)| choice == self).map_or("", |(_, name)| name))
    }
}

impl TryFrom<String> for GeneratorChoice {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<GeneratorChoice> for String {
    fn from(choice: GeneratorChoice) -> Self {
        choice.to_string()
    }
}

impl GeneratorChoice {
    /// Whether this is the generator meant by manifests without one.
    pub(crate) fn is_cpu(&self) -> bool {
        *self == Self::Cpu
    }

    /// Fails if this machine or the way of presenting cannot have this generator. Loads nothing.
    pub(crate) fn check(self, point: &OperatingPoint) -> Result<()> {
        let half = 2 * point.latents_per_second;
        self.check_for(match point.presentation {
            Presentation::Generated { rate, .. } if rate != half => {
                Some(format!("fsr makes frames half way between two anchors: {half} a second"))
            }
            _ => None,
        })
    }

    /// The same for `multiplier` frames per anchor, the anchor itself included.
    pub(crate) fn check_multiplier(self, multiplier: u32) -> Result<()> {
        let why = "fsr makes frames half way between two others: two of each";
        self.check_for((multiplier != 2).then(|| why.to_owned()))
    }

    /// Fails if this machine cannot have this generator, or for `fsr` with the reason in `against_fsr`.
    fn check_for(self, against_fsr: Option<String>) -> Result<()> {
        if !self.is_cpu() && !cfg!(windows) {
            return Err(Error::new(
                ErrorKind::Unsupported,
                format!("{self} needs Direct3D 12, which is available on Windows only"),
            )
            .field("--generator")
            .remedy("Use cpu"));
        }
        match against_fsr.filter(|_| self == Self::Fsr) {
            Some(why) => Err(Error::new(ErrorKind::Unsupported, why)
                .field("--generator")
                .remedy("Have that many frames made, or use shader or cpu")),
            None => Ok(()),
        }
    }

    /// Opens the generator for frames that are `interval_ms` apart: on the world's device if that is a Direct3D 12 device, otherwise on the best
    /// adapter.
    #[cfg(windows)]
    pub(crate) fn make(self, world: Option<&Device>, interval_ms: f32) -> Result<Box<dyn FrameGenerator>> {
        use cairn::ffx::{Choice, Effect, Library, LoadOptions};
        use cairn::framegen::device::DeviceGenerator;
        use cairn::gpu::Gpu;

        let gpu = || world.and_then(Device::gpu).map_or_else(|| Gpu::on_adapter(None), |gpu| Ok(gpu.clone()));
        Ok(match self {
            Self::Cpu => Box::new(CpuGenerator::new()),
            Self::Shader => Box::new(DeviceGenerator::of_shaders(&gpu()?)),
            Self::Fsr => {
                let library = Library::load(&LoadOptions::from_environment())?;
                let api = library.api(Effect::FrameGeneration)?;
                Box::new(DeviceGenerator::of_amd(&gpu()?, api, Choice::Any, interval_ms))
            }
        })
    }

    /// Opens the CPU generator; the others were refused before.
    #[cfg(not(windows))]
    pub(crate) fn make(self, _world: Option<&Device>, _interval_ms: f32) -> Result<Box<dyn FrameGenerator>> {
        Ok(Box::new(CpuGenerator::new()))
    }
}

#[cfg(test)]
mod tests {
    use cairn::world::Preset;

    use super::*;

    #[test]
    fn a_choice_is_written_as_it_is_read() {
        for (choice, name) in NAMES {
            assert_eq!((name.parse::<GeneratorChoice>().unwrap(), choice.to_string()), (choice, name.to_owned()));
        }
        for text in ["", "CPU", "fsr4", "auto"] {
            let error = text.parse::<GeneratorChoice>().unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("--generator")));
        }
    }

    #[test]
    fn what_cannot_be_is_refused_before_anything_is_loaded() {
        let twice = Preset::Coherence.operating_point();
        GeneratorChoice::Cpu.check(&twice).unwrap();
        for choice in [GeneratorChoice::Shader, GeneratorChoice::Fsr] {
            let checked = choice.check(&twice);
            assert_eq!(checked.is_ok(), cfg!(windows), "{checked:?}");
            assert!(checked.is_ok() || checked.unwrap_err().offending_field() == Some("--generator"));
        }
        let fourfold: OperatingPoint = twice.to_string().replace("generated:30", "generated:60").parse().unwrap();
        assert_ne!(fourfold, twice);
        let refused = GeneratorChoice::Fsr.check(&fourfold).unwrap_err();
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("--generator")));
        GeneratorChoice::Cpu.check(&fourfold).unwrap();
        GeneratorChoice::Cpu.check_multiplier(4).unwrap();
        let refused = GeneratorChoice::Fsr.check_multiplier(4).unwrap_err();
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("--generator")));
        assert_eq!(GeneratorChoice::Fsr.check_multiplier(2).is_ok(), cfg!(windows));
    }
}
