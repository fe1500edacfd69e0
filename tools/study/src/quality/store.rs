//! Cache of captures, pictures of other programs, and scores. Each key changes when any input changes.
//!
//! Everything is below the user's cache folder and may be deleted at any time.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cairn::{Error, ErrorKind, Picture, Result};
use sha2::{Digest, Sha256};

use crate::picture::decode;
use media::{describe_io, encode_png};

/// Cache key of bytes: the first 24 hexadecimal digits of their SHA-256.
pub(super) fn digest<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hash.finalize().iter().take(12).map(|byte| format!("{byte:02x}")).collect()
}

/// Cache key of a picture, from its size and colours.
pub(super) fn digest_picture(picture: &Picture) -> String {
    digest([&picture.width().to_le_bytes()[..], &picture.height().to_le_bytes()[..], picture.rgba()])
}

/// Cache key of the pictures and numbers of one clip.
pub(super) struct Capture {
    key: String,
}

impl Capture {
    /// A capture that depends on `description` only.
    pub(super) fn of(description: &str) -> Self {
        Self { key: digest([description.as_bytes()]) }
    }

    /// A capture that depends on `description` and on the source code of the scenes.
    pub(super) fn of_scenes(description: &str) -> Result<Self> {
        let folder = provision::repository().join("samples").join("scenes").join("src");
        Ok(Self { key: digest_of_sources(&[folder], &[description.as_bytes()])? })
    }
}

/// Digest of `first` and then of the contents of all files in `folders`, each folder in the order of the paths.
pub(super) fn digest_of_sources(folders: &[PathBuf], first: &[&[u8]]) -> Result<String> {
    let mut sources: Vec<Vec<u8>> = first.iter().map(|part| part.to_vec()).collect();
    for folder in folders {
        let mut files = Vec::new();
        gather(folder, &mut files).map_err(|e| describe_io("cannot be read", folder, &e))?;
        files.sort();
        for file in files {
            sources.push(fs::read(&file).map_err(|e| describe_io("cannot be read", &file, &e))?);
        }
    }
    Ok(digest(sources.iter().map(Vec::as_slice)))
}

fn gather(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() { gather(&path, files)? } else { files.push(path) }
    }
    Ok(())
}

/// The cache.
pub(super) struct Store {
    folder: PathBuf,
    /// Whether stored scores and pictures of other programs are used.
    reuse: bool,
}

impl Store {
    /// The cache in `folder`. With `reuse` off, scores and pictures of other programs are made again; captures are not, because they depend on their
    /// own sources only.
    pub(super) fn new(folder: PathBuf, reuse: bool) -> Self {
        Self { folder, reuse }
    }

    /// The picture `name` of a capture; calls `make` if it is not stored yet.
    pub(super) fn picture(
        &self,
        capture: &Capture,
        name: &str,
        make: impl FnOnce() -> Result<Picture>,
    ) -> Result<Picture> {
        let path = self.folder.join("captures").join(&capture.key).join(format!("{name}.png"));
        if let Some(kept) = read(&path)?.and_then(|bytes| decode(&bytes).ok()) {
            return Ok(kept);
        }
        let made = make()?;
        write(&path, &encode_png(&made)?)?;
        Ok(made)
    }

    /// `count` numbers called `name` of a capture; calls `make` if they are not stored yet.
    pub(super) fn numbers(
        &self,
        capture: &Capture,
        name: &str,
        count: usize,
        make: impl FnOnce() -> Result<Vec<f32>>,
    ) -> Result<Vec<f32>> {
        let path = self.folder.join("captures").join(&capture.key).join(format!("{name}.f32"));
        if let Some(kept) = read(&path)?.filter(|bytes| bytes.len() == 4 * count) {
            let values = kept.chunks_exact(4).map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
            return Ok(values.collect());
        }
        let made = make()?;
        if made.len() != count {
            return Err(Error::new(ErrorKind::InvalidState, format!("{} numbers were made, not {count}", made.len())));
        }
        write(&path, &made.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())?;
        Ok(made)
    }

