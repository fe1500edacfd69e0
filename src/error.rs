//! The one error type of the library: what went wrong, where, and what to do.

use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What a panic said, where it said anything.
pub(crate) fn panic_text(payload: &(dyn Any + Send)) -> Option<&str> {
    payload.downcast_ref::<String>().map(String::as_str).or_else(|| payload.downcast_ref().copied())
}

/// Does `work`; a panic in it is logged and becomes an error of kind [`ErrorKind::Internal`].
pub(crate) fn catch_panic<T, E: From<Error>>(work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let what = panic_text(&*payload).unwrap_or("no message");
        let error =
            Error::new(ErrorKind::Internal, format!("a fault of the library: {what}")).remedy("Please report it");
        discard(payload);
        let _ = catch_unwind(|| log::error!(target: "cairn", "{error}"));
        Err(error.into())
    })
}

/// Drops what a panic threw. That is foreign code and may panic as well: what it throws is kept from dropping unless it is text.
fn discard(payload: Box<dyn Any + Send>) {
    if let Err(again) = catch_unwind(AssertUnwindSafe(|| drop(payload)))
        && !again.is::<&str>()
        && !again.is::<String>()
    {
        std::mem::forget(again);
    }
}

/// The class of a failure. A host decides by this; people read the message.
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
    /// The object is in use by something that allows no second call beside it; nothing was done.
    Busy,
    /// The caller asked to stop.
    Cancelled,
    /// The object was left half done by a fault of the library; it can only be dropped.
    Poisoned,
    /// A fault of the library: a panic.
    Internal,
}

/// A failure with its cause, the offending field where there is one, and a remedy where one is known.
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

    /// Says what the reader can do about it, as an imperative sentence without a final stop.
    #[must_use]
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }

    /// The class of the failure.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// What is wrong, one sentence without a final stop.
    pub fn cause(&self) -> &str {
        &self.cause
    }

    /// What the reader can do about it, where a remedy is known.
    pub fn remedy_text(&self) -> Option<&str> {
        self.remedy.as_deref()
    }

    /// The offending field, where one was named.
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
