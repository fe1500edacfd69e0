//! The documentation as a book: every page is a chapter, every link has a target, every name of the C interface exists, and the pages that
//! have a row for each result, or for each function, are complete.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::Context;
use super::tally::Tally;
use crate::abi::declarations::{self, Declarations};
use crate::abi::header;
use crate::book::{self, SUMMARY};
use crate::dist::tree::joined;
use crate::shell::Log;
use crate::workspace::Workspace;

/// Has a row for every result code.
const RESULTS: &str = "docs/troubleshooting.md";
/// Has a row for every function that allows one call at a time.
const THREADS: &str = "docs/threads.md";
/// Names every function that takes a texture or a command list.
const STATES: &str = "docs/resource-states.md";

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let workspace = context.workspace;
    let mut tally = Tally::default();
    let header = workspace.read(header::HEADER)?;
    let declared = declarations::read(&header)?;
    let chapters = book::chapters(&workspace.read(SUMMARY)?)?;
    tally.check(missing_or_repeated_chapters(&chapters, &workspace.files()?));
    tally.check(results_differ(&results(&header)?, &workspace.read(RESULTS)?));
    tally.check(threads_differ(&declared, &workspace.read(THREADS)?));
    tally.check(states_missing(&declared, &workspace.read(STATES)?));
    let known = names_in_sources(workspace)?;
    for chapter in &chapters {
        tally.check(unknown_names(chapter, &workspace.read(chapter)?, &known));
    }

    let (pages, output) = book::render(workspace, &workspace.target.join("book"))?;
    log.line(&output)?;
    tally.check(book::complaints(&output).first().map(|line| format!("mdBook complains: {line}")));
    let dead = dead_links(&pages)?;
    for link in &dead {
        log.line(link)?;
    }
    tally.check((!dead.is_empty()).then(|| format!("the book has dead links: {}", dead.join("; "))));
    Ok(tally)
}

/// Pages that are not in the book, and chapters that are listed twice.
fn missing_or_repeated_chapters(chapters: &[String], files: &[String]) -> Option<String> {
    let listed: BTreeSet<&String> = chapters.iter().collect();
    let is_page = |file: &&String| {
        let of_docs = file.starts_with("docs/") && Path::new(file).extension().is_some_and(|ending| ending == "md");
        let of_others = ["bindings/", "samples/"].iter().any(|f| file.starts_with(f)) && file.ends_with("/README.md");
        (of_docs || of_others) && *file != SUMMARY
    };
    let missing: Vec<_> = files.iter().filter(is_page).filter(|file| !listed.contains(file)).cloned().collect();
    if !missing.is_empty() {
        return Some(format!("{SUMMARY} does not have {}", missing.join(", ")));
    }
    (listed.len() != chapters.len()).then(|| format!("{SUMMARY} has a chapter twice"))
}

/// Names and values of all result codes in the header.
fn results(header: &str) -> Result<BTreeMap<String, String>, String> {
    let (_, rest) = header.split_once("typedef int32_t cairn_result;").ok_or("the header has no results")?;
    let (chapter, _) = rest.split_once("CAIRN_API").ok_or("the header has no function after its results")?;
    let constants = declarations::read(chapter)?.constants;
    Ok(constants.into_iter().map(|(name, value)| (name, value.trim_matches(['(', ')']).to_owned())).collect())
}

/// The cells of a page's table rows that begin with a name of the C interface.
fn rows(page: &str) -> Vec<Vec<&str>> {
    let rows = page.lines().filter(|line| line.starts_with("| `CAIRN_") || line.starts_with("| `cairn_"));
    rows.map(|row| row.trim_matches('|').split('|').map(str::trim).collect()).collect()
}

/// How the page on results differs from the header.
fn results_differ(results: &BTreeMap<String, String>, page: &str) -> Option<String> {
    let mut documented = BTreeMap::new();
    for row in rows(page) {
        let [name, number, why, remedy] = row.as_slice() else { continue };
        let name = name.trim_matches('`');
        // The page has other tables as well.
        if !results.contains_key(name) && number.parse::<i32>().is_err() {
            continue;
        }
        if why.is_empty() || remedy.is_empty() {
            return Some(format!("{RESULTS} does not say why {name} comes and what to do"));
        }
        if documented.insert(name.to_owned(), (*number).to_owned()).is_some() {
            return Some(format!("{RESULTS} has {name} twice"));
        }
    }
    let missing: Vec<_> = results.iter().filter(|(name, number)| documented.get(*name) != Some(number)).collect();
    let invented: Vec<_> = documented.keys().filter(|name| !results.contains_key(*name)).collect();
    let differs = !missing.is_empty() || !invented.is_empty();
    differs.then(|| format!("{RESULTS} lacks {missing:?}, and has {invented:?} that the header does not have"))
}

