//! A cache of a measurement's finished results, so that one that was stopped goes on where it was.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cairn::Result;
use media::describe_io;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::files::write_all;
use crate::manifest::sha256;

/// A cached result.
#[derive(Serialize, Deserialize)]
struct Entry<T> {
    key: String,
    scores: T,
}

/// A folder of results.
pub(crate) struct ResultCache {
    folder: PathBuf,
    key: String,
}

impl ResultCache {
    /// Results in `folder` that were measured with exactly the `inputs`, as they are described. `version` changes when results are measured in another
    /// way.
    pub(crate) fn new(folder: PathBuf, version: u32, inputs: &[String]) -> Self {
        Self { folder, key: sha256(format!("{version}\n{}", inputs.join("\n")).as_bytes()) }
    }

    /// The path of a file of the result `name`.
    pub(crate) fn path(&self, name: &str, extension: &str) -> PathBuf {
        self.folder.join(format!("{name}.{extension}"))
    }

    /// The result `name`; `None` unless it was stored whole, with these inputs.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn find<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>> {
        let Some(text) = read(&self.path(name, "json"))? else { return Ok(None) };
        Ok(serde_json::from_slice(&text)
            .ok()
            .filter(|entry: &Entry<T>| entry.key == self.key)
            .map(|entry| entry.scores))
    }

    /// Stores the result `name` and other `files` of it, which are written before.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn store<T: Serialize>(&self, name: &str, scores: &T, mut files: Vec<(PathBuf, Vec<u8>)>) -> Result<()> {
        let entry = Entry { key: self.key.clone(), scores };
        let text = serde_json::to_vec(&entry).map_err(|e| describe_io("cannot be written", &self.folder, &e.into()))?;
        files.push((self.path(name, "json"), text));
        write_all(files).map(drop)
    }
}

/// The bytes of a file; `None` if there is none.
///
/// # Errors
/// `Io`.
pub(crate) fn read(path: &Path) -> Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(describe_io("cannot be read", path, &e)),
    }
}
