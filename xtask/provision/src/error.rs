//! The crate's error: the wanted item, the cause, and a remedy.

use std::fmt;
use std::path::Path;

/// Result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A failure to provide something: what was wanted, what went wrong, and a remedy.
#[derive(Debug, Clone)]
pub struct Error {
    /// What was wanted, e.g. `ONNX Runtime 1.24.4`.
    pub wanted: String,
    /// What went wrong; may have several lines when a tool's own words are quoted.
    pub cause: String,
    /// What the reader can do about it, as an imperative sentence.
    pub remedy: String,
}

impl Error {
    pub(crate) fn new(wanted: impl Into<String>, cause: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { wanted: wanted.into(), cause: cause.into(), remedy: remedy.into() }
    }

    /// A file operation on `path` that the operating system refused.
    pub(crate) fn io(path: &Path, error: &std::io::Error) -> Self {
        Self::new(
            path.display().to_string(),
            error.to_string(),
            "Check that the disk has room and that the folder is yours to write, or set CAIRN_CACHE_DIR to another one",
        )
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}. {}", self.wanted, self.cause.trim_end_matches(['.', '\n']), self.remedy)
    }
}

impl std::error::Error for Error {}
