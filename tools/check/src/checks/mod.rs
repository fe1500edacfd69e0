//! The checks, in the order in which they run.

mod libraries;
mod machine;
mod processor;
mod walk;

#[cfg(windows)]
mod adapters;

use std::time::Duration;

use cairn::Result;

use crate::outcome::Outcome;
use crate::settings::Settings;

/// What a check is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Group {
    There,
    Correct,
}

impl Group {
    /// Its name on the command line.
    pub(crate) fn id(self) -> &'static str {
        match self {
            Self::There => "there",
            Self::Correct => "correct",
        }
    }

    /// Its heading in a report.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::There => "What is there",
            Self::Correct => "Results",
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
];