    /// A stored picture of another program.
    pub(super) fn stored_row(&self, row: &str, key: &str) -> Result<Option<Picture>> {
        if !self.reuse {
            return Ok(None);
        }
        Ok(read(&self.row_path(row, key))?.and_then(|bytes| decode(&bytes).ok()))
    }

    /// Stores a picture of another program.
    pub(super) fn store_row(&self, row: &str, key: &str, picture: &Picture) -> Result<()> {
        write(&self.row_path(row, key), &encode_png(picture)?)
    }

    fn row_path(&self, row: &str, key: &str) -> PathBuf {
        self.folder.join("rows").join(row).join(format!("{key}.png"))
    }

    /// A stored line of text, such as a score.
    pub(super) fn stored_line(&self, key: &str) -> Result<Option<String>> {
        if !self.reuse {
            return Ok(None);
        }
        Ok(read(&self.line_path(key))?.and_then(|bytes| String::from_utf8(bytes).ok()))
    }

    /// Stores a line of text.
    pub(super) fn store_line(&self, key: &str, line: &str) -> Result<()> {
        write(&self.line_path(key), line.as_bytes())
    }

    fn line_path(&self, key: &str) -> PathBuf {
        self.folder.join("scores").join(&key[..2]).join(&key[2..])
    }
}

/// The bytes of a file; `None` if it does not exist.
fn read(path: &Path) -> Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(describe_io("cannot be read", path, &e)),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|e| describe_io("cannot be made", folder, &e))?;
    }
    // The temporary file's name contains the process number, because several processes may fill one cache.
    let unfinished = path.with_added_extension(format!("{}-part", std::process::id()));
    fs::write(&unfinished, bytes).map_err(|e| describe_io("cannot be written", &unfinished, &e))?;
    fs::rename(&unfinished, path).map_err(|e| describe_io("cannot be given its name", path, &e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_not_made_again_unless_asked() {
        let folder = tempfile::tempdir().unwrap();
        let capture = Capture::of("a clip");
        let picture = Picture::from_rgba(2, 1, vec![1, 2, 3, 255, 4, 5, 6, 255]).unwrap();
        let store = Store::new(folder.path().to_owned(), true);
        assert_eq!(store.picture(&capture, "0", || Ok(picture.clone())).unwrap(), picture);
        assert_eq!(store.picture(&capture, "0", || panic!("made twice")).unwrap(), picture);
        let numbers = vec![0.5, f32::NEG_INFINITY, -2.0];
        assert_eq!(store.numbers(&capture, "0", 3, || Ok(numbers.clone())).unwrap(), numbers);
        assert_eq!(store.numbers(&capture, "0", 3, || panic!("made twice")).unwrap(), numbers);
        assert!(store.numbers(&capture, "1", 3, || Ok(vec![1.0])).is_err());
        // A truncated file is made again.
        fs::write(folder.path().join("captures").join(&capture.key).join("0.f32"), [1, 2]).unwrap();
        assert_eq!(store.numbers(&capture, "0", 3, || Ok(numbers.clone())).unwrap(), numbers);

        store.store_row("blend", "abc", &picture).unwrap();
        store.store_line("abcdef", "1 2 3").unwrap();
        assert_eq!(store.stored_row("blend", "abc").unwrap().unwrap(), picture);
        assert_eq!(store.stored_line("abcdef").unwrap().unwrap(), "1 2 3");
        let fresh = Store::new(folder.path().to_owned(), false);
        assert!(fresh.stored_row("blend", "abc").unwrap().is_none() && fresh.stored_line("abcdef").unwrap().is_none());
        assert_eq!(fresh.picture(&capture, "0", || panic!("made twice")).unwrap(), picture);
    }

    #[test]
    fn keys_depend_on_every_part() {
        let split = |parts: [&str; 2]| digest(parts.map(str::as_bytes));
        assert_ne!(split(["ab", "c"]), split(["a", "bc"]));
        let wide = Picture::new(2, 1).unwrap();
        let high = Picture::new(1, 2).unwrap();
        assert_ne!(digest_picture(&wide), digest_picture(&high));
    }
}