/// How the table of functions that allow one call at a time differs from the header's comments.
fn threads_differ(declared: &Declarations, page: &str) -> Option<String> {
    let single_call =
        declared.functions.iter().filter(|function| function.comment.join(" ").contains("one call at a time"));
    let single_call: BTreeSet<&str> = single_call.map(|function| function.name.as_str()).collect();
    let documented = rows(page).into_iter().filter_map(|row| Some(row.first()?.trim_matches('`')));
    // Callbacks have a table of their own.
    let documented: BTreeSet<&str> = documented.filter(|name| !name.ends_with("_callback")).collect();
    let differ: Vec<_> = single_call.symmetric_difference(&documented).copied().collect();
    (!differ.is_empty()).then(|| format!("{THREADS} and the header do not agree on {}", differ.join(", ")))
}

/// The functions that take an object of Direct3D 12 or DXGI and that the page on resource states does not name.
fn states_missing(declared: &Declarations, page: &str) -> Option<String> {
    const OBJECTS: [&str; 4] =
        ["ID3D12Resource", "ID3D12GraphicsCommandList", "cairn_swapchain_frame", "IDXGISwapChain"];
    let given = declared.functions.iter().filter(|f| OBJECTS.iter().any(|object| f.prototype.contains(object)));
    let missing: Vec<_> = given.map(|f| f.name.as_str()).filter(|name| !page.contains(&format!("`{name}`"))).collect();
    (!missing.is_empty()).then(|| format!("{STATES} does not say of {}", missing.join(", ")))
}

/// A text's words of identifier characters.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'))
}

fn is_name(word: &str) -> bool {
    word.strip_prefix("cairn_").or_else(|| word.strip_prefix("CAIRN_")).is_some_and(|rest| !rest.is_empty())
}

/// All words in non-page files that start like a name of the C interface.
fn names_in_sources(workspace: &Workspace) -> Result<BTreeSet<String>, String> {
    const ENDINGS: [&str; 8] = ["h", "hpp", "rs", "py", "cs", "c", "cpp", "cmake"];
    let mut known = BTreeSet::new();
    for file in workspace.files()? {
        let ending = Path::new(&file).extension().unwrap_or_default();
        // This file's tests contain names that do not exist.
        if ENDINGS.iter().any(|known| ending == *known) && !file.ends_with("test/book.rs") {
            known.extend(words(&workspace.read(&file)?).filter(|word| is_name(word)).map(str::to_owned));
        }
    }
    Ok(known)
}

/// Names on a page that do not exist. One that ends in `_` stands for all names with that prefix.
fn unknown_names(page: &str, text: &str, known: &BTreeSet<String>) -> Option<String> {
    let is_known = |word: &str| match word.ends_with('_') {
        true => known.iter().any(|name| name.starts_with(word)),
        false => known.contains(word),
    };
    let unknown: BTreeSet<&str> = words(text).filter(|word| is_name(word) && !is_known(word)).collect();
    let unknown: Vec<_> = unknown.into_iter().collect();
    (!unknown.is_empty()).then(|| format!("{page} names what nothing has: {}", unknown.join(", ")))
}

/// Links in the rendered book to a missing file or fragment.
fn dead_links(pages: &Path) -> Result<Vec<String>, String> {
    let mut texts = BTreeMap::new();
    let mut files = BTreeSet::new();
    let mut folders = vec![pages.to_owned()];
    while let Some(folder) = folders.pop() {
        let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
        for entry in fs::read_dir(&folder).map_err(failed)? {
            let path: PathBuf = entry.map_err(failed)?.path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(pages).unwrap_or(&path).to_string_lossy().replace('\\', "/");
            if name.ends_with(".html") {
                texts.insert(name.clone(), fs::read_to_string(&path).map_err(failed)?);
            }
            files.insert(name);
        }
    }
    let mut found = BTreeSet::new();
    // The page for error 404 is written for a site's root.
    for (name, text) in texts.iter().filter(|(name, _)| *name != "404.html") {
        found.extend(
            targets(text).filter_map(|target| dead(name, target, &files, &texts)).map(|why| format!("{name}: {why}")),
        );
    }
    Ok(found.into_iter().collect())
}

/// The link targets in the attributes of a page's elements.
fn targets(text: &str) -> impl Iterator<Item = &str> {
    [" href=\"", " src=\""].into_iter().flat_map(move |attribute| {
        text.match_indices(attribute).filter_map(move |(at, _)| Some(text[at + attribute.len()..].split_once('"')?.0))
    })
}

