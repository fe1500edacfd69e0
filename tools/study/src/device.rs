//! Device on which a world runs: `--device`.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use cairn::bundle::{Bundle, Precision};
use cairn::runtime::{CpuOptions, Device, Ort, WebGpuOptions};
use cairn::world::{World, WorldOptions};
use cairn::{Error, ErrorKind, LibrarySearch, Result};
use serde::{Deserialize, Serialize};

/// The requested device or, in a manifest, the device used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum DeviceChoice {
    /// The first on which the world loads of: a Direct3D 12 adapter, an adapter by the WebGPU provider, the CPU.
    Auto,
    /// The CPU. Also meant by manifests without a device.
    #[default]
    Cpu,
    /// A Direct3D 12 adapter by its number in the system's list; `None` for the best.
    D3d12(Option<u32>),
    /// An adapter by ONNX Runtime's WebGPU provider, by its number in Vulkan's list; `None` for the fastest.
    WebGpu(Option<u32>),
}

impl FromStr for DeviceChoice {
    type Err = Error;

    /// Reads `auto`, `cpu`, `d3d12`, `d3d12:N`, `webgpu` or `webgpu:N`.
    fn from_str(text: &str) -> Result<Self> {
        let (kind, number) = match text.split_once(':') {
            None => (text, None),
            Some((kind, number)) if number.bytes().all(|b| b.is_ascii_digit()) => {
                (kind, Some(number.parse().map_err(|_| unknown(text))?))
            }
            Some(_) => return Err(unknown(text)),
        };
        match (kind, number) {
            ("auto", None) => Ok(Self::Auto),
            ("cpu", None) => Ok(Self::Cpu),
            ("d3d12", number) => Ok(Self::D3d12(number)),
            ("webgpu", number) => Ok(Self::WebGpu(number)),
            _ => Err(unknown(text)),
        }
    }
}

fn unknown(text: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, format!("{text:?} is no device"))
        .field("--device")
        .remedy(
            "Use auto, cpu, d3d12 or webgpu for the best adapter, or d3d12:N or webgpu:N for number N of the system's or Vulkan's list, \
             from 0 on",
        )
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cpu => f.write_str("cpu"),
            Self::D3d12(None) => f.write_str("d3d12"),
            Self::D3d12(Some(number)) => write!(f, "d3d12:{number}"),
            Self::WebGpu(None) => f.write_str("webgpu"),
            Self::WebGpu(Some(number)) => write!(f, "webgpu:{number}"),
        }
    }
}

impl TryFrom<String> for DeviceChoice {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<DeviceChoice> for String {
    fn from(choice: DeviceChoice) -> Self {
        choice.to_string()
    }
}

impl DeviceChoice {
    /// Whether `wanted` may resolve to this device.
    pub(crate) fn is_what(self, wanted: Self) -> bool {
        match wanted {
            Self::Auto => true,
            Self::D3d12(None) => matches!(self, Self::D3d12(_)),
            Self::WebGpu(None) => matches!(self, Self::WebGpu(_)),
            Self::Cpu | Self::D3d12(Some(_)) | Self::WebGpu(Some(_)) => self == wanted,
        }
    }

