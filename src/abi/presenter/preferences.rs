//! A host's preferences for a presenter's frames: colour space and generators.

use super::super::d3d12::backend::HAS_SHADERS;
use super::super::results::{AbiResult, CAIRN_ERROR_UNSUPPORTED, Failure};
use super::{
    CAIRN_COLOUR_HDR10, CAIRN_COLOUR_LINEAR, CAIRN_COLOUR_SCRGB, CAIRN_COLOUR_SRGB, CAIRN_PREFER_AUTO,
    CAIRN_PREFER_NEVER, CAIRN_PREFER_REQUIRE, cairn_presenter_options,
};
use crate::Colours;
use crate::framegen::FrameGenerator;
use crate::framegen::cpu::CpuGenerator;
use crate::present::{Preference, RendererOptions};

/// The colour space of frames.
pub(super) fn colours(space: u32, white_nits: u32) -> AbiResult<Colours> {
    let refuse = |field: &str, cause: String| Err(Failure::argument(&format!("options.{field}"), cause));
    let white = match white_nits {
        0 => 203.0,
        nits @ 1..=10_000 => nits as f32,
        other => return refuse("white_nits", format!("{other} nits are more than there can be")),
    };
    match space {
        CAIRN_COLOUR_SRGB | CAIRN_COLOUR_LINEAR if white_nits != 0 => {
            refuse("white_nits", "these colours do not say how bright white is".into())
        }
        CAIRN_COLOUR_SRGB => Ok(Colours::Srgb),
        CAIRN_COLOUR_LINEAR => Ok(Colours::Linear),
        CAIRN_COLOUR_SCRGB => Ok(Colours::ScRgb { white_nits: white }),
        CAIRN_COLOUR_HDR10 => Ok(Colours::Hdr10 { white_nits: white }),
        other => refuse("colour_space", format!("{other} is no colour space of this library")),
    }
}

/// The options of the renderer for Direct3D 12. [`cpu_generator`] has checked the preferences.
pub(super) fn renderer_options(options: &cairn_presenter_options, colours: Colours) -> RendererOptions {
    let is_cpu_required = options.cpu == CAIRN_PREFER_REQUIRE;
    let [fsr, shader, upscaler] = [options.fsr, options.shader, options.upscaler].map(|preference| match preference {
        _ if is_cpu_required => Preference::Never,
        CAIRN_PREFER_REQUIRE => Preference::Require,
        CAIRN_PREFER_NEVER => Preference::Never,
        _ => Preference::Auto,
    });
    RendererOptions { colours, fsr, shader, upscaler }
}

/// Checks all preferences. Returns the generator for frames in memory, if the preferences allow it, and why others make no frames there.
pub(super) fn cpu_generator(options: &cairn_presenter_options) -> AbiResult<(Option<Box<dyn FrameGenerator>>, String)> {
    let preferences = [("fsr", options.fsr), ("shader", options.shader), ("cpu", options.cpu)];
    for (name, preference) in preferences.into_iter().chain([("upscaler", options.upscaler)]) {
        if preference > CAIRN_PREFER_NEVER {
            let cause = format!("{preference} is no preference");
            return Err(Failure::argument(&format!("options.{name}"), cause));
        }
    }
    let required = preferences.iter().filter(|(_, preference)| *preference == CAIRN_PREFER_REQUIRE);
    if required.count() > 1 {
        return Err(Failure::argument("options.cpu", "only one generator can be required"));
    }
    if [options.cpu, options.upscaler] == [CAIRN_PREFER_REQUIRE; 2] {
        let cause = "AMD's upscaler works with shaders, and the generator on the processor is required";
        return Err(Failure::argument("options.upscaler", cause));
    }
    let missing = || {
        let failure =
            if HAS_SHADERS { Failure::new(CAIRN_ERROR_UNSUPPORTED, ONLY_RECORDED) } else { Failure::no_d3d12() };
        failure.remedy("Use the cpu generator")
    };
    for (name, preference) in &preferences[..2] {
        if *preference == CAIRN_PREFER_REQUIRE && !HAS_SHADERS {
            return Err(missing().field(format!("options.{name}")));
        }
    }
    if options.upscaler == CAIRN_PREFER_REQUIRE && !HAS_SHADERS {
        return Err(missing().field("options.upscaler"));
    }
    for (preference, cause) in [
        (options.fsr, "fsr makes the frames half way between two anchors, and needs shaders for all others"),
        (options.upscaler, "AMD's upscaler needs shaders to generate frames from upscaled anchors"),
    ] {
        if preference == CAIRN_PREFER_REQUIRE && options.shader == CAIRN_PREFER_NEVER {
            return Err(Failure::new(CAIRN_ERROR_UNSUPPORTED, cause)
                .field("options.shader")
                .remedy("Let shaders be used"));
        }
    }
    let preferred: Vec<_> = preferences[..2].iter().filter(|(_, p)| *p == CAIRN_PREFER_AUTO).map(|(n, _)| *n).collect();
    let reason = if preferred.is_empty() || options.cpu == CAIRN_PREFER_REQUIRE {
        String::new()
    } else {
        format!("{}: {}", preferred.join(", "), missing())
    };
    let generator: Option<Box<dyn FrameGenerator>> = match (options.cpu, options.shader) {
        (CAIRN_PREFER_NEVER, _) | (_, CAIRN_PREFER_REQUIRE) => None,
        _ if [options.fsr, options.upscaler].contains(&CAIRN_PREFER_REQUIRE) => None,
        _ => Some(Box::new(CpuGenerator::new())),
    };
    Ok((generator, reason))
}

/// The reason that is reported if a generator for Direct3D 12 makes no frames in memory.
const ONLY_RECORDED: &str = "frames are made with it where they are recorded for Direct3D 12";
