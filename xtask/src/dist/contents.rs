//! What is in an archive, and where.

use provision::Console;

use super::Platform;
use super::dependencies::{self, Crate};
use super::library::{self, Built};
use super::sbom;
use super::tree::Tree;
use super::unity;
use super::unreal;
use crate::clone::Clone;

/// The archive's own pages; `@VERSION@` and `@ONNXRUNTIME@` stand for versions.
const WINDOWS: &str = include_str!("pages/windows.md");
const LINUX: &str = include_str!("pages/linux.md");
const RUNTIME: &str = include_str!("pages/runtime.md");
const AMD: &str = include_str!("pages/amd.md");

/// For build systems.
const CMAKE: &str = include_str!("pages/CairnConfig.cmake");
const CMAKE_VERSION: &str = include_str!("pages/CairnConfigVersion.cmake");
const PKG_CONFIG: &str = include_str!("pages/cairn.pc");

/// The archive of a platform; with `slim` without Microsoft's libraries. None where that would be the same archive once more.
pub(super) fn of(
    clone: &Clone,
    platform: Platform,
    built: &Built,
    crates: &[Crate],
    bill: &[u8],
    slim: bool,
) -> Result<Option<Tree>, String> {
    let version = &crates.first().ok_or("a library of no crates")?.version;
    let runtimes = platform == Platform::Windows;
    if slim && !runtimes {
        return Ok(None);
    }
    let slim_mark = if slim { "-slim" } else { "" };
    let mut tree = Tree::new(format!("cairn-{version}-{}{slim_mark}", platform.name()));
    let fill = |page: &str| page.replace("@VERSION@", version).replace("@ONNXRUNTIME@", provision::ONNXRUNTIME_VERSION);

    for file in ["LICENSE-APACHE", "LICENSE-MIT", "CHANGELOG.md", "samples/worlds/place.ppm"] {
        tree.add_file(file, &clone.root.join(file))?;
    }
    for folder in ["include/", "samples/host-c/", "samples/scripts/"] {
        tree.add_clone(clone, folder, |_| true)?;
    }
    tree.add_clone(clone, "bindings/python/", |file| {
        !["bindings/python/tests/", "bindings/python/wheel/"].iter().any(|tests| file.starts_with(tests))
    })?;
    tree.add_clone(clone, "bindings/csharp/", |file| !file.starts_with("bindings/csharp/tests/"))?;
    tree.add_clone(clone, "docs/", |file| {
        ["docs/bundle.md", "docs/bundle.schema.json", "docs/control-script.md", "docs/fsr.md"].contains(&file)
    })?;
    tree.add("THIRD-PARTY.md", dependencies::page(crates))?;
    tree.add(sbom::NAME, bill)?;

    let [name, debug] = library::names(platform);
    tree.add(format!("debug/{debug}"), built.debug.as_slice())?;
    tree.add("lib/cmake/Cairn/CairnConfig.cmake", CMAKE)?;
    tree.add("lib/cmake/Cairn/CairnConfigVersion.cmake", fill(CMAKE_VERSION))?;
    match platform {
        Platform::Linux => {
            tree.add("README.md", fill(LINUX))?;
            tree.add(format!("lib/{name}"), built.library.as_slice())?;
            tree.add("lib/pkgconfig/cairn.pc", fill(PKG_CONFIG))?;
        }
        Platform::Windows => {
            let import = built.import.as_ref().ok_or("the Windows library has no import library")?;
            tree.add("README.md", fill(WINDOWS))?;
            tree.add(format!("bin/{name}"), built.library.as_slice())?;
            tree.add("lib/cairn.lib", import.msvc.as_slice())?;
            tree.add("lib/libcairn.dll.a", import.mingw.as_slice())?;
            tree.add_clone(clone, "samples/host-d3d12/", |_| true)?;
            tree.add("amd/README.md", fill(AMD))?;
            let plugin = built.unity.as_ref().ok_or("the Windows library has no plugin for Unity")?;
            unity::add(&mut tree, clone, plugin, !slim)?;
        }
    }
    if runtimes && !slim {
        for file in provision::onnxruntime_with_terms(&Console::new()).map_err(|e| e.to_string())? {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            tree.add_file(format!("runtime/{name}"), &file)?;
        }
        tree.add("runtime/README.md", fill(RUNTIME))?;
    }
    if let Some(import) = &built.import {
        unreal::add(clone, &mut tree, &import.msvc)?;
    }
    tree.unlink();
    Ok(Some(tree))
}