    /// Whether this is the device meant by manifests without one.
    pub(crate) fn is_cpu(&self) -> bool {
        *self == Self::Cpu
    }
}

/// A world on its device.
pub(crate) struct LoadedWorld {
    pub(crate) world: Arc<World>,
    /// The device as a choice that selects it again on this machine.
    pub(crate) choice: DeviceChoice,
    /// Why `auto` did not take the devices before this one, if it did not.
    pub(crate) fallback: Option<Error>,
}

/// Loads `bundle` on the device for `choice`; on the CPU with `threads`.
pub(crate) fn load(
    choice: DeviceChoice,
    ort: &Ort,
    threads: Option<usize>,
    bundle: &Arc<Bundle>,
    options: &WorldOptions,
) -> Result<LoadedWorld> {
    let graphics = |device: &Device, choice| {
        // Older bundles hold one precision only.
        let precision = Some(if bundle.has(device.precision()) { device.precision() } else { Precision::F32 });
        let world = World::load(device, bundle, WorldOptions { precision, ..options.clone() })?;
        Ok(LoadedWorld { world, choice, fallback: None })
    };
    let on_d3d12 = |number| {
        let (device, number) = d3d12(ort, number)?;
        graphics(&device, DeviceChoice::D3d12(Some(number)))
    };
    let on_webgpu = |number: Option<u32>| {
        let adapter = number.map(|number| number.to_string());
        let options = WebGpuOptions { deterministic: true, adapter, libraries: LibrarySearch::for_tools() };
        let device = Device::webgpu(ort, &options)?;
        graphics(&device, DeviceChoice::WebGpu(number))
    };
    let on_cpu = || {
        let device = Device::cpu(ort, CpuOptions { threads, deterministic: true })?;
        let world = World::load(&device, bundle, options.clone())?;
        Ok(LoadedWorld { world, choice: DeviceChoice::Cpu, fallback: None })
    };
    match choice {
        DeviceChoice::Cpu => on_cpu(),
        DeviceChoice::D3d12(number) => on_d3d12(number),
        DeviceChoice::WebGpu(number) => on_webgpu(number),
        DeviceChoice::Auto => {
            let mut refusals = Vec::new();
            if cfg!(windows) {
                match on_d3d12(None) {
                    Ok(world) => return Ok(world),
                    Err(why) => refusals.push(format!("not d3d12: {}", why.cause())),
                }
            }
            let loaded = on_webgpu(None).or_else(|why| {
                refusals.push(format!("not webgpu: {}", why.cause()));
                on_cpu()
            })?;
            let why = (!refusals.is_empty()).then(|| Error::new(ErrorKind::Unsupported, refusals.join("; ")));
            Ok(LoadedWorld { fallback: why, ..loaded })
        }
    }
}

/// Opens adapter `number` of the system's list, or the first that is not a software adapter. Also returns the number.
#[cfg(windows)]
fn d3d12(ort: &Ort, number: Option<u32>) -> Result<(Device, u32)> {
    let mut adapters = (0..).zip(cairn::gpu::adapters()?);
    let found = match number {
        Some(number) => adapters.find(|(i, _)| *i == number),
        None => adapters.find(|(_, adapter)| !adapter.software),
    };
    let (number, adapter) = found.ok_or_else(|| match number {
        Some(number) => Error::new(ErrorKind::InvalidArgument, format!("there is no adapter number {number}"))
            .field("--device")
            .remedy("Use d3d12 for the best adapter"),
        None => Error::new(ErrorKind::Unsupported, "this machine has no adapter for Direct3D 12 but software")
            .field("--device")
            .remedy("Use cpu, or name the software by its number: d3d12:0"),
    })?;
    let gpu = cairn::gpu::Gpu::on_adapter(Some(adapter.luid))?;
    let options = cairn::runtime::DirectMlOptions { deterministic: true, ..Default::default() };
    Ok((Device::directml(ort, &gpu, options)?, number))
}

/// Not available on this platform.
#[cfg(not(windows))]
fn d3d12(_: &Ort, _: Option<u32>) -> Result<(Device, u32)> {
    Err(Error::new(ErrorKind::Unsupported, "Direct3D 12 is available on Windows only")
        .field("--device")
        .remedy("Use cpu or auto"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_knows_what_it_may_have_come_to() {
        let choice = |text: &str| text.parse::<DeviceChoice>().unwrap();
        for (found, wanted, fits) in [
            ("cpu", "cpu", true),
            ("d3d12:1", "d3d12", true),
            ("d3d12:1", "d3d12:1", true),
            ("d3d12:1", "d3d12:0", false),
            ("cpu", "d3d12", false),
            ("d3d12:0", "cpu", false),
            ("cpu", "auto", true),
            ("d3d12:0", "auto", true),
            ("webgpu", "auto", true),
            ("webgpu:0", "webgpu", true),
            ("webgpu", "d3d12", false),
        ] {
            assert_eq!(choice(found).is_what(choice(wanted)), fits, "{found} for {wanted}");
        }
    }

    #[test]
    fn a_choice_is_written_as_it_is_read() {
        for text in ["auto", "cpu", "d3d12", "d3d12:0", "d3d12:17", "webgpu", "webgpu:3"] {
            assert_eq!(text.parse::<DeviceChoice>().unwrap().to_string(), text);
        }
        for text in ["", "gpu", "d3d12:", "d3d12:-1", "d3d12:+1", "d3d12:99999999999", "cpu:0", "AUTO"] {
            let error = text.parse::<DeviceChoice>().unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("--device")));
        }
    }
}
