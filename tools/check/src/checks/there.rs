//! What is there: adapters, libraries, the debug layer.

use std::ffi::c_void;
use std::path::Path;

use cairn::ffx::signer_of;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D::*;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::runtime::{Device, DirectMlOptions, Ort, loaded_libraries};

use super::debug_layer::debug_interface;
use super::{Settings, fsr, machine};
use crate::finding::{Checked, Finding};

/// Calls `CheckFeatureSupport`; `None` if the runtime does not know the feature, or a value in `data`.
fn feature<T>(gpu: &Gpu, feature: D3D12_FEATURE, data: &mut T) -> Option<()> {
    // SAFETY: a live device, and the struct of this feature with its size.
    unsafe { gpu.device().CheckFeatureSupport(feature, (&raw mut *data).cast::<c_void>(), size_of::<T>() as u32) }.ok()
}

/// The highest feature level, such as `12_1`.
pub(super) fn feature_level(gpu: &Gpu) -> Option<String> {
    let levels = [
        D3D_FEATURE_LEVEL_11_0,
        D3D_FEATURE_LEVEL_11_1,
        D3D_FEATURE_LEVEL_12_0,
        D3D_FEATURE_LEVEL_12_1,
        D3D_FEATURE_LEVEL_12_2,
    ];
    // A runtime that does not know the highest level refuses the whole list.
    (1..=levels.len()).rev().find_map(|count| {
        let mut data = D3D12_FEATURE_DATA_FEATURE_LEVELS {
            NumFeatureLevels: count as u32,
            pFeatureLevelsRequested: levels.as_ptr(),
            ..Default::default()
        };
        feature(gpu, D3D12_FEATURE_FEATURE_LEVELS, &mut data)?;
        let level = data.MaxSupportedFeatureLevel.0;
        Some(format!("{}_{}", level >> 12, level >> 8 & 0xf))
    })
}

/// The highest shader model, such as `6.6`.
pub(super) fn shader_model(gpu: &Gpu) -> Option<String> {
    let models = [0x69, 0x68, 0x67, 0x66, 0x65, 0x64, 0x63, 0x62, 0x61, 0x60, 0x51];
    models.into_iter().find_map(|model| {
        let mut data = D3D12_FEATURE_DATA_SHADER_MODEL { HighestShaderModel: D3D_SHADER_MODEL(model) };
        feature(gpu, D3D12_FEATURE_SHADER_MODEL, &mut data)?;
        let model = data.HighestShaderModel.0;
        Some(format!("{}.{}", model >> 4, model & 0xf))
    })
}

/// Every adapter, and that a device can be made on the judged one.
pub(super) fn adapters(settings: &Settings) -> Checked {
    let gpu = settings.gpu()?;
    let judged = gpu.adapter()?;
    let mut architecture = D3D12_FEATURE_DATA_ARCHITECTURE::default();
    let is_unified = feature(&gpu, D3D12_FEATURE_ARCHITECTURE, &mut architecture).map(|()| architecture.UMA.as_bool());
    let count = machine::adapters().len();
    let unknown = || "unknown".to_owned();
    let sentence = format!(
        "{count} with Direct3D 12; {} is judged, driver {}, feature level {}, shader model {}, {} MiB of its own memory, {}",
        judged.description,
        judged.driver.clone().unwrap_or_else(unknown),
        feature_level(&gpu).unwrap_or_else(unknown),
        shader_model(&gpu).unwrap_or_else(unknown),
        judged.memory >> 20,
        match is_unified {
            Some(true) => "which it shares with the processor",
            Some(false) => "apart from the processor's",
            None => "of unknown architecture",
        }
    );
    Ok(Finding::pass(sentence).figure("memory of the adapter", (judged.memory >> 20) as f64, "MiB"))
}

/// The libraries that decide results, with versions and signers.
pub(super) fn libraries(settings: &Settings) -> Checked {
    let gpu = settings.gpu()?;
    let search = settings.libraries();
    let device = Ort::find(&search).and_then(|ort| Device::directml(&ort, &gpu, DirectMlOptions::default()));
    // Loads what is signed; the list below has what was loaded.
    let amd = fsr::library(settings);
    let mut lines = Vec::new();
    for library in loaded_libraries() {
        let version = library.version.unwrap_or_else(|| "no version".to_owned());
        lines.push(format!("{} {version}, {}", name(&library.path), signature(&library.path)));
    }
    match &amd {
        Ok(library) => {
            let faulty = library.files().iter().filter(|file| file.fault.is_some());
            lines.extend(faulty.map(|file| format!("{} is not used", name(&file.path))));
        }
        Err(_) => lines.push("AMD's are not there or not signed".to_owned()),
    }
    let sentence = lines.join("; ");
    Ok(match device {
        Ok(_) => Finding::pass(sentence),
        Err(why) => {
            let found = Finding::from(why);
            Finding { sentence: format!("{}. There: {sentence}", found.sentence), ..found }
        }
    })
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn signature(path: &Path) -> String {
    match signer_of(path) {
        Ok(signer) => format!("signed by {signer}"),
        Err(why) => format!("no signer is known: {}", why.cause()),
    }
}

/// Whether the debug layer is installed, and whose Direct3D 12 the process has.
pub(super) fn debug_layer(settings: &Settings) -> Checked {
    let layer = debug_interface();
    let _gpu = settings.gpu()?;
    let core = loaded_libraries().into_iter().find(|library| name(&library.path).eq_ignore_ascii_case("d3d12core.dll"));
    let runtime = match &core {
        Some(core) => {
            let folder = core.path.parent().map(name).unwrap_or_default();
            let whose = if folder.eq_ignore_ascii_case("system32") { "the system's" } else { "that of an Agility SDK" };
            format!("Direct3D 12 is {whose}, D3D12Core.dll {}", core.version.as_deref().unwrap_or("without a version"))
        }
        None => "The process has no D3D12Core.dll: Direct3D 12 is that of an old Windows, or another's".to_owned(),
    };
    Ok(match layer {
        Some(_) => Finding::pass(format!("The debug layer is installed. {runtime}")),
        None => Finding::cannot_tell(
            format!("The debug layer is not installed. {runtime}"),
            "To have it, add the optional feature Graphics Tools in the settings of Windows",
        ),
    })
}
