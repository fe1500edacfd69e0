//! Keeps compiled pipelines in a file of the game between runs.

use std::ffi::c_void;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::guarded;

/// A file that `cairn_presenter_prepare_d3d12` reads and writes through [`load`] and [`store`], whose `user` is its address.
pub(crate) struct PipelineCache {
    path: PathBuf,
    /// Content of the file when its size was queried.
    loaded: Vec<u8>,
}

impl PipelineCache {
    pub(crate) fn new(path: PathBuf) -> Self {
        Self { path, loaded: Vec::new() }
    }

    /// Replaces the file atomically: if the game ends meanwhile, the earlier file stays. A failed write is logged, and the next run compiles again.
    fn replace(&self, bytes: &[u8]) {
        static WRITTEN: AtomicU64 = AtomicU64::new(0);
        let suffix = format!("{}-{}.tmp", std::process::id(), WRITTEN.fetch_add(1, Ordering::Relaxed));
        let temporary = self.path.with_extension(suffix);
        let written = write_and_sync(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, &self.path));
        if let Err(e) = written {
            log::warn!("{}: compiled pipelines are not kept: {e}", self.path.display());
            _ = std::fs::remove_file(&temporary);
        }
    }
}

fn write_and_sync(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let mut file = std::fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// `cairn_pipelines_load_callback`.
///
/// # Safety
/// `user` is a [`PipelineCache`] that nobody else uses during the call; `bytes` is null or has room for `capacity` bytes.
pub(crate) unsafe extern "C" fn load(bytes: *mut c_void, capacity: u64, user: *mut c_void) -> u64 {
    guarded(0, || {
        // SAFETY: the caller's promise.
        let cache = unsafe { &mut *user.cast::<PipelineCache>() };
        if bytes.is_null() {
            cache.loaded = std::fs::read(&cache.path).unwrap_or_default();
        }
        let size = cache.loaded.len();
        if !bytes.is_null() && size as u64 <= capacity {
            // SAFETY: the buffer is large enough, by the caller's promise, and the two do not overlap.
            unsafe { std::ptr::copy_nonoverlapping(cache.loaded.as_ptr(), bytes.cast(), size) };
        }
        size as u64
    })
}

/// `cairn_pipelines_store_callback`.
///
/// # Safety
/// `user` is a [`PipelineCache`]; `bytes` are `size` bytes.
pub(crate) unsafe extern "C" fn store(bytes: *const c_void, size: u64, user: *mut c_void) {
    guarded((), || {
        // SAFETY: the caller's promise.
        let cache = unsafe { &*user.cast::<PipelineCache>() };
        // SAFETY: as above.
        cache.replace(unsafe { std::slice::from_raw_parts(bytes.cast(), size as usize) });
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ptr::null_mut;

    /// The bytes that [`load`] returns.
    fn loaded(cache: &mut PipelineCache) -> Vec<u8> {
        let user = std::ptr::from_mut(cache).cast();
        // SAFETY: a cache of ours; the size is asked for.
        let size = unsafe { load(null_mut(), 0, user) };
        let mut bytes = vec![0; size as usize];
        // SAFETY: as above, with a buffer of that size.
        assert_eq!(unsafe { load(bytes.as_mut_ptr().cast(), size, user) }, size);
        bytes
    }

    #[test]
    fn stored_bytes_are_loaded_in_the_next_run() {
        let folder = std::env::temp_dir().join(format!("cairn-pipeline-cache-{}", std::process::id()));
        let path = folder.join("below").join("pipelines.bin");
        assert!(loaded(&mut PipelineCache::new(path.clone())).is_empty());
        for content in [&[1_u8, 2, 3][..], &[4; 9]] {
            let mut cache = PipelineCache::new(path.clone());
            // SAFETY: a cache of ours, and the stated number of bytes.
            unsafe { store(content.as_ptr().cast(), content.len() as u64, std::ptr::from_mut(&mut cache).cast()) };
            assert_eq!(loaded(&mut PipelineCache::new(path.clone())), content);
        }
        // No temporary file is left, and a path that cannot be written is no failure.
        assert_eq!(std::fs::read_dir(folder.join("below")).expect("a folder").count(), 1);
        PipelineCache::new(path.join("not a folder")).replace(&[1]);
        std::fs::remove_dir_all(folder).expect("ours");
    }

    #[test]
    fn a_small_buffer_is_not_written() {
        let mut cache = PipelineCache { path: PathBuf::new(), loaded: vec![7; 4] };
        let mut buffer = [0_u8; 3];
        // SAFETY: a cache of ours, and a buffer of the stated size.
        let size = unsafe { load(buffer.as_mut_ptr().cast(), 3, std::ptr::from_mut(&mut cache).cast()) };
        assert_eq!((size, buffer), (4, [0; 3]));
    }
}
