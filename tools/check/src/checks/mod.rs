//! The checks, each a function that returns its finding.

use std::ffi::OsString;
use std::path::PathBuf;

use cairn::LibrarySearch;
use clap::Args;

use crate::finding::{Checked, Finding};

#[cfg(windows)]
mod debug_layer;
#[cfg(windows)]
mod fsr;
#[cfg(windows)]
mod lives;
pub mod machine;
mod processor;
mod seed;
#[cfg(windows)]
mod shaders;
#[cfg(windows)]
mod there;
#[cfg(windows)]
mod times;
mod truth;
#[cfg(windows)]
mod window;
#[cfg(windows)]
mod world;

/// The remedy where a driver is the likely cause.
pub const DRIVER: &str = "Update the adapter's driver; if it still fails, send this report";

/// The groups of the report, in its order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// What is there.
    There,
    /// What runs on the processor.
    Processor,
    /// Results of the adapter.
    Right,
    /// What Direct3D's debug layer says.
    Validation,
    /// Times and memory.
    Times,
}

impl Group {
    /// Every group.
    pub const ALL: [Self; 5] = [Self::There, Self::Processor, Self::Right, Self::Validation, Self::Times];

    /// Its name on the command line and in the report.
    pub fn name(self) -> &'static str {
        match self {
            Self::There => "there",
            Self::Processor => "processor",
            Self::Right => "right",
            Self::Validation => "validation",
            Self::Times => "times",
        }
    }

    /// Its heading.
    pub fn title(self) -> &'static str {
        match self {
            Self::There => "What is there",
            Self::Processor => "Right on the processor",
            Self::Right => "Right on this adapter",
            Self::Validation => "By Direct3D's debug layer",
            Self::Times => "Times and memory",
        }
    }
}

/// A check.
#[derive(Debug)]
pub struct CheckDefinition {
    /// Its name on the command line.
    pub name: &'static str,
    /// Its group.
    pub group: Group,
    /// What it looks at, as a heading.
    pub title: &'static str,
    /// Seconds after which it hangs.
    pub seconds: u64,
    /// Its function, which may panic: that is a failed check.
    pub run: fn(&Settings) -> Checked,
}

/// Checks that load a world on the adapter.
const WITH_WORLDS: [&str; 8] = ["directml", "states", "captured", "removal", "lives", "latents", "memory", "engine"];

impl CheckDefinition {
    /// Whether it loads a world on the adapter, which takes 5 GB of memory and more where a processor emulates it.
    pub fn has_world(&self) -> bool {
        WITH_WORLDS.contains(&self.name)
    }
}

/// What every check gets.
#[derive(Debug, Clone, Default, Args)]
pub struct Settings {
    /// Judge this adapter, by its number in `cairn-check list`; without it the first that is not emulated
    #[arg(long, value_name = "NUMBER")]
    pub adapter: Option<usize>,
    /// Run fewer cases and measure for a shorter time
    #[arg(long)]
    pub quick: bool,
    /// Where the checks of one run share the state with which their rollouts begin on an emulated adapter: the first to need it makes it
    #[arg(long, hide = true, value_name = "FILE")]
    pub starting_state: Option<PathBuf>,
}

impl Settings {
    /// The arguments that hand these settings to another process.
    pub fn arguments(&self) -> Vec<OsString> {
        let mut arguments = Vec::new();
        if let Some(adapter) = self.adapter {
            arguments.extend(["--adapter".into(), adapter.to_string().into()]);
        }
        if self.quick {
            arguments.push("--quick".into());
        }
        if let Some(file) = &self.starting_state {
            arguments.extend(["--starting-state".into(), file.into()]);
        }
        arguments
    }

    /// Where ONNX Runtime and AMD's libraries are: beside this program, in `runtime` and `amd` beside its folder as in the archive, or where the
    /// environment says.
    pub fn libraries(&self) -> LibrarySearch {
        let onnxruntime = if cfg!(windows) { "onnxruntime.dll" } else { "libonnxruntime.so" };
        let beside = std::env::current_exe().ok().and_then(|file| Some(file.parent()?.parent()?.to_owned()));
        let in_archive = |name: &str| beside.as_ref().map(|folder| folder.join(name));
        let is_named = |variable: &str| std::env::var_os(variable).is_some_and(|value| !value.is_empty());
        let runtime = in_archive("runtime").map(|folder| folder.join(onnxruntime)).filter(|file| file.is_file());
        let has_library = |folder: &PathBuf| {
            let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
            files.map(|file| file.file_name()).any(|name| name.to_string_lossy().starts_with("amd_fidelityfx"))
        };
        LibrarySearch {
            onnxruntime: runtime.filter(|_| !is_named("CAIRN_ONNXRUNTIME")),
            ffx: in_archive("amd").filter(has_library).filter(|_| !is_named("CAIRN_FFX_DIR")),
            ..LibrarySearch::for_tools()
        }
    }

