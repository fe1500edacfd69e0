//! The checks, in the order in which they run.

mod libraries;
mod machine;
mod processor;
mod walk;

#[cfg(windows)]
mod adapters;
#[cfg(windows)]
mod clock;
#[cfg(windows)]
mod directml;
#[cfg(windows)]
mod frames;
#[cfg(windows)]
mod fsr;
#[cfg(windows)]
mod pace;
#[cfg(windows)]
mod shaders;
#[cfg(windows)]
mod times;
#[cfg(windows)]
mod validation;

// What the library's own tests compare its shaders with the processor by. The crate `test-support` has all of it, and much that a program
// for users must not contain.
#[cfg(windows)]
#[path = "../../../../tests/support/src/frame_cases.rs"]
#[allow(dead_code, unreachable_pub, reason = "the crate exports it")]
mod frame_cases;
#[cfg(windows)]
#[path = "../../../../tests/support/src/d3d12/resources.rs"]
#[allow(dead_code, unreachable_pub, reason = "the crate exports it")]
mod resources;

use std::time::Duration;

use cairn::Result;

use crate::outcome::Outcome;
use crate::settings::Settings;

/// What a check is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Group {
    There,
    Correct,
    Figures,
}

impl Group {
    /// Its name on the command line.
    pub(crate) fn id(self) -> &'static str {
        match self {
            Self::There => "there",
            Self::Correct => "correct",
            Self::Figures => "figures",
        }
    }

    /// Its heading in a report.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::There => "What is there",
            Self::Correct => "Results",
            Self::Figures => "Figures",
        }
    }
}

/// A check, which gives one line of a report.
pub(crate) struct Check {
    /// Identifies it on the command line and in reports.
    pub(crate) id: &'static str,
    pub(crate) group: Group,
    pub(crate) title: &'static str,
    /// After this time its process is stopped.
    pub(crate) limit: Duration,
    run: fn(&Settings) -> Result<Outcome>,
}

impl Check {
    /// Runs it in this process.
    pub(crate) fn judge(&self, settings: &Settings) -> Outcome {
        (self.run)(settings).unwrap_or_else(Outcome::from)
    }
}

const fn check(
    group: Group,
    id: &'static str,
    title: &'static str,
    seconds: u64,
    run: fn(&Settings) -> Result<Outcome>,
) -> Check {
    Check { id, group, title, limit: Duration::from_secs(seconds), run }
}

/// A check that needs Direct3D 12: the function on Windows, and elsewhere the reason why nothing can be told.
macro_rules! direct3d {
    ($run:path) => {{
        #[cfg(windows)]
        {
            $run
        }
        #[cfg(not(windows))]
        {
            needs_windows
        }
    }};
}

#[cfg(not(windows))]
fn needs_windows(_: &Settings) -> Result<Outcome> {
    let cause = format!("Direct3D 12 is a part of Windows, and this is {}", std::env::consts::OS);
    Ok(Outcome::cannot_tell(cause, "Run cairn-check.exe on Windows 10 or 11"))
}

/// All checks.
pub(crate) const CHECKS: &[Check] = &[
    check(Group::There, "machine", "System, processor and memory", 10, machine::run),
    check(Group::There, "adapters", "Graphics adapters and their drivers", 20, direct3d!(adapters::list)),
    check(Group::There, "device", "Features of the adapter", 20, direct3d!(adapters::features)),
    check(Group::There, "runtime", "ONNX Runtime and DirectML", 30, libraries::runtime),
    check(Group::There, "direct3d", "Direct3D 12 and the Agility SDK", 20, direct3d!(libraries::direct3d)),
    check(Group::There, "debug-layer", "Debug layer and GPU-based validation", 20, direct3d!(adapters::debug_layer)),
    check(Group::There, "fsr-libraries", "AMD's libraries for FSR", 20, direct3d!(libraries::fsr)),
    check(Group::Correct, "cpu-generator", "Frames of the processor against true frames", 60, processor::generator),
    check(Group::Correct, "cpu-world", "The embedded world on the processor", 60, processor::world),
    check(Group::Correct, "shader-resize", "Resized pictures against the processor", 30, direct3d!(shaders::resize)),
    check(Group::Correct, "shader-flow", "Optical flow against the processor", 30, direct3d!(shaders::flow)),
    check(Group::Correct, "shader-frames", "Generated frames against the processor", 30, direct3d!(shaders::generator)),
    check(Group::Correct, "frames", "Frames of the adapter against true frames", 60, direct3d!(frames::quality)),
    check(Group::Correct, "formats", "Frames in every format of a target", 30, direct3d!(frames::formats)),
    check(Group::Correct, "world-parity", "The embedded world against the processor", 60, direct3d!(directml::parity)),
    check(Group::Correct, "world-state", "Repeated and restored steps", 60, direct3d!(directml::repeat)),
    check(Group::Correct, "captured-passes", "Captured passes", 60, direct3d!(directml::captured)),
    check(Group::Correct, "fsr", "Frames of AMD's FSR against true frames", 60, direct3d!(fsr::quality)),
    check(Group::Correct, "removal", "Removal of the device, and recovery", 30, direct3d!(frames::removal)),
    check(Group::Correct, "lives", "Devices that come and go", 60, direct3d!(frames::lives)),
    check(Group::Correct, "validation", "Shaders under the debug layer", 60, direct3d!(validation::run)),
    check(Group::Figures, "latent", "A latent by stage", 30, direct3d!(pace::latent)),
    check(Group::Figures, "generator", "The generator by size and rate", 60, direct3d!(times::generator)),
    check(Group::Figures, "fsr-beside", "AMD's FSR beside the generator", 60, direct3d!(times::fsr_beside)),
    check(Group::Figures, "first-frame", "The first frame", 30, direct3d!(times::first_frame)),
    check(Group::Figures, "memory", "Memory against the budget", 30, direct3d!(pace::memory)),
    check(Group::Figures, "engine", "An engine's frames beside latents", 60, direct3d!(pace::engine)),
];
