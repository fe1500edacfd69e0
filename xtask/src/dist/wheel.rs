//! Python wheels: the package with the library beside its modules, as the packaging specifications require
//! <https://packaging.python.org/en/latest/specifications/binary-distribution-format/>. The metadata comes from the package's
//! `pyproject.toml`.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::{Digest, Sha256};
use toml::{Table, Value};

use super::Platform;
use super::dependencies::{self, Part};
use super::library::{self, BuiltLibrary};
use super::runtime::{self, RUST_NOTICES};
use super::sbom;
use super::tree::{self, Tree};
use crate::workspace::Workspace;

const PROJECT: &str = "bindings/python/pyproject.toml";
const PACKAGE: &str = "bindings/python/cairn/";
const README: &str = "bindings/python/README.md";

/// The wheel's compatibility tag: any Python 3 on the platform.
pub(super) fn tag(platform: Platform) -> String {
    let system = match platform {
        Platform::Windows => "win_amd64".to_owned(),
        Platform::Linux => format!("manylinux_{}_x86_64", library::GLIBC.replace('.', "_")),
    };
    format!("py3-none-{system}")
}

/// The wheel's file name.
pub(super) fn name(version: &str, platform: Platform) -> String {
    format!("cairn-{version}-{}.whl", tag(platform))
}

/// All files of a platform's wheel.
pub(super) fn wheel_tree(
    workspace: &Workspace,
    platform: Platform,
    built: &BuiltLibrary,
    parts: &[Part],
    bill: &[u8],
) -> Result<Tree, String> {
    let project: Table = workspace.read(PROJECT)?.parse().map_err(|e| format!("{PROJECT}: {e}"))?;
    let project = Project::parse(&project)?;
    let version = &parts.first().ok_or("a library of no parts")?.version;
    if project.version != *version {
        return Err(format!("{PROJECT} has the version {}, and the library is {version}", project.version));
    }
    let mut tree = Tree::without_folder(name(version, platform));
    for file in workspace.files()?.into_iter().filter(|file| file.starts_with(PACKAGE)) {
        let inside = file.trim_start_matches("bindings/python/").to_owned();
        tree.add_file(inside, &workspace.root.join(&file))?;
    }
    let [library, _] = library::names(platform);
    tree.add(format!("cairn/{library}"), built.library.as_slice())?;

    let info = format!("cairn-{version}.dist-info");
    let licences = ["LICENSE-APACHE", "LICENSE-MIT"];
    for file in licences {
        tree.add_file(format!("{info}/licenses/{file}"), &workspace.root.join(file))?;
    }
    tree.add(format!("{info}/licenses/{}", dependencies::PAGE), dependencies::page("the library", parts))?;
    tree.add(format!("{info}/licenses/{RUST_NOTICES}"), runtime::rust_notices(workspace)?)?;
    tree.add(format!("{info}/sboms/{}", sbom::NAME), bill)?;
    // A wheel has none of the files that the page links to.
    let page = tree::without_dead_links(&workspace.read(README)?, |_| false);
    let texts = [&licences[..], &[dependencies::PAGE, RUST_NOTICES]].concat();
    tree.add(format!("{info}/METADATA"), project.metadata(&texts, &page))?;
    tree.add(format!("{info}/entry_points.txt"), project.entry_points())?;
    let generator = format!("cairn-dist ({})", env!("CARGO_PKG_VERSION"));
    let wheel = format!("Wheel-Version: 1.0\nGenerator: {generator}\nRoot-Is-Purelib: false\nTag: {}\n", tag(platform));
    tree.add(format!("{info}/WHEEL"), wheel)?;
    let record = record(&tree, &format!("{info}/RECORD"));
    tree.add(format!("{info}/RECORD"), record)?;
    Ok(tree)
}

/// Every file with its hash and size; `RECORD` itself has neither.
fn record(tree: &Tree, own: &str) -> String {
    let mut lines = String::new();
    for (path, bytes) in tree.files() {
        let sum = URL_SAFE_NO_PAD.encode(Sha256::digest(bytes));
        _ = writeln!(lines, "{path},sha256={sum},{}", bytes.len());
    }
    _ = writeln!(lines, "{own},,");
    lines
}

/// The package's project file.
#[derive(Debug, Default)]
struct Project {
    name: String,
    version: String,
    description: String,
    requires_python: String,
    license: String,
    dependencies: Vec<String>,
    /// Extras by name, with their requirements.
    extras: Vec<(String, Vec<String>)>,
    scripts: Vec<(String, String)>,
}