    /// Why times on the judged adapter are not those of a graphics adapter, if that is known.
    #[cfg(windows)]
    pub fn emulation(&self, gpu: &cairn::gpu::Gpu) -> Option<&'static str> {
        if cairn::gpu::System::current().wine.is_some() {
            return Some("Wine runs it, and does not say whether a processor emulates the adapter");
        }
        gpu.adapter().is_ok_and(|adapter| adapter.software).then_some("a processor emulates the adapter")
    }

    /// A finding about times: one that passed shows nothing where the adapter may be emulated.
    #[cfg(windows)]
    pub fn about_times(&self, gpu: &cairn::gpu::Gpu, finding: Finding) -> Finding {
        use crate::finding::Verdict;
        match self.emulation(gpu) {
            Some(why) if finding.verdict != Verdict::CannotTell => Finding {
                verdict: Verdict::CannotTell,
                sentence: format!("{}. Of a graphics adapter this shows nothing: {why}", finding.sentence),
                remedy: Some("Run it on Windows, on a graphics adapter".to_owned()),
                ..finding
            },
            _ => finding,
        }
    }

    /// The device of the judged adapter.
    #[cfg(windows)]
    pub fn gpu(&self) -> Result<cairn::gpu::Gpu, Finding> {
        let luid = match self.adapter {
            None => None,
            Some(index) => {
                let adapters = cairn::gpu::adapters()?;
                let adapter = adapters.get(index).ok_or_else(|| {
                    Finding::cannot_tell(
                        format!("there is no adapter of the number {index}"),
                        "Use a number of cairn-check list",
                    )
                })?;
                Some(adapter.luid)
            }
        };
        Ok(cairn::gpu::Gpu::on_adapter(luid)?)
    }
}

/// A function of Windows; on other systems the check cannot tell.
macro_rules! on_windows {
    ($function:path) => {{
        #[cfg(windows)]
        {
            $function
        }
        #[cfg(not(windows))]
        {
            without_direct3d
        }
    }};
}

/// What checks of Direct3D 12 say on other systems.
#[cfg(not(windows))]
fn without_direct3d(_: &Settings) -> Checked {
    Ok(Finding::cannot_tell(
        "this system has no Direct3D 12, which Cairn uses on graphics adapters",
        "Run it on Windows 10 or 11, or in the lab (docs/lab.md)",
    ))
}

const fn check(
    name: &'static str,
    group: Group,
    title: &'static str,
    seconds: u64,
    run: fn(&Settings) -> Checked,
) -> CheckDefinition {
    CheckDefinition { name, group, title, seconds, run }
}

/// Every check, in the order in which they run.
pub static ALL: &[CheckDefinition] = &[
    check("adapters", Group::There, "Adapters and their Direct3D 12", 60, on_windows!(there::adapters)),
    check("libraries", Group::There, "Libraries with versions and signatures", 60, on_windows!(there::libraries)),
    check("debug-layer", Group::There, "Direct3D's debug layer and Agility SDK", 60, on_windows!(there::debug_layer)),
    check("cpu-frames", Group::Processor, "Generated frames beside the true ones", 120, processor::frames),
    check("cpu-world", Group::Processor, "The world inside the library, its saved states", 180, processor::world),
    check("resize", Group::Right, "Decoded pictures, resized", 60, on_windows!(shaders::resize)),
    check("guidance", Group::Right, "Motion and depth from latents", 60, on_windows!(shaders::guidance)),
    check("flow", Group::Right, "Motion between pictures (optical flow)", 60, on_windows!(shaders::optical_flow)),
    check("frames", Group::Right, "Generated frames of random pictures", 90, on_windows!(shaders::frames)),
    check("truth", Group::Right, "Generated frames beside the true ones", 60, on_windows!(shaders::truth)),
    check("formats", Group::Right, "Frames in the formats of targets, and HDR", 60, on_windows!(shaders::formats)),
    check(
        "directml",
        Group::Right,
        "The embedded world by DirectML beside the processor",
        90,
        on_windows!(world::parity),
    ),
    check("states", Group::Right, "Saved states of the embedded world", 90, on_windows!(world::states)),
    check("captured", Group::Right, "Captured passes", 90, on_windows!(world::captured)),
    check("fsr", Group::Right, "AMD FSR's self-test", 60, on_windows!(fsr::self_test)),
    check("fsr-truth", Group::Right, "Frames by AMD FSR beside the true ones", 60, on_windows!(fsr::quality)),
    check("removal", Group::Right, "Removal of the device, and recovery", 90, on_windows!(lives::removal)),
    check("lives", Group::Right, "Two hundred devices, one after the other", 120, on_windows!(lives::lives)),
    check("layer", Group::Validation, "Frames under the debug layer", 120, on_windows!(debug_layer::messages)),
    check(
        "layer-on-gpu",
        Group::Validation,
        "Frames with GPU-based validation",
        180,
        on_windows!(debug_layer::gpu_based_validation),
    ),
    check("latents", Group::Times, "A latent by stage", 60, on_windows!(times::latents)),
    check("generator", Group::Times, "The generator at 1080p to 4K, 2x to 6x", 60, on_windows!(times::generator)),
    check("fsr-times", Group::Times, "AMD FSR on the same pictures", 60, on_windows!(times::fsr)),
    check("first-frame", Group::Times, "The first frame", 60, on_windows!(times::first_frame)),
    check("memory", Group::Times, "Memory against the budget", 60, on_windows!(times::memory)),
    check(
        "engine",
        Group::Times,
        "An engine at 60 and 120 Hz, with and without latents",
        90,
        on_windows!(times::engine),
    ),
    check("window", Group::Times, "From present to present in a window", 60, on_windows!(window::presents)),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checks_that_load_a_world_exist() {
        for name in WITH_WORLDS {
            assert!(ALL.iter().any(|check| check.name == name), "{name}");
        }
    }
}
