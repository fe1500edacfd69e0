//! A disk that fills up after a number of bytes, or that fails to flush a file.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use media::{FileSystem, OutputFile};

/// Real files that share `room` bytes. Cutting a file gives nothing back: the worst case.
pub struct SmallDisk {
    room: Arc<AtomicI64>,
    fails_sync: Arc<AtomicBool>,
}

impl SmallDisk {
    pub fn new(room: i64) -> Self {
        Self { room: Arc::new(AtomicI64::new(room)), fails_sync: Arc::default() }
    }

    /// With room for everything; the first flush to the medium fails.
    pub fn failing_once_at_sync() -> Self {
        Self { fails_sync: Arc::new(AtomicBool::new(true)), ..Self::new(i64::MAX) }
    }
}

struct SmallFile {
    file: File,
    room: Arc<AtomicI64>,
    fails_sync: Arc<AtomicBool>,
    at: u64,
    len: u64,
}

impl FileSystem for SmallDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn OutputFile>> {
        let (room, fails_sync) = (Arc::clone(&self.room), Arc::clone(&self.fails_sync));
        Ok(Box::new(SmallFile { file: File::create(path)?, room, fails_sync, at: 0, len: 0 }))
    }
}

impl Write for SmallFile {
    /// Writes as many bytes as fit, as an operating system does; only growing a file needs room.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let inside = (self.len.saturating_sub(self.at) as usize).min(bytes.len());
        let room = self.room.load(Ordering::SeqCst).max(0) as usize;
        let growth = (bytes.len() - inside).min(room);
        if inside + growth == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let written = self.file.write(&bytes[..inside + growth])?;
        self.room.fetch_sub(written.saturating_sub(inside) as i64, Ordering::SeqCst);
        self.at += written as u64;
        self.len = self.len.max(self.at);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for SmallFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

impl OutputFile for SmallFile {
    fn set_len(&mut self, len: u64) -> io::Result<()> {
        self.len = len;
        self.file.set_len(len)
    }

    fn sync(&mut self) -> io::Result<()> {
        if self.fails_sync.swap(false, Ordering::SeqCst) { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
    }
}