/// Why a target does not exist; links to other sites are not checked.
fn dead(page: &str, target: &str, files: &BTreeSet<String>, texts: &BTreeMap<String, String>) -> Option<String> {
    if target.contains(':') || target.starts_with("//") {
        return None;
    }
    let (path, fragment) = target.split_once('#').unwrap_or((target, ""));
    let folder = page.rsplit_once('/').map_or("", |(folder, _)| folder);
    let file = match path.split('?').next().unwrap_or_default() {
        "" => page.to_owned(),
        path => match joined(folder, &path.replace("%20", " ")) {
            Some(file) => file,
            None => return Some(format!("{target} leads out of the book")),
        },
    };
    if !files.contains(&file) {
        return Some(format!("{target} leads to no file"));
    }
    let found =
        |text: &String| text.contains(&format!("id=\"{fragment}\"")) || text.contains(&format!("name=\"{fragment}\""));
    let there = fragment.is_empty() || texts.get(&file).is_none_or(found);
    (!there).then(|| format!("{target} leads to no place of its page"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = include_str!("../../../include/cairn.h");
    const PAGE: &str = include_str!("../../../docs/troubleshooting.md");

    #[test]
    fn a_result_without_a_row_is_named() {
        let mut known = results(HEADER).unwrap();
        assert!(known.len() >= 19 && known["CAIRN_ERROR_IO"] == "-7" && known["CAIRN_NOT_READY"] == "1", "{known:?}");
        assert_eq!(results_differ(&known, PAGE), None);
        let without: Vec<_> = PAGE.lines().filter(|line| !line.starts_with("| `CAIRN_ERROR_BUSY`")).collect();
        assert!(results_differ(&known, &without.join("\n")).unwrap().contains("CAIRN_ERROR_BUSY"));
        known.insert("CAIRN_ERROR_NEW".to_owned(), "-16".to_owned());
        assert!(results_differ(&known, PAGE).unwrap().contains("CAIRN_ERROR_NEW"));
        let more = format!("{PAGE}\n| `CAIRN_ERROR_INVENTED` | -99 | why | what |\n");
        assert!(results_differ(&results(HEADER).unwrap(), &more).unwrap().contains("CAIRN_ERROR_INVENTED"));
        let other = PAGE.replace("| `CAIRN_ERROR_IO` | -7 |", "| `CAIRN_ERROR_IO` | -8 |");
        assert!(results_differ(&results(HEADER).unwrap(), &other).unwrap().contains("CAIRN_ERROR_IO"));
    }

    #[test]
    fn a_function_for_one_thread_without_a_row_is_named() {
        let declared = declarations::read(HEADER).unwrap();
        let page = include_str!("../../../docs/threads.md");
        assert_eq!(threads_differ(&declared, page), None);
        let without: Vec<_> = page.lines().filter(|line| !line.starts_with("| `cairn_rollout_step`")).collect();
        assert!(threads_differ(&declared, &without.join("\n")).unwrap().contains("cairn_rollout_step"));
        assert!(threads_differ(&declared, &format!("{page}\n| `cairn_adapters` | |\n")).is_some());
    }

    #[test]
    fn a_function_with_a_texture_without_documentation_is_named() {
        let declared = declarations::read(HEADER).unwrap();
        let page = include_str!("../../../docs/resource-states.md");
        assert_eq!(states_missing(&declared, page), None);
        let without = page.replace("`cairn_anchor_get_d3d12`", "");
        assert!(states_missing(&declared, &without).unwrap().contains("cairn_anchor_get_d3d12"));
    }

    #[test]
    fn missing_pages_and_unknown_names_are_reported() {
        let [a, b] = ["docs/bundle.md", "docs/fsr.md"].map(str::to_owned);
        let files = [a.clone(), b.clone(), SUMMARY.to_owned(), "xtask/src/dist/pages/linux.md".to_owned()];
        assert_eq!(missing_or_repeated_chapters(&[a.clone(), b.clone()], &files), None);
        assert!(missing_or_repeated_chapters(std::slice::from_ref(&a), &files).unwrap().contains("docs/fsr.md"));
        assert!(missing_or_repeated_chapters(&[a.clone(), b, a], &files).unwrap().contains("twice"));
        let known = ["cairn_a".to_owned(), "CAIRN_B_C".to_owned()].into();
        assert_eq!(unknown_names("p", "`cairn_a()`, CAIRN_B_ and cairn.h", &known), None);
        assert!(unknown_names("p", "`cairn_b`", &known).unwrap().contains("cairn_b"));
    }

    #[test]
    fn links_without_a_target_are_dead() {
        let texts: BTreeMap<_, _> = [("a/x.html".to_owned(), "<h1 id=\"top\">".to_owned())].into();
        let files: BTreeSet<_> = ["a/x.html".to_owned(), "b.png".to_owned()].into();
        for fine in ["#top", "x.html#top", "../b.png?1", "https://example.org/", "mailto:a"] {
            assert_eq!(dead("a/x.html", fine, &files, &texts), None, "{fine}");
        }
        for wrong in ["#bottom", "y.html", "../../b.png"] {
            assert!(dead("a/x.html", wrong, &files, &texts).is_some(), "{wrong}");
        }
        assert_eq!(targets("<a href=\"b\"><img src=\"c\">").collect::<Vec<_>>(), ["b", "c"]);
    }
}
