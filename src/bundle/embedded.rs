//! The world inside this library, with feature `embedded-world`: `samples/worlds/miniature.cairn`, which
//! `samples/worlds/miniature` trains.

use std::sync::Arc;

use super::container::Container;
use super::{Bundle, OpenOptions, open};
use crate::{Error, ErrorKind, Result};

#[cfg(feature = "embedded-world")]
const ARCHIVE: Option<&[u8]> = Some(include_bytes!("../../samples/worlds/miniature.cairn"));
#[cfg(not(feature = "embedded-world"))]
const ARCHIVE: Option<&[u8]> = None;

impl Bundle {
    /// The world embedded in this library. It is checked like any other, and its bytes stay where they are in the library.
    ///
    /// # Errors
    /// `Unsupported` for a library that was built without feature `embedded-world`; `Cancelled` and `OutOfMemory` by the
    /// options.
    pub fn embedded(options: &OpenOptions<'_>) -> Result<Arc<Self>> {
        let archive = ARCHIVE.ok_or_else(|| {
            Error::new(ErrorKind::Unsupported, "this library has no embedded world")
                .remedy("Give a bundle's path, or build Cairn with its feature embedded-world")
        })?;
        open::load(Container::from_archive(archive.into())?, options).map(Arc::new)
    }
}
