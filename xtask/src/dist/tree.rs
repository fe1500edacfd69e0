//! The files of an archive, in memory.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::workspace::Workspace;

/// Files by their paths, with `/`, below the archive's top folder if it has one. Sorted, so that an archive does not depend on insertion
/// order.
pub(super) struct Tree {
    name: String,
    /// Prefix of every path.
    folder: String,
    files: BTreeMap<String, Vec<u8>>,
    /// Paths of the files that may be executed.
    programs: BTreeSet<String>,
}

impl Tree {
    /// An empty tree with a top folder of that name.
    pub(super) fn new(name: String) -> Self {
        Self { folder: format!("{name}/"), name, files: BTreeMap::new(), programs: BTreeSet::new() }
    }

    /// An empty tree of that name, without a top folder.
    pub(super) fn without_folder(name: String) -> Self {
        Self { folder: String::new(), name, files: BTreeMap::new(), programs: BTreeSet::new() }
    }

    /// Name of the top folder, and so of the archive without its extension; without a top folder the whole file name.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Adds a file.
    pub(super) fn add(&mut self, path: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Result<(), String> {
        let path = path.into();
        match self.files.insert(path.clone(), bytes.into()) {
            None => Ok(()),
            Some(_) => Err(format!("{path} is in {} twice", self.name)),
        }
    }

    /// Adds a file that may be executed.
    pub(super) fn add_program(&mut self, path: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Result<(), String> {
        let path = path.into();
        self.programs.insert(path.clone());
        self.add(path, bytes)
    }

    /// Adds a file from this machine's disk.
    pub(super) fn add_file(&mut self, path: impl Into<String>, from: &Path) -> Result<(), String> {
        self.add(path, fs::read(from).map_err(|e| format!("{}: {e}", from.display()))?)
    }

    /// Copies an existing entry to another path.
    pub(super) fn copy(&mut self, from: &str, to: String) -> Result<(), String> {
        let bytes = self.files.get(from).ok_or_else(|| format!("{} has no {from}", self.name))?.clone();
        self.add(to, bytes)
    }

    /// Adds the repository's files whose paths start with `prefix` and that `wanted` accepts, at the same paths.
    pub(super) fn add_from_workspace(
        &mut self,
        workspace: &Workspace,
        prefix: &str,
        wanted: fn(&str) -> bool,
    ) -> Result<(), String> {
        let files: Vec<_> =
            workspace.files()?.into_iter().filter(|file| file.starts_with(prefix) && wanted(file)).collect();
        if files.is_empty() {
            return Err(format!("the clone has no {prefix}"));
        }
        files.into_iter().try_for_each(|file| self.add_file(file.clone(), &workspace.root.join(&file)))
    }

    /// Adjusts links in pages to the archive's paths; a link to a file that the archive lacks becomes plain text. `moved` has pairs of
    /// folders: path in the repository, path in the archive.
    pub(super) fn relink(&mut self, moved: &[(&str, &str)]) {
        let pages: Vec<String> = self.files.keys().filter(|path| path.ends_with(".md")).cloned().collect();
        for page in pages {
            let folder = page.rsplit_once('/').map_or("", |(folder, _)| folder);
            let origin = moved_path(&page, moved.iter().map(|&(there, here)| (here, there)));
            let origin = origin.rsplit_once('/').map_or("", |(folder, _)| folder);
            let text = String::from_utf8_lossy(&self.files[&page]).into_owned();
            let linked = with_new_links(&text, |target| {
                let path = moved_path(&joined(origin, target)?, moved.iter().copied());
                let as_before = joined(folder, target).as_ref() == Some(&path);
                self.has(&path).then(|| if as_before { target.to_owned() } else { relative(folder, &path) })
            });
            self.files.insert(page, linked.into_bytes());
        }
    }

    /// Whether the tree has that file or folder.
    fn has(&self, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        let is_below = |file: &String| file.strip_prefix(path).is_some_and(|rest| rest.starts_with('/'));
        self.files.contains_key(path)
            || self
                .files
                .range(path.to_owned()..)
                .take_while(|(file, _)| file.starts_with(path))
                .any(|(file, _)| is_below(file))
    }

    /// All files in order: path with the top folder, and contents.
    pub(super) fn files(&self) -> impl Iterator<Item = (String, &[u8])> {
        self.files.iter().map(|(path, bytes)| (format!("{}{path}", self.folder), bytes.as_slice()))
    }

    /// Whether a file, named as by [`Tree::files`], may be executed.
    pub(super) fn is_program(&self, path: &str) -> bool {
        path.strip_prefix(&self.folder).is_some_and(|path| self.programs.contains(path))
    }
}

/// Resolves a link in a page of `folder` to a path from the root; `None` if it leads out of the root.
pub(crate) fn joined(folder: &str, target: &str) -> Option<String> {
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in target.split('/') {
        match part {
            "" | "." => {}
            ".." => _ = parts.pop()?,
            name => parts.push(name),
        }
    }
    Some(parts.join("/"))
}

/// Replaces the path's prefix that is the first of a pair by the second.
fn moved_path<'a>(path: &str, mut folders: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let found = folders.find_map(|(from, to)| Some(format!("{to}{}", path.strip_prefix(from)?)));
    found.unwrap_or_else(|| path.to_owned())
}

/// The relative link from a page of `folder` to a path from the root.
fn relative(folder: &str, path: &str) -> String {
    let folder: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    let path: Vec<&str> = path.split('/').collect();
    let shared = folder.iter().zip(&path).take_while(|(one, other)| one == other).count();
    let up = std::iter::repeat_n("..", folder.len() - shared);
    up.chain(path[shared..].iter().copied()).collect::<Vec<_>>().join("/")
}

/// Replaces Markdown links to missing files by their text, and removes images that are missing. Links into the page itself and to other
/// sites stay.
pub(crate) fn without_dead_links(text: &str, exists: impl Fn(&str) -> bool) -> String {
    with_new_links(text, |path| exists(path).then(|| path.to_owned()))
}

/// The same; `new_target` returns the new target of a link, or `None` if there is none.
fn with_new_links(text: &str, new_target: impl Fn(&str) -> Option<String>) -> String {
    let mut kept = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("](") {
        let (before, link) = rest.split_at(at);
        let Some((target, after)) = link[2..].split_once(')') else { break };
        let path = target.split('#').next().unwrap_or_default();
        let stays = path.is_empty() || path.contains(':');
        let replacement = if stays { Some(path.to_owned()) } else { new_target(path) };
        match before.rfind('[').filter(|_| replacement.is_none()) {
            None => {
                let path_to = replacement.as_deref().unwrap_or(path);
                kept.extend([before, "](", path_to, &target[path.len()..], ")"]);
            }
            Some(open) => match before[..open].strip_suffix('!') {
                Some(text) => kept.push_str(text),
                None => _ = (kept.push_str(&before[..open]), kept.push_str(&before[open + 1..])),
            },
        }
        rest = after;
    }
    kept.push_str(rest);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_sorted_and_unique() {
        let mut tree = Tree::new("a-1".to_owned());
        tree.add("lib/b", "2").unwrap();
        tree.add("include/a", "1").unwrap();
        assert!(tree.add("lib/b", "3").unwrap_err().contains("twice"));
        let found: Vec<_> = tree.files().map(|(path, _)| path).collect();
        assert_eq!(found, ["a-1/include/a", "a-1/lib/b"]);
    }

    #[test]
    fn links_to_missing_files_become_text() {
        let mut tree = Tree::new("a-1".to_owned());
        tree.add("a folder/host/main", "").unwrap();
        let page = "See [a file](../a folder/host/main), [a folder](../a folder), [one](gone.md#there) and [two](../../x), \
                    ![a picture](gone.png)[here](#here), [a site](https://example.org/a_(b) and a[0](1";
        tree.add("pages/page.md", page).unwrap();
        tree.relink(&[]);
        let (_, text) = tree.files().last().unwrap();
        assert_eq!(
            String::from_utf8_lossy(text),
            "See [a file](../a folder/host/main), [a folder](../a folder), one and two, [here](#here), \
             [a site](https://example.org/a_(b) and a[0](1"
        );
    }

    #[test]
    fn links_follow_moved_folders() {
        let mut tree = Tree::new("a-1".to_owned());
        tree.add("pages/start/page.md", "[a](../../bindings/engine/Docs/a.md#there), [b](../b.md)").unwrap();
        tree.add("pages/b.md", "").unwrap();
        tree.add("engine/plugin/Docs/a.md", "[b](../../../pages/b.md), [c](../c.md), [d](../../gone.md)").unwrap();
        tree.add("engine/plugin/c.md", "").unwrap();
        tree.relink(&[("bindings/engine/", "engine/plugin/")]);
        let texts: BTreeMap<_, _> = tree.files().collect();
        let text = |path: &str| String::from_utf8_lossy(texts[path]).into_owned();
        assert_eq!(text("a-1/pages/start/page.md"), "[a](../../engine/plugin/Docs/a.md#there), [b](../b.md)");
        assert_eq!(text("a-1/engine/plugin/Docs/a.md"), "[b](../../../pages/b.md), [c](../c.md), d");
    }
}
