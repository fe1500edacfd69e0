//! The package for Unity: its own files, the C# binding unchanged, the plugin, and Unity's `.meta` file beside every file.

use sha2::{Digest, Sha256};

use super::contents::{TERMS, runtime_files};
use super::tree::Tree;
use crate::workspace::Workspace;

/// Folder of the package's own files.
pub(crate) const PACKAGE: &str = "bindings/unity/";

/// Folder of the package in the archive.
pub(super) const FOLDER: &str = "unity/com.cairn.unity/";

/// Folder of native plugins for Windows on x86-64 in a package.
const PLUGINS: &str = "Plugins/x86_64/";

/// Whether a file below [`PACKAGE`] is part of the package: all but the plugin's sources, tests, and their page.
pub(crate) fn is_package(file: &str) -> bool {
    file.strip_prefix(PACKAGE)
        .is_some_and(|file| !file.starts_with("plugin/") && !file.starts_with("tests/") && file != "README.md")
}

/// Adds the package to an archive that already has the licence files; with `runtimes`, also Microsoft's libraries and their terms beside the plugin.
pub(super) fn add(tree: &mut Tree, workspace: &Workspace, plugin: &[u8], runtimes: bool) -> Result<(), String> {
    let mut files = Vec::new();
    for file in workspace.files()? {
        let name = match file.strip_prefix("bindings/csharp/src/") {
            Some(source) => format!("Runtime/Binding/{source}"),
            None if is_package(&file) => file[PACKAGE.len()..].to_owned(),
            None => continue,
        };
        let path = workspace.root.join(&file);
        files.push((name, std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?));
    }
    let picture_file = workspace.root.join("samples/worlds/place.ppm");
    // Unity cannot import PPM; it passes `.bytes` files on unchanged.
    let picture = std::fs::read(&picture_file).map_err(|e| format!("{}: {e}", picture_file.display()))?;
    files.push(("Samples~/Walk/Place.bytes".to_owned(), picture));
    files.push((format!("{PLUGINS}cairn_unity.dll"), plugin.to_vec()));
    if runtimes {
        files.extend(runtime_files()?.into_iter().map(|(name, bytes)| (format!("{PLUGINS}{name}"), bytes)));
    }
    for (name, beside) in descriptions(files.iter().map(|(name, _)| name.as_str()).chain(TERMS)) {
        tree.add(format!("{FOLDER}{name}"), beside)?;
    }
    TERMS.into_iter().try_for_each(|name| tree.copy(name, format!("{FOLDER}{name}")))?;
    files.into_iter().try_for_each(|(name, bytes)| tree.add(format!("{FOLDER}{name}"), bytes))
}

/// `.meta` files of a package's files and folders; Unity ignores files of an installed package that lack one. Unity does not read folders
/// whose name ends in `~`.
fn descriptions<'a>(files: impl Iterator<Item = &'a str>) -> Vec<(String, String)> {
    let mut made = std::collections::BTreeMap::new();
    for file in files {
        let parts: Vec<&str> = file.split('/').collect();
        if parts.iter().any(|part| part.ends_with('~')) {
            continue;
        }
        for end in 1..parts.len() {
            let folder = parts[..end].join("/");
            let text = description(&folder, "folderAsset: yes\nDefaultImporter:\n  externalObjects: {}\n");
            made.insert(format!("{folder}.meta"), text);
        }
        made.insert(format!("{file}.meta"), description(file, importer(file)));
    }
    made.into_iter().collect()
}

/// A `.meta` file. Its GUID is a digest of the path, so that it is the same in every release.
fn description(name: &str, importer: &str) -> String {
    let digest = Sha256::digest(format!("com.cairn.unity/{name}"));
    let guid: String = digest.iter().take(16).map(|byte| format!("{byte:02x}")).collect();
    format!("fileFormatVersion: 2\nguid: {guid}\n{importer}")
}

/// The importer settings for a file.
fn importer(file: &str) -> &'static str {
    match file.rsplit('.').next().unwrap_or_default() {
        "cs" => {
            "MonoImporter:\n  externalObjects: {}\n  serializedVersion: 2\n  defaultReferences: []\n  executionOrder: 0\n"
        }
        "asmdef" => "AssemblyDefinitionImporter:\n  externalObjects: {}\n",
        "json" => "PackageManifestImporter:\n  externalObjects: {}\n",
        "dll" if file.ends_with("cairn_unity.dll") => PRELOADED,
        "dll" => LIBRARY,
        _ => "TextScriptImporter:\n  externalObjects: {}\n",
    }
}

/// Settings of a native library for the editor and for players on Windows.
macro_rules! native {
    ($preloaded:literal) => {
        concat!(
            "PluginImporter:\n  externalObjects: {}\n  serializedVersion: 2\n  isPreloaded: ",
            $preloaded,
            "\n  isOverridable: 0\n  platformData:\n  - first:\n      Any: \n    second:\n      enabled: 0\n      settings: {}\n",
            "  - first:\n      Editor: Editor\n    second:\n      enabled: 1\n      settings:\n        CPU: x86_64\n        \
             DefaultValueInitialized: true\n        OS: Windows\n",
            "  - first:\n      Standalone: Win64\n    second:\n      enabled: 1\n      settings:\n        CPU: x86_64\n",
        )
    };
}

/// Loaded when Unity starts, so that it is loaded before the graphics device is created.
const PRELOADED: &str = native!("1");
const LIBRARY: &str = native!("0");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_and_folder_that_unity_sees_is_described_once() {
        let files =
            ["package.json", "Runtime/A.cs", "Runtime/Binding/B.cs", "Samples~/C.cs", "Plugins/x86_64/cairn_unity.dll"];
        let made = descriptions(files.into_iter());
        let names: Vec<_> = made.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            names,
            [
                "Plugins.meta",
                "Plugins/x86_64.meta",
                "Plugins/x86_64/cairn_unity.dll.meta",
                "Runtime.meta",
                "Runtime/A.cs.meta",
                "Runtime/Binding.meta",
                "Runtime/Binding/B.cs.meta",
                "package.json.meta",
            ]
        );
        let numbers: std::collections::BTreeSet<_> =
            made.iter().filter_map(|(_, text)| text.lines().nth(1)?.strip_prefix("guid: ")).collect();
        assert_eq!(numbers.len(), made.len(), "no two have one number");
        assert!(numbers.iter().all(|number| number.len() == 32));
        assert!(made[2].1.contains("isPreloaded: 1") && made[2].1.contains("Win64"));
        assert!(made[0].1.contains("folderAsset: yes") && made[4].1.contains("MonoImporter"));
    }

    #[test]
    fn sources_of_the_plugin_and_tests_stay_out() {
        assert!(is_package("bindings/unity/package.json") && is_package("bindings/unity/Samples~/Walk/Walk.cs"));
        assert!(!is_package("bindings/unity/plugin/src/lib.rs") && !is_package("bindings/unity/tests/UnityEngine.cs"));
        assert!(!is_package("bindings/csharp/README.md") && !is_package("bindings/unity/README.md"));
    }
}
