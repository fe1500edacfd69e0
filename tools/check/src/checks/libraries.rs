//! Libraries by others: ONNX Runtime, DirectML, Direct3D 12 and AMD's.

use cairn::runtime::Ort;
use cairn::{LibrarySearch, Result};

use crate::outcome::Outcome;
use crate::settings::Settings;

/// ONNX Runtime, and on Windows the DirectML that a device of it loads.
pub(super) fn runtime(settings: &Settings) -> Result<Outcome> {
    let ort = Ort::find(&LibrarySearch::for_tools())?;
    let found = format!("ONNX Runtime {}", ort.version());
    let outcome = on_device(&ort, settings, found)?;
    #[cfg(windows)]
    let outcome = outcome.with_facts(loaded(&["onnxruntime.dll", "directml.dll"]));
    Ok(outcome)
}

#[cfg(windows)]
fn on_device(ort: &Ort, settings: &Settings, found: String) -> Result<Outcome> {
    let gpu = super::adapters::gpu(settings)?;
    let device = cairn::runtime::Device::directml(ort, &gpu, cairn::runtime::DirectMlOptions::default())?;
    Ok(Outcome::pass(format!("{found}, {}", device.describe())))
}

#[cfg(not(windows))]
fn on_device(_: &Ort, _: &Settings, found: String) -> Result<Outcome> {
    Ok(Outcome::pass(format!("{found}, without DirectML, which is a part of Windows")))
}

/// The Direct3D 12 libraries that a device of this process has loaded.
#[cfg(windows)]
pub(super) fn direct3d(settings: &Settings) -> Result<Outcome> {
    let _gpu = super::adapters::gpu(settings)?;
    let facts = loaded(&["d3d12.dll", "d3d12core.dll", "dxgi.dll"]);
    let core = cairn::runtime::loaded_libraries().into_iter().find(|library| is_named(library, "d3d12core.dll"));
    let found = match core {
        Some(core) if is_of_system(&core.path) => {
            format!("D3D12Core.dll {} of the system", core.version.unwrap_or_default())
        }
        Some(core) => {
            format!("D3D12Core.dll {} of an Agility SDK beside a program", core.version.unwrap_or_default())
        }
        None => "Direct3D 12 of the system, without a D3D12Core.dll".to_owned(),
    };
    Ok(Outcome::pass(found).with_facts(facts))
}

/// AMD's libraries, and what they need.
#[cfg(windows)]
pub(super) fn fsr(settings: &Settings) -> Result<Outcome> {
    use cairn::ffx::{Library, LoadOptions, RequirementKind, requirements};

    use crate::outcome::Fact;

    let gpu = super::adapters::gpu(settings)?;
    let options = LoadOptions::from_environment();
    let library = Library::load(&options)?;
    let rows = requirements(&options, &gpu);
    let facts = rows.iter().enumerate().map(|(i, row)| {
        let name = match row.what {
            RequirementKind::Libraries => format!("file {}", i + 1),
            RequirementKind::Provider => "provider".into(),
            RequirementKind::System => "system".into(),
            RequirementKind::Direct3d => "Direct3D 12".into(),
            RequirementKind::ShaderModel => "shader model".into(),
        };
        let met = if row.met { "" } else { ", which is not enough for every provider" };
        Fact { name, text: format!("{} (needed: {}){met}", row.found, row.needed) }
    });
    let facts: Vec<Fact> = facts.collect();
    let provider = rows.iter().find(|row| row.what == RequirementKind::Provider);
    let outcome = match provider {
        Some(row) if row.met => Outcome::pass(format!("{} files, providers: {}", library.files().len(), row.found)),
        Some(row) => Outcome::cannot_tell(
            format!("no provider of AMD's takes this adapter: {}", row.found),
            "Use a newer release of AMD's libraries or a newer driver; Cairn's own generator does without",
        ),
        None => Outcome::cannot_tell("AMD's libraries name no provider", "Use a newer release of AMD's libraries"),
    };
    Ok(outcome.with_facts(facts))
}

/// File name, version and signer of those libraries that this process has loaded, by lower-case names.
#[cfg(windows)]
fn loaded(names: &[&str]) -> Vec<crate::outcome::Fact> {
    let all = cairn::runtime::loaded_libraries();
    let of_name = |name: &&str| {
        let library = all.iter().find(|library| is_named(library, name))?;
        let version = library.version.as_deref().unwrap_or("without a version");
        let signature = if is_of_system(&library.path) {
            "of the system".to_owned()
        } else {
            cairn::ffx::signer_of(&library.path).map_or_else(
                |e| format!("not signed by anyone trusted here: {}", e.cause()),
                |signer| format!("signed by {signer}"),
            )
        };
        let file = library.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Some(crate::outcome::Fact { name: file, text: format!("{version}, {signature}") })
    };
    names.iter().filter_map(of_name).collect()
}

#[cfg(windows)]
fn is_named(library: &cairn::runtime::LoadedLibrary, name: &str) -> bool {
    library.path.file_name().is_some_and(|file| file.eq_ignore_ascii_case(name))
}

/// Whether a file is in Windows' own folder, whose files are signed by catalogues.
#[cfg(windows)]
fn is_of_system(path: &std::path::Path) -> bool {
    let root = std::env::var("SystemRoot").unwrap_or_else(|_| r"C:\Windows".into()).to_ascii_lowercase();
    path.to_string_lossy().to_ascii_lowercase().starts_with(&root)
}
