//! AMD's libraries: found, checked and loaded. They stay loaded until the process ends.

#[cfg(windows)]
mod loading;
#[cfg(windows)]
mod module;
mod search;
#[cfg(windows)]
mod signature;

pub use search::LibraryKind;
#[cfg(windows)]
pub use {
    loading::{File, Library, LoadOptions, allow_unsigned_in_host},
    signature::signer_of,
};

#[cfg(windows)]
pub use crate::libraries::FileVersion;
#[cfg(windows)]
pub(super) use module::Module;
