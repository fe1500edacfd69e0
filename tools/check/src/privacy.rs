//! Keeps folders, and with them the names of users and machines, out of reports.

use std::path::{Path, PathBuf};

/// `text` with each path reduced to the name of its file. First the folders in `known`, which may have blanks in their names, then every word
/// with a separator of folders at its start, after a drive, or twice in a row.
pub fn without_folders(text: &str, known: &[PathBuf]) -> String {
    let mut text = text.to_owned();
    for folder in known {
        let folder = folder.to_string_lossy();
        if folder.len() > 3 {
            for end in ["\\", "/"] {
                text = text.replace(&format!("{}{end}", folder.trim_end_matches(['\\', '/'])), end);
            }
            text = text.replace(folder.trim_end_matches(['\\', '/']), "a folder");
        }
    }
    let mut out = String::with_capacity(text.len());
    let mut word = String::new();
    for c in text.chars().chain([' ']) {
        if c.is_whitespace() || "\"'`(),;<>[]".contains(c) {
            out.push_str(&shortened(&word));
            word.clear();
            out.push(c);
        } else {
            word.push(c);
        }
    }
    out.pop();
    out
}

/// The folders of this process that messages may name.
pub fn known_folders() -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = Vec::new();
    folders.extend(std::env::current_exe().ok().and_then(|file| file.parent().map(Path::to_owned)));
    folders.extend(std::env::current_dir().ok());
    folders.push(std::env::temp_dir());
    folders.extend(std::env::home_dir());
    folders.sort_by_key(|folder| std::cmp::Reverse(folder.as_os_str().len()));
    folders
}

/// The last part of a word that is a path; other words unchanged.
fn shortened(word: &str) -> String {
    let is_separator = |c: char| c == '/' || c == '\\';
    let after_drive = word.get(1..3).is_some_and(|two| two == ":\\" || two == ":/");
    let is_path = after_drive || word.starts_with(is_separator) || word.contains("\\\\") || word.contains(":\\");
    if !is_path {
        return word.to_owned();
    }
    let body = word.trim_end_matches(['.', ':']);
    let name = body.trim_end_matches(is_separator).rsplit(is_separator).next().unwrap_or_default();
    let name = if name.is_empty() || name.ends_with(':') { "a folder" } else { name };
    format!("{name}{}", &word[body.len()..])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_become_file_names_and_other_words_stay() {
        let known = [PathBuf::from(r"C:\Users\Some Body\cairn"), PathBuf::from("/home/somebody")];
        for (text, wanted) in [
            (r"C:\Users\Some Body\cairn\bin\onnxruntime.dll: cannot be opened", "onnxruntime.dll: cannot be opened"),
            ("no file at /home/somebody/x/libonnxruntime.so.", "no file at libonnxruntime.so."),
            (r"looked in C:\Users\Some Body\cairn, D:\amd", "looked in a folder, amd"),
            (r"\\server\share\file.dll (version 1.2)", "file.dll (version 1.2)"),
            ("12 of 300 pixels and/or 5 px/s", "12 of 300 pixels and/or 5 px/s"),
            ("/", "a folder"),
        ] {
            assert_eq!(without_folders(text, &known), wanted);
        }
    }
}
