//! Repository checks that a compiler does not make: words for unfinished work, references to existing files, the allowed dependencies between
//! modules, and names of ONNX Runtime's providers.

use std::collections::BTreeSet;
use std::path::Path;

use super::Context;
use super::tally::Tally;
use super::thorough_record;
use crate::counts;
use crate::shell::Log;
use crate::workspace::Workspace;

/// Words that mark unfinished work, each in two halves so that this file passes.
const UNFINISHED: [(&str, &str); 7] = [
    ("TO", "DO"),
    ("FIX", "ME"),
    ("XX", "X:"),
    ("todo", "!("),
    ("unimplemented", "!("),
    // A test that cannot run everywhere must report that at run time, with the reason.
    ("#[ign", "ore]"),
    ("#[ign", "ore ="),
];

/// The library's modules from the top down: each may use only those after it.
const MODULES: [&str; 9] = ["abi", "present", "framegen", "guidance", "world", "runtime", "bundle", "ffx", "gpu"];

/// Parts of names of ONNX Runtime's providers, in lower case.
const PROVIDERS: [&str; 3] = ["directml", "webgpu", "executionprovider"];

/// The library's code that may name a provider: the runtime, the paths of its libraries, the functions of the C interface that create, list and
/// explain devices, and its record.
const PROVIDER_CODE: [&str; 6] = [
    "src/runtime/",
    "src/libraries.rs",
    "src/abi/device.rs",
    "src/abi/requirements.rs",
    "src/abi/d3d12",
    "src/abi/record.rs",
];

/// Folders at the root; a path in a text that starts with one of them must exist.
const FOLDERS: [&str; 10] =
    ["src/", "include/", "docs/", "tests/", "samples/", "tools/", "bindings/", "xtask/", "fuzz/", "examples/"];

/// Extensions of files that texts refer to.
const EXTENSIONS: [&str; 16] =
    ["rs", "hlsl", "c", "h", "cpp", "hpp", "cs", "csproj", "py", "md", "toml", "json", "png", "txt", "yaml", "csv"];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let workspace = context.workspace;
    let files = workspace.files()?;
    let mut tally = Tally::default();
    for (rule, violations) in [
        ("unfinished work", unfinished(workspace, &files)?),
        ("links and file names in texts", dead_references(workspace, &files)?),
        ("modules use only those below", upward_uses(workspace, &files)?),
        ("only the runtime knows ONNX Runtime's providers", named_providers(workspace, &files)?),
    ] {
        log.line(&format!("{rule}: {} found", violations.len()))?;
        for violation in &violations {
            log.line(&format!("  {violation}"))?;
        }
        tally.check((!violations.is_empty()).then(|| format!("{rule}: {}", violations.join("; "))));
    }
    tally.check(thorough_record::page_differs(workspace)?);
    tally.check(counts::page_differs(workspace)?);
    Ok(tally)
}

fn has_extension(file: &str, extensions: &[&str]) -> bool {
    Path::new(file).extension().is_some_and(|extension| extensions.iter().any(|e| extension == *e))
}

fn unfinished(workspace: &Workspace, files: &[String]) -> Result<Vec<String>, String> {
    let mut violations = Vec::new();
    for file in files.iter().filter(|file| has_extension(file, &["rs", "hlsl", "cs", "py", "md", "toml"])) {
        for (number, line) in workspace.read(file)?.lines().enumerate() {
            for (first, second) in UNFINISHED {
                if line.contains(&format!("{first}{second}")) {
                    violations.push(format!("{file}:{}: {first}{second}", number + 1));
                }
            }
        }
    }
    Ok(violations)
}

fn dead_references(workspace: &Workspace, files: &[String]) -> Result<Vec<String>, String> {
    let mut violations = Vec::new();
    for file in files.iter().filter(|file| has_extension(file, &["md", "rs", "py", "toml"])) {
        let text = workspace.read(file)?;
        let is_page = has_extension(file, &["md"]);
        for (number, line) in text.lines().enumerate() {
            // A text may name a file relative to the repository's root, or to any folder that contains the text.
            let exists =
                |path: &str| Path::new(file).ancestors().skip(1).any(|f| workspace.root.join(f).join(path).exists());
            for path in named_files(line).filter(|path| !exists(path)) {
                violations.push(format!("{file}:{} names {path}, which is not there", number + 1));
            }
            for target in if is_page { links(line) } else { Vec::new() } {
                if let Some(why) = dead_link(workspace, file, &text, target) {
                    violations.push(format!("{file}:{}: {why}", number + 1));
                }
            }
        }
    }
    Ok(violations)
}

