//! Checks what AMD's frame generation needs against this machine and process: libraries, provider, system, Direct3D and shader
//! model. What is missing limits which providers can run. Windows only.

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12::{
    D3D_SHADER_MODEL_6_6, D3D12_FEATURE_DATA_SHADER_MODEL, D3D12_FEATURE_SHADER_MODEL,
};
use windows::core::Interface;

use super::library::{FileVersion, Module};
use super::provider::names_of;
use super::{Effect, Library, LoadOptions, versions};
use crate::gpu::{Gpu, System};
use crate::{Error, Result};

/// One requirement of AMD's frame generation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Requirement {
    /// The kind of requirement.
    pub what: RequirementKind,
    /// All providers that need it can run. If false, `needed` says which cannot.
    pub met: bool,
    /// What is needed, as text for people.
    pub needed: &'static str,
    /// What was found, as text for people.
    pub found: String,
}

/// Kinds of requirements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RequirementKind {
    /// AMD's libraries: one row for each file found.
    Libraries,
    /// A provider for the device, in the libraries or the driver.
    Provider,
    /// The Windows build.
    System,
    /// The Direct3D 12 library, of the system or of a program's Agility SDK.
    Direct3d,
    /// The device's highest shader model.
    ShaderModel,
}

/// The first build of Windows 11, which the ml providers require.
const WINDOWS_11: u32 = 22000;

/// The first release of the Agility SDK with shader model 6.6, by the version of its D3D12Core.dll.
const AGILITY: FileVersion = FileVersion([1, 4, 9, 0]);

/// Checks all requirements of frame generation on `gpu`; loads AMD's libraries as [`Library::load`] does. A missing part is a row
/// and not an error: Cairn's other generators do not need it.
pub fn requirements(options: &LoadOptions, gpu: &Gpu) -> Vec<Requirement> {
    let library = Library::load(options);
    let mut rows = libraries(&library);
    rows.extend([provider(&library, gpu), system(), direct3d(), shader_model(gpu)]);
    rows
}

fn libraries(library: &Result<Library>) -> Vec<Requirement> {
    let row = |met, found| {
        let needed = "AMD's loader and effect libraries of SDK 2.0 or later, or its whole library of 1.1";
        Requirement { what: RequirementKind::Libraries, met, needed, found }
    };
    match library {
        Ok(library) => library
            .files()
            .iter()
            .map(|file| {
                let version = file.version.map_or("without a version".to_owned(), |version| version.to_string());
                let signer = file.signer.as_ref().map_or(String::new(), |signer| format!(", signed by {signer}"));
                let fault = file.fault.as_ref().map_or(String::new(), |fault| format!(", not used: {fault}"));
                row(file.fault.is_none(), format!("{} {version}{signer}{fault}", file.path.display()))
            })
            .collect(),
        Err(why) => vec![row(false, why.to_string())],
    }
}

fn provider(library: &Result<Library>, gpu: &Gpu) -> Requirement {
    let offered = library.as_ref().map_err(Error::clone).and_then(|library| {
        let api = library.api(Effect::FrameGeneration)?;
        // SAFETY: a live device.
        unsafe { versions(api, Effect::FrameGeneration, gpu.device().as_raw()) }
    });
    let (met, found) = match offered {
        Ok(offered) => (true, names_of(&offered)),
        Err(why) => (false, why.to_string()),
    };
    Requirement {
        what: RequirementKind::Provider,
        met,
        needed: "a provider of frame generation that takes the device",
        found,
    }
}

fn system() -> Requirement {
    let System { build, wine } = System::current();
    let mut found = build.map_or("unknown".to_owned(), |[major, minor, build]| format!("{major}.{minor}.{build}"));
    if let Some(version) = wine {
        found =
            format!("{found}, on Wine {version}: nothing of AMD's is promised there, and analytic is what runs best");
    }
    let met = build.is_some_and(|[_, _, build]| build >= WINDOWS_11);
    let needed = "Windows 11 (build 22000) for ml; Windows 10 for analytic";
    Requirement { what: RequirementKind::System, met, needed, found }
}

/// The Direct3D 12 library loaded in this process; there is one, as there is a device.
fn direct3d() -> Requirement {
    let module = Module::namesakes("d3d12core.dll")
        .into_iter()
        .next()
        .or_else(|| Module::namesakes("d3d12.dll").into_iter().next());
    let path = module.map(Module::path);
    let version = path.as_deref().and_then(FileVersion::read);
    let found = match (&path, version) {
        (Some(path), Some(version)) => format!("{} {version}", path.display()),
        (Some(path), None) => format!("{} without a version", path.display()),
        (None, _) => "none".to_owned(),
    };
    let needed = "D3D12Core.dll of Windows 11, or of the Agility SDK 1.4.9 or later, for ml";
    Requirement {
        what: RequirementKind::Direct3d,
        met: version.is_some_and(|version| version >= AGILITY),
        needed,
        found,
    }
}

fn shader_model(gpu: &Gpu) -> Requirement {
    let mut model = D3D12_FEATURE_DATA_SHADER_MODEL { HighestShaderModel: D3D_SHADER_MODEL_6_6 };
    let (output, size) = ((&raw mut model).cast::<c_void>(), size_of_val(&model) as u32);
    // SAFETY: a live device and the struct of this feature. A runtime that does not know the requested shader model fails.
    let known = unsafe { gpu.device().CheckFeatureSupport(D3D12_FEATURE_SHADER_MODEL, output, size) }.is_ok();
    let highest = model.HighestShaderModel;
    let found = if known { format!("{}.{}", highest.0 >> 4, highest.0 & 0xf) } else { "below 6.6".to_owned() };
    let met = known && highest.0 >= D3D_SHADER_MODEL_6_6.0;
    Requirement { what: RequirementKind::ShaderModel, met, needed: "6.6 for ml; 6.2 for analytic", found }
}
