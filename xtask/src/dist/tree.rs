//! The files of an archive, in memory.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::clone::Clone;

/// Files by their paths, with `/`, below the archive's one folder, where it has one. Sorted, so that archives do not depend on the order they came in.
pub(super) struct Tree {
    name: String,
    /// Before every path.
    folder: String,
    files: BTreeMap<String, Vec<u8>>,
}

impl Tree {
    /// An empty one, whose folder has that name.
    pub(super) fn new(name: String) -> Self {
        Self { folder: format!("{name}/"), name, files: BTreeMap::new() }
    }

    /// An empty one of a name, whose files lie in no folder.
    pub(super) fn without_folder(name: String) -> Self {
        Self { folder: String::new(), name, files: BTreeMap::new() }
    }

    /// Of the one folder, and so of the archive without its ending; of what has no folder the whole name.
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

    /// Adds a file of this machine.
    pub(super) fn add_file(&mut self, path: impl Into<String>, from: &Path) -> Result<(), String> {
        self.add(path, fs::read(from).map_err(|e| format!("{}: {e}", from.display()))?)
    }

    /// Adds what is there under another name once more.
    pub(super) fn copy(&mut self, from: &str, to: String) -> Result<(), String> {
        let bytes = self.files.get(from).ok_or_else(|| format!("{} has no {from}", self.name))?.clone();
        self.add(to, bytes)
    }

    /// Adds the clone's files whose names start with `prefix` and that `wanted` takes, under the names they have there.
    pub(super) fn add_clone(&mut self, clone: &Clone, prefix: &str, wanted: fn(&str) -> bool) -> Result<(), String> {
        let files: Vec<_> =
            clone.files()?.into_iter().filter(|file| file.starts_with(prefix) && wanted(file)).collect();
        if files.is_empty() {
            return Err(format!("the clone has no {prefix}"));
        }
        files.into_iter().try_for_each(|file| self.add_file(file.clone(), &clone.root.join(&file)))
    }

    /// Makes plain words of links in pages that lead to what the archive does not have.
    pub(super) fn unlink(&mut self) {
        let pages: Vec<String> = self.files.keys().filter(|path| path.ends_with(".md")).cloned().collect();
        for page in pages {
            let folder = page.rsplit_once('/').map_or("", |(folder, _)| folder);
            let text = String::from_utf8_lossy(&self.files[&page]).into_owned();
            let unlinked = without_dead_links(&text, |target| match joined(folder, target) {
                Some(path) => self.has(&path),
                None => false,
            });
            self.files.insert(page, unlinked.into_bytes());
        }
    }

    /// Whether it has that file or folder.
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

    /// In order: the path with the folder before it, and what is in it.
    pub(super) fn files(&self) -> impl Iterator<Item = (String, &[u8])> {
        self.files.iter().map(|(path, bytes)| (format!("{}{path}", self.folder), bytes.as_slice()))
    }
}

/// A path that a page of `folder` links to, from the root; none where it leads out of that.
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

/// A page whose Markdown links to files that are not there are their words alone; pictures that are not there are left out. Links into
/// the page itself and to other sites stay.
pub(crate) fn without_dead_links(text: &str, exists: impl Fn(&str) -> bool) -> String {
    let mut kept = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("](") {
        let (before, link) = rest.split_at(at);
        let Some((target, after)) = link[2..].split_once(')') else { break };
        let path = target.split('#').next().unwrap_or_default();
        let stays = path.is_empty() || path.contains(':') || exists(path);
        match before.rfind('[').filter(|_| !stays) {
            None => kept.push_str(&rest[..at + 2 + target.len() + 1]),
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
    fn files_are_in_order_and_none_comes_twice() {
        let mut tree = Tree::new("a-1".to_owned());
        tree.add("lib/b", "2").unwrap();
        tree.add("include/a", "1").unwrap();
        assert!(tree.add("lib/b", "3").unwrap_err().contains("twice"));
        let found: Vec<_> = tree.files().map(|(path, _)| path).collect();
        assert_eq!(found, ["a-1/include/a", "a-1/lib/b"]);
    }

    #[test]
    fn links_lead_to_what_is_there_or_nowhere() {
        let mut tree = Tree::new("a-1".to_owned());
        tree.add("a folder/host/main", "").unwrap();
        let page = "See [a file](../a folder/host/main), [a folder](../a folder), [one](gone.md#there) and [two](../../x), \
                    ![a picture](gone.png)[here](#here), [a site](https://example.org/a_(b) and a[0](1";
        tree.add("pages/page.md", page).unwrap();
        tree.unlink();
        let (_, text) = tree.files().last().unwrap();
        assert_eq!(
            String::from_utf8_lossy(text),
            "See [a file](../a folder/host/main), [a folder](../a folder), one and two, [here](#here), \
             [a site](https://example.org/a_(b) and a[0](1"
        );
    }
}
