//! The whole plugin for Unreal Engine: its sources from the repository, and the library where its build files expect it.

use std::fs;
use std::path::Path;

use super::contents::TERMS;
use super::tree::Tree;
use crate::workspace::Workspace;

/// Folder in the repository: the binding with its page, and the plugin in it.
pub(super) const SOURCE: &str = "bindings/unreal/";
pub(crate) const PLUGIN: &str = "bindings/unreal/Cairn/";

/// Folder in an archive.
pub(super) const FOLDER: &str = "unreal/";
const PLUGIN_FOLDER: &str = "unreal/Cairn/";

/// Files of the library that the plugin needs: path in the archive, and path in the plugin.
pub(crate) const LIBRARY_FILES: [(&str, &str); 5] = [
    ("include/cairn.h", "Source/ThirdParty/CairnLibrary/include/cairn.h"),
    ("include/cairn.hpp", "Source/ThirdParty/CairnLibrary/include/cairn.hpp"),
    ("include/cairn_ld.h", "Source/ThirdParty/CairnLibrary/include/cairn_ld.h"),
    ("samples/worlds/place.ppm", "Resources/place.ppm"),
    ("bin/cairn.dll", "Binaries/ThirdParty/Cairn/Win64/cairn.dll"),
];

/// Adds the plugin to an archive that has the library and its licence files. The archive has Microsoft's libraries once; users of the
/// plugin put them beside it.
pub(super) fn add(workspace: &Workspace, tree: &mut Tree, import: &[u8]) -> Result<(), String> {
    for file in workspace.files()?.iter().filter(|file| file.starts_with(PLUGIN)) {
        let path = file.replacen(PLUGIN, PLUGIN_FOLDER, 1);
        tree.add_file(path, &workspace.root.join(file))?;
    }
    tree.add_file(format!("{FOLDER}README.md"), &workspace.root.join(format!("{SOURCE}README.md")))?;
    for (from, to) in LIBRARY_FILES.into_iter().chain(TERMS.map(|name| (name, name))) {
        tree.copy(from, format!("{PLUGIN_FOLDER}{to}"))?;
    }
    tree.add(format!("{PLUGIN_FOLDER}Source/ThirdParty/CairnLibrary/lib/cairn.lib"), import)
}

/// Assembles the plugin in a folder, from the repository and a built library.
pub(crate) fn assemble(workspace: &Workspace, library: &Path, folder: &Path) -> Result<(), String> {
    let copy = |from: &Path, to: &str| {
        let to = folder.join(to);
        fs::create_dir_all(to.parent().unwrap_or(folder)).map_err(|e| format!("{}: {e}", to.display()))?;
        fs::copy(from, &to).map(|_| ()).map_err(|e| format!("{}: {e}", from.display()))
    };
    for file in workspace.files()?.iter() {
        if let Some(path) = file.strip_prefix(PLUGIN) {
            copy(&workspace.root.join(file), path)?;
        }
    }
    LIBRARY_FILES.iter().try_for_each(|(from, to)| match from.strip_prefix("bin/") {
        Some(name) => copy(&library.join(name), to),
        None => copy(&workspace.root.join(from), to),
    })
}
