//! `cargo xtask book`: the documentation as a book, by mdBook.
//!
//! Its chapters are pages of `docs/` and pages of bindings and samples. They are first copied into one folder, each at its path in the
//! repository, so that links between them stay valid.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::{Console, Progress as _};

use crate::dist::tree::{joined, without_dead_links};
use crate::shell::show;
use crate::workspace::{self, Workspace};

/// The chapters in order, with paths relative to `docs/`.
pub(crate) const SUMMARY: &str = "docs/SUMMARY.md";
const SETTINGS: &str = "docs/book.toml";

/// Renders the book and prints where it is.
pub(crate) fn run(workspace: &Workspace) -> Result<(), String> {
    let (pages, output) = render(workspace, &workspace.target.join("book"))?;
    let complaints = complaints(&output);
    if !complaints.is_empty() {
        return Err(format!("mdBook complains:\n{}", complaints.join("\n")));
    }
    Console::new().done(&format!("the book: {}", pages.join("index.html").display()));
    Ok(())
}

/// Renders the book into a folder, which is created anew. Returns the folder of its pages and mdBook's output.
pub(crate) fn render(workspace: &Workspace, folder: &Path) -> Result<(PathBuf, String), String> {
    let mdbook = provision::mdbook(&Console::new()).map_err(|e| e.to_string())?;
    workspace::remove(folder)?;
    let (stage, pages) = (folder.join("source"), folder.join("html"));
    stage_pages(workspace, &stage)?;
    let mut command = Command::new(mdbook);
    command.arg("build").arg("--dest-dir").arg(&pages).arg(&stage);
    let ended = command.output().map_err(|e| format!("{} does not run: {e}", show(&command)))?;
    let output = format!("{}{}", String::from_utf8_lossy(&ended.stdout), String::from_utf8_lossy(&ended.stderr));
    if ended.status.success() { Ok((pages, output)) } else { Err(format!("mdBook failed:\n{output}")) }
}

/// The warnings and errors in mdBook's output.
pub(crate) fn complaints(output: &str) -> Vec<&str> {
    output.lines().filter(|line| ["WARN", "ERROR"].iter().any(|level| line.contains(level))).collect()
}

/// Paths of a summary's chapters, relative to the repository's root.
pub(crate) fn chapters(summary: &str) -> Result<Vec<String>, String> {
    let targets = summary.lines().filter_map(|line| line.split_once("](")?.1.split_once(')')).map(|(target, _)| target);
    targets
        .map(|target| joined(folder_of(SUMMARY), target).ok_or_else(|| format!("{SUMMARY}: {target} leads out of it")))
        .collect()
}

/// The targets of a page's links and images that are files, without fragments.
pub(crate) fn links(page: &str) -> impl Iterator<Item = &str> {
    let ends = page.match_indices("](").filter_map(|(at, _)| page[at + 2..].split_once(')').map(|(target, _)| target));
    let paths = ends.map(|target| target.split('#').next().unwrap_or_default());
    paths.filter(|path| !path.is_empty() && !path.contains(':') && !path.contains(char::is_whitespace))
}

/// Path of the first page. mdBook shows it at the root whatever its name is, so its links must be relative to the root.
const FIRST: &str = "index.md";

/// Writes the settings, the chapters and the files that they show or link to below `stage`. A link to a folder, or to a page that is not
/// a chapter, becomes plain text.
fn stage_pages(workspace: &Workspace, stage: &Path) -> Result<(), String> {
    let put = |path: &str, bytes: &[u8]| {
        let to = stage.join(path);
        let folder = to.parent().unwrap_or(stage);
        fs::create_dir_all(folder).and_then(|()| fs::write(&to, bytes)).map_err(|e| format!("{}: {e}", to.display()))
    };
    let summary = workspace.read(SUMMARY)?;
    let ordered = chapters(&summary)?;
    let first = ordered.first().ok_or_else(|| format!("{SUMMARY} has no chapter"))?;
    let chapters: BTreeSet<&String> = ordered.iter().collect();
    put("book.toml", workspace.read(SETTINGS)?.as_bytes())?;
    put(
        &format!("src/{}", SUMMARY.trim_start_matches("docs/")),
        from_root(folder_of(SUMMARY), &summary).replacen(first.as_str(), FIRST, 1).as_bytes(),
    )?;
    let mut linked = BTreeSet::new();
    for chapter in &ordered {
        let text = workspace.read(chapter)?;
        let folder = folder_of(chapter);
        let is_page = |path: &str| Path::new(path).extension().is_some_and(|ending| ending == "md");
        let there = |target: &str| match joined(folder, target) {
            Some(path) if is_page(&path) => chapters.contains(&path),
            Some(path) => workspace.root.join(path).is_file(),
            None => false,
        };
        let files = links(&text).filter(|target| there(target)).filter_map(|target| joined(folder, target));
        linked.extend(files.filter(|path| !is_page(path)));
        let text = without_dead_links(&text, there);
        match chapter == first {
            true => put(&format!("src/{FIRST}"), from_root(folder, &text).as_bytes())?,
            false => put(&format!("src/{chapter}"), text.as_bytes())?,
        }
    }
    // mdBook writes `NAME.md` as `NAME.html`, which would overwrite a report of that name.
    linked.retain(|file| !chapters.contains(&file.replace(".html", ".md")));
    for file in linked {
        let bytes = fs::read(workspace.root.join(&file)).map_err(|e| format!("{file}: {e}"))?;
        put(&format!("src/{file}"), &bytes)?;
    }
    Ok(())
}

/// The folder of a file in the repository.
fn folder_of(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Moves a page from `folder` to the root: its links lead to the same files.
fn from_root(folder: &str, page: &str) -> String {
    let mut moved = String::with_capacity(page.len());
    let mut rest = page;
    while let Some((before, after)) = rest.split_once("](") {
        moved += before;
        moved += "](";
        let (target, behind) = after.split_once(')').unwrap_or((after, ""));
        match joined(folder, target).filter(|_| !target.starts_with('#') && !target.contains(':')) {
            Some(path) => moved += &path,
            None => moved += target,
        }
        moved += &after[target.len()..after.len() - behind.len()];
        rest = behind;
    }
    moved + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str =
        "# Summary\n\n[First](bundle.md)\n\n- [One](quick-start/c.md)\n  - [Other](../bindings/python/README.md)\n";

    #[test]
    fn chapters_are_named_from_the_root() {
        assert_eq!(chapters(TEXT).unwrap(), ["docs/bundle.md", "docs/quick-start/c.md", "bindings/python/README.md"]);
        assert!(chapters("[Out](../../a.md)").is_err());
        assert_eq!(
            from_root("docs", TEXT),
            "# Summary\n\n[First](docs/bundle.md)\n\n- [One](docs/quick-start/c.md)\n  - [Other](bindings/python/README.md)\n"
        );
        let page = "See [a](fsr.md#c), [d](#e), ![f](../g.png) and [h](https://example.org/).";
        assert_eq!(
            from_root("docs", page),
            "See [a](docs/fsr.md#c), [d](#e), ![f](g.png) and [h](https://example.org/)."
        );
    }

    #[test]
    fn links_are_files() {
        let page = "[a](b.md#c) ![d](e.png) [f](#g) [h](https://example.org) x[0](1 2)";
        assert_eq!(links(page).collect::<Vec<_>>(), ["b.md", "e.png"]);
    }

    #[test]
    fn a_warning_is_a_complaint() {
        assert_eq!(
            complaints(" INFO Book building has started\n WARN unclosed HTML tag\n"),
            [" WARN unclosed HTML tag"]
        );
    }
}
