//! Adapters of the machine, features of one, and Direct3D's debug layer.

use cairn::gpu::windows::Win32::Graphics::Direct3D::*;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use cairn::gpu::{Adapter, Gpu, adapters};
use cairn::{Error, ErrorKind, Result};

use crate::outcome::{Better, Outcome};
use crate::settings::Settings;

/// A device on the adapter of the settings.
pub(super) fn gpu(settings: &Settings) -> Result<Gpu> {
    let luid = settings.adapter.map(|index| {
        let all = adapters()?;
        all.get(index).map(|adapter| adapter.luid).ok_or_else(|| {
            Error::new(ErrorKind::Unsupported, format!("there is no adapter {index}, only {}", all.len()))
                .field("--adapter")
                .remedy("Use an index that the line `adapters` lists")
        })
    });
    Gpu::on_adapter(luid.transpose()?)
}

/// Every adapter with Direct3D 12, with its driver.
pub(super) fn list(_: &Settings) -> Result<Outcome> {
    const DRIVER: &str = "Install the driver of the graphics card's maker";
    let all = adapters()?;
    let hardware = all.iter().filter(|adapter| !adapter.software).count();
    let outcome = match (hardware, all.first()) {
        (0, None) => Outcome::fail("no adapter has Direct3D 12", DRIVER),
        (0, Some(first)) => Outcome::cannot_tell(format!("only software adapters: {}", described(first)), DRIVER),
        _ => {
            let names: Vec<String> = all.iter().filter(|adapter| !adapter.software).map(described).collect();
            Outcome::pass(names.join("; "))
        }
    };
    let facts = all.iter().enumerate().map(|(i, adapter)| crate::outcome::Fact {
        name: format!("adapter {i}"),
        text: format!(
            "{}, vendor {:04x}, device {:04x}, {} MiB{}",
            described(adapter),
            adapter.vendor,
            adapter.device,
            adapter.memory >> 20,
            if adapter.software { ", software" } else { "" }
        ),
    });
    Ok(outcome.with_facts(facts))
}

fn described(adapter: &Adapter) -> String {
    format!("{}, driver {}", adapter.description, adapter.driver.as_deref().unwrap_or("unknown"))
}

/// Feature level, shader model, other features that results or speed depend on, and the memory budget.
pub(super) fn features(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let device = gpu.device();
    let levels = [
        (D3D_FEATURE_LEVEL_11_0, "11_0"),
        (D3D_FEATURE_LEVEL_11_1, "11_1"),
        (D3D_FEATURE_LEVEL_12_0, "12_0"),
        (D3D_FEATURE_LEVEL_12_1, "12_1"),
        (D3D_FEATURE_LEVEL_12_2, "12_2"),
    ];
    let wanted = levels.map(|(level, _)| level);
    let mut level = D3D12_FEATURE_DATA_FEATURE_LEVELS {
        NumFeatureLevels: wanted.len() as u32,
        pFeatureLevelsRequested: wanted.as_ptr(),
        ..Default::default()
    };
    let level = feature(device, D3D12_FEATURE_FEATURE_LEVELS, &mut level)
        .and_then(|found| levels.iter().find(|(level, _)| *level == found.MaxSupportedFeatureLevel));
    let level = level.map_or("unknown", |(_, name)| name);
    let model = shader_model(device);
    let mut options = D3D12_FEATURE_DATA_D3D12_OPTIONS::default();
    let typed_loads = feature(device, D3D12_FEATURE_D3D12_OPTIONS, &mut options)
        .map(|options| options.TypedUAVLoadAdditionalFormats.as_bool());
    let mut waves = D3D12_FEATURE_DATA_D3D12_OPTIONS1::default();
    let waves = feature(device, D3D12_FEATURE_D3D12_OPTIONS1, &mut waves)
        .filter(|found| found.WaveOps.as_bool())
        .map(|found| format!("{} to {} threads", found.WaveLaneCountMin, found.WaveLaneCountMax));
    let mut halves = D3D12_FEATURE_DATA_D3D12_OPTIONS4::default();
    let halves = feature(device, D3D12_FEATURE_D3D12_OPTIONS4, &mut halves)
        .map(|found| found.Native16BitShaderOpsSupported.as_bool());
    let mut architecture = D3D12_FEATURE_DATA_ARCHITECTURE::default();
    let shared = feature(device, D3D12_FEATURE_ARCHITECTURE, &mut architecture).map(|found| found.UMA.as_bool());
    // SAFETY: a live queue.
    let clock = unsafe { gpu.frames().d3d12().GetTimestampFrequency() }.unwrap_or(0);
    let adapter = gpu.adapter()?;
    let found = format!("{}: feature level {level}, shader model {model}", described(&adapter));
    let outcome = if clock == 0 {
        Outcome::cannot_tell(format!("{found}, but it has no clock"), "Update the graphics driver")
    } else {
        Outcome::pass(found)
    };
    let yes = |has: Option<bool>| has.map_or("unknown", |has| if has { "yes" } else { "no" });
    let mut outcome = outcome
        .fact("adapter", &adapter.description)
        .fact("driver", adapter.driver.as_deref().unwrap_or("unknown"))
        .fact("feature level", level)
        .fact("shader model", model)
        .fact("typed loads of more formats", yes(typed_loads))
        .fact("waves", waves.unwrap_or_else(|| "none".into()))
        .fact("16-bit arithmetic in shaders", yes(halves))
        .fact("memory shared with the processor", yes(shared))
        .figure("clock of the GPU", clock as f64 / 1e6, "MHz", Better::Neither);
    if let Some(budget) = gpu.budget()? {
        let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        outcome = outcome.figure("memory budget", mebibytes(budget.granted), "MiB", Better::Neither).figure(
            "memory used",
            mebibytes(budget.used),
            "MiB",
            Better::Neither,
        );
    }
    Ok(outcome)
}

