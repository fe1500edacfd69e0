//! Device on which a world runs: `--device`.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use cairn::bundle::{Bundle, Precision};
use cairn::runtime::{CpuOptions, Device, Ort};
use cairn::world::{World, WorldOptions};
use cairn::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

/// The requested device or, in a manifest, the device used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum DeviceChoice {
    /// A Direct3D 12 adapter on which the world loads, if there is one; otherwise the CPU.
    Auto,
    /// The CPU. Also meant by manifests without a device.
    #[default]
    Cpu,
    /// A Direct3D 12 adapter by its number in the system's list; `None` for the best.
    D3d12(Option<u32>),
}

impl FromStr for DeviceChoice {
    type Err = Error;

    /// Reads `auto`, `cpu`, `d3d12` or `d3d12:N`.
    fn from_str(text: &str) -> Result<Self> {
        match text.split_once(':') {
            None if text == "auto" => Ok(Self::Auto),
            None if text == "cpu" => Ok(Self::Cpu),
            None if text == "d3d12" => Ok(Self::D3d12(None)),
            Some(("d3d12", number)) if number.bytes().all(|b| b.is_ascii_digit()) => {
                number.parse().map(|number| Self::D3d12(Some(number))).map_err(|_| unknown(text))
            }
            _ => Err(unknown(text)),
        }
    }
}

fn unknown(text: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, format!("{text:?} is no device"))
        .field("--device")
        .remedy("Use auto, cpu, d3d12 for the best adapter, or d3d12:N for number N of the system's list, from 0 on")
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cpu => f.write_str("cpu"),
            Self::D3d12(None) => f.write_str("d3d12"),
            Self::D3d12(Some(number)) => write!(f, "d3d12:{number}"),
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
            Self::Cpu | Self::D3d12(Some(_)) => self == wanted,
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
    /// Why `auto` fell back to the CPU, if it did.
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
    let graphics = |number: Option<u32>| {
        let (device, number) = d3d12(ort, number)?;
        // Older bundles hold one precision only.
        let precision = Some(if bundle.has(device.precision()) { device.precision() } else { Precision::F32 });
        let world = World::load(&device, bundle, WorldOptions { precision, ..options.clone() })?;
        Ok(LoadedWorld { world, choice: DeviceChoice::D3d12(Some(number)), fallback: None })
    };
    let processor = |fallback: Option<Error>| {
        let device = Device::cpu(ort, CpuOptions { threads, deterministic: true })?;
        Ok(LoadedWorld { world: World::load(&device, bundle, options.clone())?, choice: DeviceChoice::Cpu, fallback })
    };
    match choice {
        DeviceChoice::Cpu => processor(None),
        DeviceChoice::D3d12(number) => graphics(number),
        DeviceChoice::Auto => graphics(None).or_else(|why| processor(Some(why))),
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
        ] {
            assert_eq!(choice(found).is_what(choice(wanted)), fits, "{found} for {wanted}");
        }
    }

    #[test]
    fn a_choice_is_written_as_it_is_read() {
        for text in ["auto", "cpu", "d3d12", "d3d12:0", "d3d12:17"] {
            assert_eq!(text.parse::<DeviceChoice>().unwrap().to_string(), text);
        }
        for text in ["", "gpu", "d3d12:", "d3d12:-1", "d3d12:+1", "d3d12:99999999999", "cpu:0", "AUTO"] {
            let error = text.parse::<DeviceChoice>().unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("--device")));
        }
    }
}