/// Paths in a line that start with one of our folders and have one of our extensions.
fn named_files(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| !(c.is_ascii_alphanumeric() || "_-./".contains(c)))
        .map(|word| word.trim_end_matches('.'))
        .filter(|word| FOLDERS.iter().any(|folder| word.starts_with(folder)) && has_extension(word, &EXTENSIONS))
}

/// Targets of a line's Markdown links and pictures.
fn links(line: &str) -> Vec<&str> {
    line.match_indices("](").filter_map(|(at, _)| line[at + 2..].split_once(')').map(|(target, _)| target)).collect()
}

/// Why a link has no target; links to other sites are not checked.
fn dead_link(workspace: &Workspace, page: &str, text: &str, target: &str) -> Option<String> {
    if target.contains("://") || target.starts_with("mailto:") {
        return None;
    }
    let (path, heading) = target.split_once('#').unwrap_or((target, ""));
    let folder = Path::new(page).parent().unwrap_or(Path::new(""));
    let linked = workspace.root.join(folder).join(path);
    if !path.is_empty() && !linked.exists() {
        return Some(format!("the link {target} leads to no file"));
    }
    if heading.is_empty() {
        return None;
    }
    let known = if path.is_empty() { headings(text) } else { headings(&std::fs::read_to_string(linked).ok()?) };
    (!known.contains(heading)).then(|| format!("the link {target} leads to no heading"))
}

/// Fragments of a page's headings, as code hosts make them.
fn headings(text: &str) -> BTreeSet<String> {
    text.lines()
        .filter(|line| line.starts_with('#'))
        .map(|line| {
            let kept = |c: &char| c.is_alphanumeric() || " -_".contains(*c);
            let heading: String = line.trim_start_matches('#').trim().chars().filter(kept).collect();
            heading.to_lowercase().replace(' ', "-")
        })
        .collect()
}

/// Code of a module that uses one above it in [`MODULES`]. Comments may refer to modules above.
fn upward_uses(workspace: &Workspace, files: &[String]) -> Result<Vec<String>, String> {
    let mut violations = Vec::new();
    for file in files.iter().filter(|file| file.starts_with("src/") && has_extension(file, &["rs"])) {
        let name = file.trim_start_matches("src/").split(['/', '.']).next().unwrap_or_default();
        let Some(level) = MODULES.iter().position(|module| *module == name) else { continue };
        for (number, line) in
            workspace.read(file)?.lines().enumerate().filter(|(_, line)| !line.trim().starts_with("//"))
        {
            for above in MODULES[..level].iter().filter(|above| line.contains(&format!("crate::{above}"))) {
                violations.push(format!("{file}:{} uses {above}, which is above {name}", number + 1));
            }
        }
    }
    Ok(violations)
}

/// Code of the library that names a provider outside of [`PROVIDER_CODE`]. Comments may.
fn named_providers(workspace: &Workspace, files: &[String]) -> Result<Vec<String>, String> {
    let mut violations = Vec::new();
    let is_checked = |file: &str| {
        let may_name = PROVIDER_CODE.iter().any(|allowed| file.starts_with(allowed));
        file.starts_with("src/") && has_extension(file, &["rs"]) && !may_name
    };
    for file in files.iter().filter(|file| is_checked(file)) {
        for (number, line) in workspace.read(file)?.lines().enumerate() {
            let code = line.split("//").next().unwrap_or_default().to_lowercase();
            for provider in PROVIDERS.iter().filter(|provider| code.contains(*provider)) {
                violations.push(format!("{file}:{} names {provider}", number + 1));
            }
        }
    }
    Ok(violations)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_links_are_found() {
        let line =
            "see `src/lib.rs`, [the page](docs/bundle.md#1-container), target/demo/a.png and src/present/mod.rs.";
        let named: Vec<_> = named_files(line).collect();
        assert_eq!(named, ["src/lib.rs", "docs/bundle.md", "src/present/mod.rs"]);
        assert_eq!(links(line), ["docs/bundle.md#1-container"]);
    }

    #[test]
    fn headings_become_anchors() {
        let known = headings("# The world bundle\n## 2. Manifest: `cairn-world.json`\ntext # no\n");
        assert!(known.contains("the-world-bundle") && known.contains("2-manifest-cairn-worldjson"), "{known:?}");
    }
}
