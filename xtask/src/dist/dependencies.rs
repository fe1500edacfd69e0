//! The crates that the library, or a program, is built from, their licences, and the page that names every part.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;

use cargo_metadata::camino::Utf8Path;
use cargo_metadata::{DependencyKind, Metadata, MetadataCommand, PackageId};
use provision::tools;

use super::Platform;
use super::runtime::RUST_NOTICES;
use crate::workspace::Workspace;

/// Where a part of the library comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A crate from Cargo.
    Crate,
    /// Added by the compiler or the linker.
    Runtime,
}

/// Identifies a part: its package URL <https://github.com/package-url/purl-spec>.
pub(super) fn reference(kind: Kind, name: &str, version: &str) -> String {
    format!("pkg:{}/{name}@{version}", kind.package_type())
}

impl Kind {
    /// The type in a package URL.
    pub(super) fn package_type(self) -> &'static str {
        match self {
            Self::Crate => "cargo",
            Self::Runtime => "generic",
        }
    }
}

/// A component of the library or of a program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Part {
    pub(super) kind: Kind,
    pub(super) name: String,
    pub(super) version: String,
    /// An SPDX expression.
    pub(super) licence: String,
    pub(super) description: Option<String>,
    /// URL of its source repository.
    pub(super) repository: Option<String>,
    /// Checksum from the lock file; `None` for our own crates.
    pub(super) sha256: Option<String>,
    /// References to its own dependencies.
    pub(super) uses: Vec<String>,
    /// Its licence files, by name.
    pub(super) texts: BTreeMap<String, String>,
}

impl Part {
    pub(super) fn reference(&self) -> String {
        reference(self.kind, &self.name, &self.version)
    }

    /// Whether it is one of this repository's crates, whose licences the archive has already.
    fn is_own(&self) -> bool {
        self.kind == Kind::Crate && self.sha256.is_none()
    }
}

/// File name in an archive of the page that names every part of the library.
pub(super) const PAGE: &str = "THIRD-PARTY.md";
/// The same for `cairn-check`.
pub(super) const PAGE_OF_CHECK: &str = "THIRD-PARTY-CHECK.md";

/// Prefixes of the names of licence files, in capitals.
const LICENCE_FILES: [&str; 6] = ["LICENSE", "LICENCE", "COPYING", "COPYRIGHT", "NOTICE", "UNLICENSE"];

/// All crates of a `package` of the workspace for a platform, its own first.
pub(super) fn crates(workspace: &Workspace, platform: Platform, package: &str) -> Result<Vec<Part>, String> {
    let filter = ["--locked", "--filter-platform", platform.triple()].map(str::to_owned);
    let metadata = MetadataCommand::new()
        .cargo_path(tools::cargo())
        .manifest_path(workspace.root.join("Cargo.toml"))
        .other_options(filter)
        .exec()
        .map_err(|e| format!("cargo metadata: {e}"))?;
    let lock = workspace.read("Cargo.lock")?;
    let sums = sums(&lock)?;
    let links = links(&metadata)?;
    let root = metadata.workspace_packages().into_iter().find(|found| found.name == package);
    let root = root.ok_or_else(|| format!("cargo metadata names no package {package}"))?;
    let mut crates = Vec::new();
    for id in reachable(&root.id, &links) {
        let package = &metadata[&id];
        let (name, version) = (package.name.to_string(), package.version.to_string());
        let licence = package.license.clone().ok_or_else(|| format!("{name} {version} names no licence"))?;
        let uses = links.get(&id).into_iter().flatten().map(|used| {
            let used = &metadata[used];
            reference(Kind::Crate, &used.name, &used.version.to_string())
        });
        crates.push(Part {
            kind: Kind::Crate,
            uses: uses.collect(),
            // The archive has our own licence files as they are.
            texts: if package.source.is_none() { BTreeMap::new() } else { texts(package.manifest_path.parent())? },
            sha256: sums.get(&(name.clone(), version.clone())).cloned(),
            description: package.description.as_ref().map(|text| text.split_whitespace().collect::<Vec<_>>().join(" ")),
            repository: package.repository.clone(),
            // A slash is the older way to write OR.
            licence: licence.replace('/', " OR "),
            name,
            version,
        });
    }
    Ok(crates)
}

/// The packages that every package is linked with, without build and development dependencies.
fn links(metadata: &Metadata) -> Result<BTreeMap<PackageId, Vec<PackageId>>, String> {
    let resolve = metadata.resolve.as_ref().ok_or("cargo metadata resolves nothing")?;
    let linked = |node: &cargo_metadata::Node| {
        let normal =
            |dep: &&cargo_metadata::NodeDep| dep.dep_kinds.iter().any(|kind| kind.kind == DependencyKind::Normal);
        node.deps.iter().filter(normal).map(|dep| dep.pkg.clone()).collect()
    };
    Ok(resolve.nodes.iter().map(|node| (node.id.clone(), linked(node))).collect())
}