/// The answer to a question about features; `None` if Direct3D does not know the question.
fn feature<'a, T>(device: &ID3D12Device, question: D3D12_FEATURE, answer: &'a mut T) -> Option<&'a T> {
    // SAFETY: a live device, and the struct of the question, which lives during the call.
    unsafe { device.CheckFeatureSupport(question, (&raw mut *answer).cast(), size_of::<T>() as u32) }.ok()?;
    Some(answer)
}

/// The highest shader model, e.g. `6.6`. A Direct3D that does not know the highest refuses the question, so lower ones are asked.
fn shader_model(device: &ID3D12Device) -> String {
    let known = [
        D3D_SHADER_MODEL_6_8,
        D3D_SHADER_MODEL_6_7,
        D3D_SHADER_MODEL_6_6,
        D3D_SHADER_MODEL_6_5,
        D3D_SHADER_MODEL_6_2,
        D3D_SHADER_MODEL_6_0,
        D3D_SHADER_MODEL_5_1,
    ];
    let found = known.into_iter().find_map(|model| {
        let mut asked = D3D12_FEATURE_DATA_SHADER_MODEL { HighestShaderModel: model };
        feature(device, D3D12_FEATURE_SHADER_MODEL, &mut asked).map(|found| found.HighestShaderModel.0)
    });
    found.map_or("unknown".into(), |model| format!("{}.{}", model >> 4, model & 15))
}

/// Whether the debug layer is installed, and whether it has GPU-based validation.
pub(super) fn debug_layer(_: &Settings) -> Result<Outcome> {
    let mut debug: Option<ID3D12Debug> = None;
    // SAFETY: the variable lives during the call.
    let found = unsafe { D3D12GetDebugInterface(&mut debug) };
    let Some(debug) = debug.filter(|_| found.is_ok()) else {
        return Ok(Outcome::cannot_tell(
            "the debug layer is not installed",
            "In Windows' settings add the optional feature Graphics Tools, if errors are to be looked for; games do not need it",
        ));
    };
    let validates = debug.cast::<ID3D12Debug1>().is_ok();
    let words = if validates { "with" } else { "without" };
    Ok(Outcome::pass(format!("the debug layer is installed, {words} GPU-based validation"))
        .fact("GPU-based validation", if validates { "yes" } else { "no" }))
}
