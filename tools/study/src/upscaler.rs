//! Upscaler from the world's size to the presented size: `--upscaler`.

use std::str::FromStr;

use cairn::present::upscale::{Filter, Upscaler};
use cairn::runtime::Device;
use cairn::world::{OperatingPoint, Presentation};
use cairn::{Error, ErrorKind, Result};

/// The requested upscaler.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum UpscalerChoice {
    /// A spatial filter for each frame by itself.
    Space(Filter),
    /// AMD's FSR on Direct3D 12: temporal upscaling of anchors, before frames are generated between them.
    Fsr,
}

/// The choices and their names.
const NAMES: [(UpscalerChoice, &str); 3] = [
    (UpscalerChoice::Space(Filter::Lanczos3), "lanczos"),
    (UpscalerChoice::Space(Filter::CatmullRom), "catmull-rom"),
    (UpscalerChoice::Fsr, "fsr"),
];

impl FromStr for UpscalerChoice {
    type Err = Error;

    /// Reads `lanczos` or its synonym `spatial`, `catmull-rom` or `fsr`.
    fn from_str(text: &str) -> Result<Self> {
        let name = if text == "spatial" { "lanczos" } else { text };
        let found = NAMES.iter().find(|(_, known)| *known == name).map(|(choice, _)| *choice);
        found.ok_or_else(|| {
            Error::new(ErrorKind::InvalidArgument, format!("{text:?} is no upscaler"))
                .field("--upscaler")
                .remedy("Use lanczos, which is spatial, catmull-rom or fsr")
        })
    }
}

impl UpscalerChoice {
    /// Fails if this machine or the way of presenting cannot have this upscaler. Loads nothing.
    pub(crate) fn check(self, point: &OperatingPoint) -> Result<()> {
        if self != Self::Fsr {
            return Ok(());
        }
        let refuse =
            |why: &str, remedy: &str| Err(Error::new(ErrorKind::Unsupported, why).field("--upscaler").remedy(remedy));
        if matches!(point.presentation, Presentation::Native) {
            return refuse(
                "fsr goes from anchor to anchor, and here all frames are decoded",
                "Use lanczos or catmull-rom, or have frames generated",
            );
        }
        if !cfg!(windows) {
            return refuse("fsr needs Direct3D 12, which is available on Windows only", "Use lanczos or catmull-rom");
        }
        Ok(())
    }

    /// Opens the upscaler from one size to another: on the world's device if that is a Direct3D 12 device, otherwise on the best adapter.
    ///
    /// # Errors
    /// For `fsr`: missing libraries, no upscaler for the device, or a size smaller than the pictures.
    pub(crate) fn make(
        self,
        from: (u32, u32),
        to: (u32, u32),
        world: &Device,
        latents_per_second: u32,
    ) -> Result<Scaling> {
        match self {
            Self::Space(filter) => Ok(Scaling::Space(Box::new(Upscaler::new(from, to, filter)?))),
            Self::Fsr => fsr(from, to, world, latents_per_second),
        }
    }
}

/// An opened upscaler.
pub(crate) enum Scaling {
    /// Scales each presented frame.
    Space(Box<Upscaler>),
    /// Scales anchors before frames are generated.
    #[cfg(windows)]
    Amd(Box<cairn::present::device::PictureUpscaler>),
}

#[cfg(windows)]
fn fsr(from: (u32, u32), to: (u32, u32), world: &Device, latents_per_second: u32) -> Result<Scaling> {
    use cairn::ffx::{Choice, Effect, Library, LoadOptions};
    use cairn::gpu::Gpu;
    use cairn::present::device::PictureUpscaler;

    let gpu = world.gpu().map_or_else(|| Gpu::on_adapter(None), |gpu| Ok(gpu.clone()))?;
    let library = Library::load(&LoadOptions::from_environment())?;
    let interval = 1000.0 / latents_per_second as f32;
    let made = PictureUpscaler::new(&gpu, library.api(Effect::Upscaling)?, Choice::Any, from, to, interval)?;
    Ok(Scaling::Amd(Box::new(made)))
}

/// Not reached: the choice was refused before.
#[cfg(not(windows))]
fn fsr(_: (u32, u32), _: (u32, u32), _: &Device, _: u32) -> Result<Scaling> {
    Err(Error::new(ErrorKind::Unsupported, "fsr needs Direct3D 12").field("--upscaler"))
}

#[cfg(test)]
mod tests {
    use cairn::world::Preset;

    use super::*;

    #[test]
    fn a_choice_is_read_by_its_name() {
        for (choice, name) in NAMES {
            assert_eq!(name.parse::<UpscalerChoice>().unwrap(), choice);
        }
        assert_eq!("spatial".parse::<UpscalerChoice>().unwrap(), UpscalerChoice::Space(Filter::Lanczos3));
        for text in ["", "FSR", "fsr4", "auto"] {
            let error = text.parse::<UpscalerChoice>().unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("--upscaler")));
        }
    }

    #[test]
    fn what_cannot_be_is_refused_before_anything_is_loaded() {
        for preset in [Preset::Coherence, Preset::Decoded60] {
            UpscalerChoice::Space(Filter::Lanczos3).check(&preset.operating_point()).unwrap();
        }
        let refused = UpscalerChoice::Fsr.check(&Preset::Decoded60.operating_point()).unwrap_err();
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("--upscaler")));
        assert!(refused.to_string().contains("decoded"), "{refused}");
        let of_anchors = UpscalerChoice::Fsr.check(&Preset::Coherence.operating_point());
        assert_eq!(of_anchors.is_ok(), cfg!(windows), "{of_anchors:?}");
    }
}