/// `root` and all packages reachable from it: `root` first, the others sorted.
fn reachable(root: &PackageId, links: &BTreeMap<PackageId, Vec<PackageId>>) -> Vec<PackageId> {
    let mut found = BTreeSet::new();
    let mut next = vec![root.clone()];
    while let Some(id) = next.pop() {
        if found.insert(id.clone()) {
            next.extend(links.get(&id).into_iter().flatten().cloned());
        }
    }
    found.remove(root);
    std::iter::once(root.clone()).chain(found).collect()
}

/// Checksums in the lock file by name and version.
fn sums(lock: &str) -> Result<BTreeMap<(String, String), String>, String> {
    let lock: toml::Table = lock.parse().map_err(|e| format!("Cargo.lock: {e}"))?;
    let packages = lock.get("package").and_then(toml::Value::as_array).into_iter().flatten();
    let text = |package: &toml::Value, key| package.get(key).and_then(toml::Value::as_str).map(str::to_owned);
    Ok(packages
        .filter_map(|package| Some(((text(package, "name")?, text(package, "version")?), text(package, "checksum")?)))
        .collect())
}

/// The licence files beside a manifest.
fn texts(folder: Option<&Utf8Path>) -> Result<BTreeMap<String, String>, String> {
    let folder = folder.ok_or("a manifest lies in no folder")?;
    let mut texts = BTreeMap::new();
    for entry in folder.read_dir_utf8().map_err(|e| format!("{folder}: {e}"))? {
        let path = entry.map_err(|e| format!("{folder}: {e}"))?.into_path();
        let name = path.file_name().unwrap_or_default();
        let upper = name.to_uppercase();
        if path.is_file() && LICENCE_FILES.iter().any(|beginning| upper.starts_with(beginning)) {
            let bytes = fs::read(&path).map_err(|e| format!("{path}: {e}"))?;
            texts.insert(name.to_owned(), String::from_utf8_lossy(&bytes).replace("\r\n", "\n"));
        }
    }
    Ok(texts)
}

/// A page with every part of `what` that is not our own, its licence, and each distinct licence text once.
pub(super) fn page(what: &str, parts: &[Part]) -> String {
    let others = || parts.iter().filter(|part| !part.is_own());
    let mut page = format!(
        "# What is in {what} besides our own work\n\nThe licence of each part, as its authors state it, and the texts \
         that they give.\n\n| part | licence | where it is developed |\n|---|---|---|\n"
    );
    for part in others() {
        let repository = part.repository.as_deref().unwrap_or("https://crates.io");
        _ = writeln!(page, "| {} {} | {} | {repository} |", part.name, part.version, part.licence);
    }
    _ = writeln!(page, "\nWhat rust-std is made of in turn, with its notices: [{RUST_NOTICES}]({RUST_NOTICES}).");
    // Grouped by text, since most are the same.
    let mut parts: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for part in others() {
        for text in part.texts.values() {
            parts.entry(text.trim()).or_default().push(format!("{} {}", part.name, part.version));
        }
    }
    let mut texts: Vec<_> = parts.into_iter().collect();
    texts.sort_by_key(|(text, parts)| (std::cmp::Reverse(parts.len()), *text));
    for (text, mut parts) in texts {
        parts.dedup();
        // This fence occurs in no licence text.
        _ = write!(page, "\n## {}\n\n~~~~text\n{text}\n~~~~\n", parts.join(", "));
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A part from outside, or with an empty checksum one of our own.
    fn part(name: &str, sha256: &str, text: &str) -> Part {
        Part {
            kind: Kind::Crate,
            name: name.to_owned(),
            version: "1.0.0".to_owned(),
            licence: "MIT".to_owned(),
            description: None,
            repository: None,
            sha256: Some(sha256.to_owned()).filter(|sum| !sum.is_empty()),
            uses: Vec::new(),
            texts: BTreeMap::from([("LICENSE".to_owned(), text.to_owned())]),
        }
    }

    #[test]
    fn equal_licence_texts_appear_once_with_all_their_parts() {
        let own = [part("own", "", "ours"), part("other", "", "ours")];
        let others = [part("a", "1", "one\n"), part("b", "2", "two"), part("c", "3", "one")];
        let page = page("a program", &[own.as_slice(), &others].concat());
        assert_eq!(page.matches("\none\n").count(), 1, "{page}");
        assert!(page.contains("## a 1.0.0, c 1.0.0\n") && page.contains("## b 1.0.0\n"), "{page}");
        assert!(page.starts_with("# What is in a program besides our own work\n"), "{page}");
        assert!(!page.contains("ours") && !page.contains("other") && page.contains("| b 1.0.0 | MIT |"), "{page}");
        assert!(page.find("\none\n") < page.find("\ntwo\n"), "what most have comes first");
    }

    #[test]
    fn checksums_are_those_of_the_lock_file() {
        let lock = "version = 4\n[[package]]\nname = \"a\"\nversion = \"1.0.0\"\nchecksum = \"12ab\"\n\
                    [[package]]\nname = \"own\"\nversion = \"0.1.0\"\n";
        let sums = sums(lock).unwrap();
        assert_eq!(sums.get(&("a".to_owned(), "1.0.0".to_owned())).map(String::as_str), Some("12ab"));
        assert_eq!(sums.len(), 1);
    }
}