impl Project {
    /// Refuses an unknown key, since the wheel would lack it.
    fn parse(file: &Table) -> Result<Self, String> {
        let table = file.get("project").and_then(Value::as_table).ok_or_else(|| format!("{PROJECT} has no project"))?;
        let mut project = Self::default();
        for (key, value) in table {
            let not_understood = || format!("{PROJECT}: project.{key} is not understood here");
            let text = || value.as_str().map(str::to_owned).ok_or_else(not_understood);
            match key.as_str() {
                "name" => project.name = text()?,
                "version" => project.version = text()?,
                "description" => project.description = text()?,
                "requires-python" => project.requires_python = text()?,
                "license" => project.license = text()?,
                "readme" if value.as_str() == Some("README.md") => {}
                "dependencies" => project.dependencies = texts(value).ok_or_else(not_understood)?,
                "optional-dependencies" => {
                    for (extra, list) in value.as_table().ok_or_else(not_understood)? {
                        project.extras.push((extra.clone(), texts(list).ok_or_else(not_understood)?));
                    }
                }
                "scripts" => {
                    for (script, function) in value.as_table().ok_or_else(not_understood)? {
                        project
                            .scripts
                            .push((script.clone(), function.as_str().ok_or_else(not_understood)?.to_owned()));
                    }
                }
                _ => return Err(not_understood()),
            }
        }
        Ok(project)
    }

    /// The `METADATA` file <https://packaging.python.org/en/latest/specifications/core-metadata/>.
    fn metadata(&self, licences: &[&str], page: &str) -> String {
        let Self { name, version, description, requires_python, license, .. } = self;
        let mut text = format!(
            "Metadata-Version: 2.4\nName: {name}\nVersion: {version}\nSummary: {description}\nLicense-Expression: {license}\n"
        );
        for file in licences {
            _ = writeln!(text, "License-File: {file}");
        }
        _ = writeln!(text, "Requires-Python: {requires_python}\nDescription-Content-Type: text/markdown");
        for requirement in &self.dependencies {
            _ = writeln!(text, "Requires-Dist: {requirement}");
        }
        for (extra, list) in &self.extras {
            _ = writeln!(text, "Provides-Extra: {extra}");
            for requirement in list {
                _ = writeln!(text, "Requires-Dist: {requirement}; extra == \"{extra}\"");
            }
        }
        _ = write!(text, "\n{page}");
        text
    }

    fn entry_points(&self) -> String {
        let mut text = "[console_scripts]\n".to_owned();
        for (script, function) in &self.scripts {
            _ = writeln!(text, "{script} = {function}");
        }
        text
    }
}

fn texts(value: &Value) -> Option<Vec<String>> {
    value.as_array()?.iter().map(|text| text.as_str().map(str::to_owned)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn project_keys_are_in_the_metadata_or_refused() {
        let file = "[project]\nname = \"a\"\nversion = \"1\"\ndescription = \"d\"\nreadme = \"README.md\"\nlicense = \"MIT\"\n\
                    requires-python = \">=3\"\ndependencies = [\"b>=2; sys_platform == 'win32'\"]\n[project.scripts]\nc = \"a:b\"\n\
                    [project.optional-dependencies]\ne = [\"f\"]\n";
        let project = Project::parse(&file.parse().unwrap()).unwrap();
        let text = project.metadata(&["L"], "# page\n");
        for line in [
            "Name: a",
            "License-File: L",
            "Requires-Dist: b>=2; sys_platform == 'win32'",
            "Provides-Extra: e",
            "Requires-Dist: f; extra == \"e\"",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
        assert!(text.ends_with("\n\n# page\n"), "{text}");
        assert_eq!(project.entry_points(), "[console_scripts]\nc = a:b\n");
        let more = file.replace("description", "keywords");
        assert!(Project::parse(&more.parse().unwrap()).unwrap_err().contains("project.keywords"));
    }

    #[test]
    fn the_record_has_a_sum_of_every_file_but_itself() {
        let mut tree = Tree::without_folder("a".to_owned());
        tree.add("b", "abc").unwrap();
        let sum = "ungWv48Bz-pBQUDeXa4iI7ADYaOWF3qctBD_YfIAFa0";
        assert_eq!(record(&tree, "R"), format!("b,sha256={sum},3\nR,,\n"));
    }
}
