//! Files that are complete at every time, on a disk that may run full.

use std::fs;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use cairn::{Error, ErrorKind, Result};

/// An open file. Tests use an implementation that fails after a number of bytes.
pub trait OutputFile: Write + Seek + Send {
    /// Truncates or extends the file to `len` bytes.
    ///
    /// # Errors
    /// An error of the operating system.
    fn set_len(&mut self, len: u64) -> io::Result<()>;

    /// Flushes to the medium. Some file systems report a full disk only then.
    ///
    /// # Errors
    /// An error of the operating system.
    fn sync(&mut self) -> io::Result<()>;
}

/// Creates files.
pub trait FileSystem: Send + Sync {
    /// Creates a new file, replacing one of that name.
    ///
    /// # Errors
    /// An error of the operating system.
    fn create(&self, path: &Path) -> io::Result<Box<dyn OutputFile>>;
}

/// The operating system's file system.
#[derive(Debug, Clone, Copy, Default)]
pub struct RealDisk;

impl OutputFile for fs::File {
    fn set_len(&mut self, len: u64) -> io::Result<()> {
        fs::File::set_len(self, len)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

impl FileSystem for RealDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn OutputFile>> {
        Ok(Box::new(fs::File::create(path)?))
    }
}

/// A file that grows by complete units under a temporary name (`name.part`).
///
/// A unit that could not be written completely is removed again, so that the file always ends with a complete one.
pub struct GrowingFile {
    file: Box<dyn OutputFile>,
    part: PathBuf,
    path: PathBuf,
    end: u64,
}

impl GrowingFile {
    /// Starts the file whose final name is `path`.
    ///
    /// # Errors
    /// `Io` when it cannot be created.
    pub fn create(disk: &dyn FileSystem, path: &Path) -> Result<Self> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let part = path.with_file_name(name);
        let file = disk.create(&part).map_err(|e| describe_io("cannot be made", path, &e))?;
        Ok(Self { file, part, path: path.to_owned(), end: 0 })
    }

    /// Bytes written so far.
    pub fn end(&self) -> u64 {
        self.end
    }

    /// The file's final name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends `unit` completely or not at all.
    ///
    /// # Errors
    /// `Io` when it cannot be written; the file then ends where it ended before.
    pub fn append(&mut self, unit: &[u8]) -> Result<()> {
        match self.file.write_all(unit) {
            Ok(()) => {
                self.end += unit.len() as u64;
                Ok(())
            }
            Err(cause) => {
                // If this fails too, `close` truncates the file again.
                let _ = self.file.set_len(self.end);
                let _ = self.file.seek(SeekFrom::Start(self.end));
                Err(describe_io("cannot be written", &self.path, &cause))
            }
        }
    }

    /// Replaces bytes that were written before.
    ///
    /// # Errors
    /// `Io` when they cannot be written.
    pub fn replace(&mut self, at: u64, bytes: &[u8]) -> Result<()> {
        debug_assert!(at + bytes.len() as u64 <= self.end);
        let written = self
            .file
            .seek(SeekFrom::Start(at))
            .and_then(|_| self.file.write_all(bytes))
            .and_then(|()| self.file.seek(SeekFrom::Start(self.end)));
        written.map(|_| ()).map_err(|e| describe_io("cannot be written", &self.path, &e))
    }

    /// Truncates the file to `end` bytes, an earlier [`end`](Self::end).
    ///
    /// # Errors
    /// `Io` when the operating system refuses.
    pub fn truncate(&mut self, end: u64) -> Result<()> {
        debug_assert!(end <= self.end);
        self.end = end;
        let truncated = self.file.set_len(end).and_then(|()| self.file.seek(SeekFrom::Start(end)));
        truncated.map(|_| ()).map_err(|e| describe_io("cannot be truncated", &self.path, &e))
    }

    /// Closes the file and renames it to its final name.
    ///
    /// # Errors
    /// `Io` when the bytes do not reach the medium or the file cannot be renamed.
    pub fn close(mut self) -> Result<PathBuf> {
        let refused = |e: io::Error| describe_io("cannot be finished", &self.path, &e);
        self.file.set_len(self.end).map_err(refused)?;
        self.file.sync().map_err(refused)?;
        let Self { file, part, path, .. } = self;
        drop(file);
        fs::rename(&part, &path).map_err(|e| describe_io("cannot be given its name", &path, &e))?;
        Ok(path)
    }

    /// Removes the unfinished file.
    pub fn discard(self) {
        let Self { file, part, .. } = self;
        drop(file);
        let _ = fs::remove_file(part);
    }
}

/// Writes a small file completely or not at all.
///
/// # Errors
/// `Io`; an older file of that name is then untouched.
pub fn write_whole(disk: &dyn FileSystem, path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = GrowingFile::create(disk, path)?;
    if let Err(error) = file.append(bytes) {
        file.discard();
        return Err(error);
    }
    let part = file.part.clone();
    file.close().map(|_| ()).inspect_err(|_| {
        let _ = fs::remove_file(part);
    })
}

/// An `Io` error about `path`, with a remedy.
pub fn describe_io(what: &str, path: &Path, cause: &io::Error) -> Error {
    let error = Error::new(ErrorKind::Io, format!("{what}: {cause}")).field(path.display().to_string());
    match cause.kind() {
        io::ErrorKind::NotFound => error.remedy("Check the path"),
        io::ErrorKind::PermissionDenied => error.remedy("Choose a place you may read and write"),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::WriteZero => {
            error.remedy("Free some space, or choose another disk with --out")
        }
        io::ErrorKind::FileTooLarge => error.remedy("Choose a disk that takes larger files, or fewer --seconds"),
        _ => error,
    }
}
