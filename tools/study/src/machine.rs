//! Versions and hardware that can affect results or timings.

use cairn::runtime::Device;
use serde::{Deserialize, Serialize};

use crate::experiment::provenance::Source;
use crate::generator::GeneratorChoice;

/// Software and hardware of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// Version of the library.
    pub cairn: String,
    /// The sources that this program ran with. `None` away from the repository, and in manifests from before it was recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Source>,
    /// Version of ONNX Runtime. `None` if no world runs; the same holds for the device and its threads.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onnxruntime: Option<String>,
    /// Name and version of the video encoder.
    pub encoder: String,
    /// Whether the encoder has its assembly kernels; affects the speed only.
    pub encoder_assembly: bool,
    /// The generator of frames between anchors.
    pub generator: String,
    /// The device the world ran on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Threads per pass.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
    /// The graphics adapter of the world or of the generator, if one of them runs on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<AdapterVersion>,
    /// External libraries that affect results of a graphics device: ONNX Runtime, DirectML, Direct3D and AMD's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub libraries: Vec<LibraryVersion>,
    /// Operating system and its version.
    pub os: String,
    /// Processor architecture.
    pub architecture: String,
    /// Name of the processor; on Windows its family, model and stepping.
    pub cpu: String,
    /// CPU features by which kernels are selected.
    pub cpu_features: Vec<String>,
    /// Whether the program was compiled with optimisation.
    pub optimised_build: bool,
}

/// A graphics adapter.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AdapterVersion {
    /// Name that the adapter reports.
    pub name: String,
    /// The version of its driver, as Windows shows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<String>,
}

/// An external library.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LibraryVersion {
    /// The name of its file.
    pub name: String,
    /// Version in the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
}

impl Versions {
    /// Those of this program, with `generator`, and of this machine; the fields of a world are empty.
    pub(crate) fn without_world(generator: GeneratorChoice) -> Self {
        Self {
            cairn: env!("CARGO_PKG_VERSION").into(),
            source: Source::of_this_program(),
            onnxruntime: None,
            encoder: media::ENCODER.into(),
            encoder_assembly: media::ASSEMBLY,
            generator: generator.to_string(),
            device: None,
            threads: None,
            adapter: None,
            libraries: libraries(),
            os: os(),
            architecture: std::env::consts::ARCH.into(),
            cpu: cpu(),
            cpu_features: cpu_features(),
            optimised_build: !cfg!(debug_assertions),
        }
    }
}

/// Those libraries that this process has loaded so far.
#[cfg(windows)]
pub(crate) fn libraries() -> Vec<LibraryVersion> {
    let all = cairn::runtime::loaded_libraries().into_iter();
    all.map(|library| LibraryVersion {
        name: library.path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        version: library.version,
    })
    .collect()
}

/// Empty on other systems, whose libraries state no version in their files. ONNX Runtime has its own entry.
#[cfg(not(windows))]
pub(crate) fn libraries() -> Vec<LibraryVersion> {
    Vec::new()
}

/// Adapter of a world on Direct3D 12, or else of a generator on it: the system's first one, a software adapter only if there is no other. `None` for
/// worlds on WebGPU, whose device's description names the adapter.
#[cfg(windows)]
pub(crate) fn adapter(world: &Device, generator: GeneratorChoice) -> Option<AdapterVersion> {
    let adapter = match world.gpu() {
        Some(gpu) => gpu.adapter().ok()?,
        None if generator.is_cpu() => return None,
        None => {
            let all = cairn::gpu::adapters().ok()?;
            all.iter().find(|adapter| !adapter.software).or(all.first())?.clone()
        }
    };
    Some(AdapterVersion { name: adapter.description, driver: adapter.driver })
}

/// None on other systems, which have no Direct3D 12.
#[cfg(not(windows))]
pub(crate) fn adapter(_: &Device, _: GeneratorChoice) -> Option<AdapterVersion> {
    None
}

/// The operating system, e.g. `Windows 10.0.22631`.
#[cfg(windows)]
fn os() -> String {
    let cairn::gpu::System { build, wine } = cairn::gpu::System::current();
    let build = build.map(|[major, minor, build]| format!(" {major}.{minor}.{build}")).unwrap_or_default();
    let wine = wine.map(|version| format!(", on Wine {version}")).unwrap_or_default();
    format!("Windows{build}{wine}")
}

/// The operating system, e.g. `Debian GNU/Linux 12 (bookworm), linux 6.1.0`.
#[cfg(not(windows))]
fn os() -> String {
    let read = |path| std::fs::read_to_string(path).unwrap_or_default();
    let release = read("/etc/os-release");
    let name = release.lines().find_map(|l| l.strip_prefix("PRETTY_NAME=")).map(|n| n.trim_matches('"'));
    let kernel = read("/proc/sys/kernel/osrelease");
    match name {
        Some(name) => format!("{name}, {} {}", std::env::consts::OS, kernel.trim()),
        None => std::env::consts::OS.to_owned(),
    }
}

/// Name of the processor; on Windows its family, model and stepping.
fn cpu() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|l| l.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim()));
    let windows = || std::env::var("PROCESSOR_IDENTIFIER").ok();
    model.map(str::to_owned).or_else(windows).unwrap_or_else(|| "unknown".into())
}

/// CPU features by which ONNX Runtime and this library select kernels.
fn cpu_features() -> Vec<String> {
    #[cfg(target_arch = "x86_64")]
    let found = [
        ("sse4.1", std::is_x86_feature_detected!("sse4.1")),
        ("avx", std::is_x86_feature_detected!("avx")),
        ("f16c", std::is_x86_feature_detected!("f16c")),
        ("fma", std::is_x86_feature_detected!("fma")),
        ("avx2", std::is_x86_feature_detected!("avx2")),
        ("avxvnni", std::is_x86_feature_detected!("avxvnni")),
        ("avx512f", std::is_x86_feature_detected!("avx512f")),
        ("avx512bw", std::is_x86_feature_detected!("avx512bw")),
        ("avx512vnni", std::is_x86_feature_detected!("avx512vnni")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let found: [(&str, bool); 0] = [];
    found.into_iter().filter(|f| f.1).map(|f| f.0.to_owned()).collect()
}
