//! The one error type of the library: what went wrong, where, and what to do.

use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The message of a panic, if it has one.
pub(crate) fn panic_text(payload: &(dyn Any + Send)) -> Option<&str> {
    payload.downcast_ref::<String>().map(String::as_str).or_else(|| payload.downcast_ref().copied())
}

/// A message about text of a file that may hold anything: its control characters are escaped.
pub(crate) fn printable(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut printable, letter| {
        if letter.is_control() {
            printable.extend(letter.escape_default())
        } else {
            printable.push(letter)
        }
        printable
    })
}

/// Runs `work`. A panic in it is logged and becomes an error of kind [`ErrorKind::Internal`].
pub(crate) fn catch_panic<T, E: From<Error>>(work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let what = panic_text(&*payload).unwrap_or("no message");
        let error =
            Error::new(ErrorKind::Internal, format!("a fault of the library: {what}")).remedy("Please report it");
        drop_payload(payload);
        let _ = catch_unwind(|| log::error!(target: "cairn", "{error}"));
        Err(error.into())
    })
}

/// Drops a panic's payload. Its destructor is foreign code and may panic as well; the second payload is leaked unless it is text.
fn drop_payload(payload: Box<dyn Any + Send>) {
    if let Err(again) = catch_unwind(AssertUnwindSafe(|| drop(payload)))
        && !again.is::<&str>()
        && !again.is::<String>()
    {
        std::mem::forget(again);
    }
}

/// The class of a failure, for programs; the message is for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// An argument is outside its documented range, or not finite.
    InvalidArgument,
    /// The bundle is damaged, tampered with, or breaks the format's contract.
    InvalidBundle,
    /// A valid request that this build, platform, device or version cannot serve.
    Unsupported,
    /// A library that is loaded at run time, ONNX Runtime or AMD's, is missing or has the wrong version.
    RuntimeMissing,
    /// More memory is needed than there is, or than was allowed.
    OutOfMemory,
    /// The operating system refused a file operation.
    Io,
    /// ONNX Runtime or the device failed while running.
    Device,
    /// The graphics device is gone: its driver was replaced, a command hung, the adapter was taken out. Nothing made on it works
    /// any more; all of it can be released, and a new device be made.
    DeviceRemoved,
    /// A saved state does not belong to this world, or is damaged.
    InvalidState,
    /// The object is in use by a call that excludes this one; nothing was done.
    Busy,
    /// The caller cancelled the operation.
    Cancelled,
    /// A fault of the library left the object in an unknown state; it can only be dropped.
    Poisoned,
    /// A fault of the library: a panic.
    Internal,
}

/// A failure: its class, cause, offending field and remedy.
#[derive(Debug, Clone)]
pub struct Error {
    kind: ErrorKind,
    cause: String,
    field: Option<String>,
    remedy: Option<String>,
}

impl Error {
    /// A failure of `kind`; `cause` is one sentence without a final stop.
    pub fn new(kind: ErrorKind, cause: impl Into<String>) -> Self {
        Self { kind, cause: cause.into(), field: None, remedy: None }
    }

    /// Names the offending field, file or argument, e.g. `geometry.tokens`.
    #[must_use]
    pub fn field(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// Adds a remedy, an imperative sentence without a final stop.
    #[must_use]
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }

    /// `removed`, if a device is lost and this error of a library does not say so.
    #[cfg(windows)]
    pub(crate) fn or_removed(self, removed: impl FnOnce() -> Option<Self>) -> Self {
        match self.kind {
            ErrorKind::Device | ErrorKind::OutOfMemory => removed().unwrap_or(self),
            _ => self,
        }
    }

    /// The class of the failure.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// The cause, one sentence without a final stop.
    pub fn cause(&self) -> &str {
        &self.cause
    }

    /// The remedy, if one is known.
    pub fn remedy_text(&self) -> Option<&str> {
        self.remedy.as_deref()
    }

    /// The offending field, file or argument, if there is one.
    pub fn offending_field(&self) -> Option<&str> {
        self.field.as_deref()
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(field) = &self.field {
            write!(f, "{field}: ")?;
        }
        f.write_str(&self.cause)?;
        if let Some(remedy) = &self.remedy {
            write!(f, ". {remedy}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {}
