//! Runs a rollout by a fixed script and records everything that an oracle needs to check it: `trace.json` has the steps,
//! `trace.safetensors` the tensors. The Python tests compare them.

mod mutant;
mod recorder;
mod script;
mod tracer;

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::LibrarySearch;
use cairn::bundle::{Bundle, Precision};
use cairn::runtime::{CpuOptions, Device, Ort};
use cairn::world::{CacheMode, OperatingPoint, Preset, Rollout, Schedule, World, WorldOptions};
use clap::{Parser, ValueEnum};

use mutant::Mutant;
use tracer::Tracer;

/// A failure, printed as one line.
type Failure = Box<dyn std::error::Error>;

/// Runs a rollout and writes down everything an oracle needs to check it.
#[derive(Parser)]
struct Arguments {
    /// The world bundle.
    bundle: PathBuf,
    /// The folder that trace.json and trace.safetensors go to.
    out: PathBuf,
    /// How many latents, appended pictures among them.
    #[arg(long, default_value_t = 40)]
    latents: u64,
    /// Numbers of the latents that are appended pictures.
    #[arg(long, value_delimiter = ',', default_value = "0")]
    append: Vec<u64>,
    /// Numbers of the latents of which every pass is recorded; all when not given.
    #[arg(long, value_delimiter = ',')]
    record: Vec<u64>,
    /// separate, fused or interval:K.
    #[arg(long, default_value = "separate")]
    cache: CacheMode,
    /// stock, refined:N or explicit:1:...:0.
    #[arg(long, default_value = "stock")]
    schedule: Schedule,
    /// The global window in latents; the bundle's stock window when not given.
    #[arg(long)]
    global_window: Option<u32>,
    /// The type the graphs compute in.
    #[arg(long, default_value = "f32")]
    precision: PrecisionName,
    /// DeviceName the graphs run.
    #[arg(long, default_value = "cpu")]
    device: DeviceName,
    /// The seed of all noise.
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// The fault to put into the plans.
    #[arg(long)]
    mutant: Option<Mutant>,
}

/// `Precision` by its name on the command line.
#[derive(Clone, Copy, ValueEnum)]
enum PrecisionName {
    F32,
    F16,
}

/// A device by its name on the command line.
#[derive(Clone, Copy, ValueEnum)]
enum DeviceName {
    /// The processor.
    Cpu,
    /// The first Direct3D 12 adapter that is no software, else the first.
    #[cfg(windows)]
    D3d12,
    /// The adapter that Mesa's software driver emulates, by the WebGPU provider.
    #[cfg(target_os = "linux")]
    Webgpu,
}

impl DeviceName {
    fn device(self) -> Result<Device, Failure> {
        let ort = Ort::find(&LibrarySearch::for_tools())?;
        match self {
            // One thread: the oracle's process may use the other cores, and these graphs are too small to share.
            Self::Cpu => Ok(Device::cpu(&ort, CpuOptions { threads: Some(1), deterministic: true })?),
            #[cfg(windows)]
            Self::D3d12 => {
                let gpu = cairn::gpu::Gpu::on_adapter(None)?;
                let options = cairn::runtime::DirectMlOptions { deterministic: true, ..Default::default() };
                Ok(Device::directml(&ort, &gpu, options)?)
            }
            #[cfg(target_os = "linux")]
            Self::Webgpu => {
                let adapter = Some("llvmpipe".to_owned());
                let options = cairn::runtime::WebGpuOptions {
                    deterministic: true,
                    adapter,
                    libraries: LibrarySearch::for_tools(),
                };
                Ok(Device::webgpu(&ort, &options)?)
            }
        }
    }
}

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("parity-trace: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<(), Failure> {
    let device = arguments.device.device()?;
    let bundle = Bundle::open(&arguments.bundle)?;
    let precision = match arguments.precision {
        PrecisionName::F32 => Precision::F32,
        PrecisionName::F16 => Precision::F16,
    };
    let global_window = arguments.global_window.unwrap_or(bundle.geometry().global.window);
    let options =
        WorldOptions { global_window: Some(global_window), precision: Some(precision), ..WorldOptions::default() };
    let world = World::load(&device, &bundle, options)?;
    let point = OperatingPoint {
        global_window,
        schedule: arguments.schedule.clone(),
        cache_mode: arguments.cache,
        pictures_per_latent: bundle.geometry().autoencoder.temporal,
        ..Preset::Stock.operating_point()
    };
    let rollout = Rollout::new(&world, &point, arguments.seed)?;
    let mut tracer = Tracer::new(rollout, arguments.mutant);
    for latent in 0..arguments.latents {
        let recorded = arguments.record.is_empty() || arguments.record.contains(&latent);
        tracer.step(latent, arguments.append.contains(&latent), recorded)?;
    }
    tracer.finish(&arguments.out)
}
