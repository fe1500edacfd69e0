//! The contents of an archive, and their paths.

use std::collections::BTreeSet;
use std::path::Path;

use provision::Console;

use super::dependencies;
use super::library::{self, BuiltLibrary};
use super::runtime;
use super::sbom;
use super::tree::{self, Tree};
use super::unity;
use super::unreal;
use super::{Components, Platform};
use crate::book;
use crate::workspace::Workspace;

/// The archive's own pages; `@VERSION@` and `@ONNXRUNTIME@` stand for versions.
const WINDOWS: &str = include_str!("pages/windows.md");
const LINUX: &str = include_str!("pages/linux.md");
const RUNTIME: &str = include_str!("pages/runtime.md");
const AMD: &str = include_str!("pages/amd.md");

/// The page of DirectML's terms, which is beside every copy of `DirectML.dll`.
pub(crate) const DIRECTML_TERMS: &str = "DirectML-LICENSE.txt";
const DIRECTML: &str = include_str!("pages/DirectML-LICENSE.txt");

/// Files for build systems.
const CMAKE: &str = include_str!("pages/CairnConfig.cmake");
const CMAKE_VERSION: &str = include_str!("pages/CairnConfigVersion.cmake");
const PKG_CONFIG: &str = include_str!("pages/cairn.pc");

/// Licence files that accompany every copy of the library, also where one folder of the archive is copied out: its own and its parts'.
pub(crate) const TERMS: [&str; 4] = ["LICENSE-APACHE", "LICENSE-MIT", dependencies::PAGE, runtime::RUST_NOTICES];

/// The archive of a platform, with the components of its library and of `cairn-check`; with `slim` without Microsoft's libraries. `None` if
/// the slim archive would be the same as the full one.
pub(super) fn archive_tree(
    workspace: &Workspace,
    platform: Platform,
    built: &BuiltLibrary,
    of_library: &Components,
    of_check: &Components,
    slim: bool,
) -> Result<Option<Tree>, String> {
    let version = &of_library.parts.first().ok_or("a library of no parts")?.version;
    let runtimes = platform == Platform::Windows;
    if slim && !runtimes {
        return Ok(None);
    }
    let slim_mark = if slim { "-slim" } else { "" };
    let mut tree = Tree::new(format!("cairn-{version}-{}{slim_mark}", platform.name()));
    let fill = |page: &str| with_runtime_versions(&page.replace("@VERSION@", version));

    for file in ["LICENSE-APACHE", "LICENSE-MIT", "CHANGELOG.md", "samples/worlds/place.ppm"] {
        tree.add_file(file, &workspace.root.join(file))?;
    }
    for folder in ["include/", "samples/host-c/", "samples/scripts/"] {
        tree.add_from_workspace(workspace, folder, |_| true)?;
    }
    tree.add_from_workspace(workspace, "bindings/python/", |file| {
        !["bindings/python/tests/", "bindings/python/wheel/"].iter().any(|tests| file.starts_with(tests))
    })?;
    tree.add_from_workspace(workspace, "bindings/csharp/", |file| !file.starts_with("bindings/csharp/tests/"))?;
    for file in book_files(workspace)? {
        tree.add_file(file.clone(), &workspace.root.join(&file))?;
    }
    tree.add(dependencies::PAGE, dependencies::page("the library", &of_library.parts))?;
    tree.add(dependencies::PAGE_OF_CHECK, dependencies::page("`cairn-check`", &of_check.parts))?;
    tree.add(runtime::RUST_NOTICES, runtime::rust_notices(workspace)?)?;
    tree.add(sbom::NAME, of_library.bill.as_slice())?;
    tree.add(sbom::NAME_OF_CHECK, of_check.bill.as_slice())?;

    let [name, debug] = library::names(platform);
    tree.add(format!("debug/{debug}"), built.debug.as_slice())?;
    tree.add("lib/cmake/Cairn/CairnConfig.cmake", CMAKE)?;
    tree.add("lib/cmake/Cairn/CairnConfigVersion.cmake", fill(CMAKE_VERSION))?;
    // Its parent folder has `runtime` and `amd`, in which it looks for libraries.
    tree.add_program(format!("bin/{}", library::check_name(platform)), built.check.stripped.as_slice())?;
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
            tree.add_from_workspace(workspace, "samples/host-d3d12/", |_| true)?;
            tree.add("amd/README.md", fill(AMD))?;
            let plugin = built.unity.as_ref().ok_or("the Windows library has no plugin for Unity")?;
            unity::add(&mut tree, workspace, plugin, !slim)?;
        }
    }
    if runtimes && !slim {
        for (name, bytes) in runtime_files()? {
            tree.add(format!("runtime/{name}"), bytes)?;
        }
        tree.add("runtime/README.md", fill(RUNTIME))?;
    }
    if let Some(import) = &built.import {
        unreal::add(workspace, &mut tree, &import.msvc)?;
    }
    tree.relink(&[(unity::PACKAGE, unity::FOLDER), (unreal::SOURCE, unreal::FOLDER)]);
    Ok(Some(tree))
}

/// A page with the versions of Microsoft's libraries.
fn with_runtime_versions(page: &str) -> String {
    page.replace("@ONNXRUNTIME@", provision::ONNXRUNTIME_VERSION).replace("@DIRECTML@", provision::DIRECTML_VERSION)
}

/// Microsoft's libraries with their licence files, by name.
pub(super) fn runtime_files() -> Result<Vec<(String, Vec<u8>)>, String> {
    let mut files = vec![(DIRECTML_TERMS.to_owned(), with_runtime_versions(DIRECTML).into_bytes())];
    for path in provision::onnxruntime_with_terms(&Console::new()).map_err(|e| e.to_string())? {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        files.push((name, std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?));
    }
    Ok(files)
}

/// Pages of the book that a host's programmers do not need: how Cairn itself is developed, and whole runs of the comparison and of a
/// sweep. The former run is as large as the library.
const NOT_FOR_HOSTS: [&str; 3] = ["docs/lab.md", "docs/report/", "docs/sweeps/"];

/// The book's chapters in `docs/`, with the images and files that they show. An archive has the other chapters at their own paths.
fn book_files(workspace: &Workspace) -> Result<BTreeSet<String>, String> {
    let chapters = book::chapters(&workspace.read(book::SUMMARY)?)?;
    let mut files = BTreeSet::new();
    let is_wanted =
        |file: &str| file.starts_with("docs/") && !NOT_FOR_HOSTS.iter().any(|unwanted| file.starts_with(unwanted));
    for chapter in chapters.into_iter().filter(|chapter| is_wanted(chapter)) {
        let page = workspace.read(&chapter)?;
        let folder = chapter.rsplit_once('/').map_or("", |(folder, _)| folder);
        let linked = book::links(&page).filter_map(|target| tree::joined(folder, target));
        files.extend(linked.filter(|file| {
            let is_page = Path::new(file).extension().is_some_and(|ending| ending == "md");
            is_wanted(file) && !is_page && workspace.root.join(file).is_file()
        }));
        files.insert(chapter);
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_of_directml_leads_to_the_terms_of_its_version() {
        let page = with_runtime_versions(DIRECTML);
        let terms =
            format!("https://www.nuget.org/packages/Microsoft.AI.DirectML/{}/License", provision::DIRECTML_VERSION);
        assert!(page.contains(&terms) && !page.contains('@'), "{page}");
        assert!(with_runtime_versions(RUNTIME).contains(&terms) && RUNTIME.contains(DIRECTML_TERMS));
    }
}
