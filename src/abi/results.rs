//! Result codes, and the last error of each thread.

use std::cell::RefCell;
use std::ffi::c_char;
use std::fmt;

use super::text::copy_text;
use crate::error::catch_panic;
use crate::{Error, ErrorKind};

/// The result of a call: 0 is success, a positive number is not an error, a negative one is. A number never gets another meaning;
/// a newer library may return numbers that this header does not know, whose sign has the same meaning.
pub type cairn_result = i32;

/// Success.
pub const CAIRN_OK: cairn_result = 0;
/// Not an error: the result is not available yet. Ask again later.
pub const CAIRN_NOT_READY: cairn_result = 1;
/// Not an error: a text was longer than the buffer, which holds its beginning.
pub const CAIRN_TRUNCATED: cairn_result = 2;
/// Not an error: the queue is full and nothing was added to it. Take results from it, then try again.
pub const CAIRN_QUEUE_FULL: cairn_result = 3;
/// An argument is outside its range, not finite, null, misaligned or not UTF-8. The message names it.
pub const CAIRN_ERROR_INVALID_ARGUMENT: cairn_result = -1;
/// The handle is null, was destroyed, belongs to another kind of object, or never was one.
pub const CAIRN_ERROR_INVALID_HANDLE: cairn_result = -2;
/// A struct_size is not one that the struct has had, or it is larger and sets bytes that this library does not know.
pub const CAIRN_ERROR_STRUCT_SIZE: cairn_result = -3;
/// The object is in use by a call that allows no other beside it. Nothing was done.
pub const CAIRN_ERROR_BUSY: cairn_result = -4;
/// A valid request that this build, platform, device or world cannot serve.
pub const CAIRN_ERROR_UNSUPPORTED: cairn_result = -5;
/// More memory is needed than is available or allowed. The message has the numbers.
pub const CAIRN_ERROR_OUT_OF_MEMORY: cairn_result = -6;
/// The operating system refused a file operation.
pub const CAIRN_ERROR_IO: cairn_result = -7;
/// The world's bundle is damaged, tampered with, or breaks the format.
pub const CAIRN_ERROR_INVALID_BUNDLE: cairn_result = -8;
/// ONNX Runtime, or AMD's libraries for a call that needs them, is missing or has the wrong version.
pub const CAIRN_ERROR_RUNTIME_MISSING: cairn_result = -9;
/// ONNX Runtime or the device failed while running.
pub const CAIRN_ERROR_DEVICE: cairn_result = -10;
/// A saved state is damaged, or belongs to another world.
pub const CAIRN_ERROR_INVALID_STATE: cairn_result = -11;
/// The host cancelled the work.
pub const CAIRN_ERROR_CANCELLED: cairn_result = -12;
/// An earlier call on this object failed by a fault of the library. The object can only be destroyed.
pub const CAIRN_ERROR_POISONED: cairn_result = -13;
/// A fault of the library. The objects that the call was using are poisoned; all others still work. Please report the message.
pub const CAIRN_ERROR_INTERNAL: cairn_result = -14;
/// The graphics device was removed: for example, its driver was replaced, a command hung, or the adapter was taken out. The message
/// has the reason. Destroy everything that was made on the device, and create a new one.
pub const CAIRN_ERROR_DEVICE_REMOVED: cairn_result = -15;

/// The name of a result, such as "CAIRN_ERROR_IO"; "unknown result" for a number that this library never returns.
///
/// Ownership: the text is static and must not be freed, on success or on failure.
/// Threads: any thread, at any time.
/// Results: the text; never null, cannot fail.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub extern "C" fn cairn_result_name(result: cairn_result) -> *const c_char {
    let name = match result {
        CAIRN_OK => c"CAIRN_OK",
        CAIRN_NOT_READY => c"CAIRN_NOT_READY",
        CAIRN_TRUNCATED => c"CAIRN_TRUNCATED",
        CAIRN_QUEUE_FULL => c"CAIRN_QUEUE_FULL",
        CAIRN_ERROR_INVALID_ARGUMENT => c"CAIRN_ERROR_INVALID_ARGUMENT",
        CAIRN_ERROR_INVALID_HANDLE => c"CAIRN_ERROR_INVALID_HANDLE",
        CAIRN_ERROR_STRUCT_SIZE => c"CAIRN_ERROR_STRUCT_SIZE",
        CAIRN_ERROR_BUSY => c"CAIRN_ERROR_BUSY",
        CAIRN_ERROR_UNSUPPORTED => c"CAIRN_ERROR_UNSUPPORTED",
        CAIRN_ERROR_OUT_OF_MEMORY => c"CAIRN_ERROR_OUT_OF_MEMORY",
        CAIRN_ERROR_IO => c"CAIRN_ERROR_IO",
        CAIRN_ERROR_INVALID_BUNDLE => c"CAIRN_ERROR_INVALID_BUNDLE",
        CAIRN_ERROR_RUNTIME_MISSING => c"CAIRN_ERROR_RUNTIME_MISSING",
        CAIRN_ERROR_DEVICE => c"CAIRN_ERROR_DEVICE",
        CAIRN_ERROR_INVALID_STATE => c"CAIRN_ERROR_INVALID_STATE",
        CAIRN_ERROR_CANCELLED => c"CAIRN_ERROR_CANCELLED",
        CAIRN_ERROR_POISONED => c"CAIRN_ERROR_POISONED",
        CAIRN_ERROR_INTERNAL => c"CAIRN_ERROR_INTERNAL",
        CAIRN_ERROR_DEVICE_REMOVED => c"CAIRN_ERROR_DEVICE_REMOVED",
        _ => c"unknown result",
    };
    name.as_ptr()
}

/// The message of the calling thread's latest failed call: what went wrong, with which argument or file, and what can be done. It
/// begins with the name of the function. Empty when no call of this thread has failed yet. Successful calls do not change it.
///
/// text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
/// length: gets the length in bytes of the whole message, without the NUL; may be null.
///
/// Ownership: the text is copied; on failure nothing is written.
/// Threads: any thread, at any time; each thread has its own message.
/// Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_ARGUMENT, which leaves the message as it was.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_last_error(text: *mut c_char, capacity: usize, length: *mut usize) -> cairn_result {
    catch_panic(|| {
        LAST_ERROR.with_borrow(|last| {
            // SAFETY: the caller's promise about `text`, `capacity` and `length` is copy_text's.
            unsafe { copy_text(&last.message, text, capacity, length) }
        })
    })
    .unwrap_or_else(|failure| failure.code)
}

/// A part of the last error: the name of the function that failed.
pub const CAIRN_LAST_ERROR_FUNCTION: u32 = 1;
/// A part of the last error: the argument, file or field that is wrong, such as "options.threads".
pub const CAIRN_LAST_ERROR_FIELD: u32 = 2;
/// A part of the last error: what is wrong, one sentence without a final stop.
pub const CAIRN_LAST_ERROR_CAUSE: u32 = 3;
/// A part of the last error: what can be done, an imperative sentence without a final stop.
pub const CAIRN_LAST_ERROR_REMEDY: u32 = 4;

/// One part of the message of cairn_last_error, for hosts that show the parts separately or raise exceptions.
///
/// part: CAIRN_LAST_ERROR_FUNCTION to CAIRN_LAST_ERROR_REMEDY. A part that the message does not have is empty.
/// text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
/// length: gets the length in bytes of the whole part, without the NUL; may be null.
///
/// Ownership: the text is copied; on failure nothing is written.
/// Threads: any thread, at any time; each thread has its own message.
/// Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_ARGUMENT, also for another part, which leaves the message as it was.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_last_error_part(
    part: u32,
    text: *mut c_char,
    capacity: usize,
    length: *mut usize,
) -> cairn_result {
    catch_panic(|| {
        LAST_ERROR.with_borrow(|last| {
            let part = match part {
                CAIRN_LAST_ERROR_FUNCTION => &last.function,
                CAIRN_LAST_ERROR_FIELD => &last.field,
                CAIRN_LAST_ERROR_CAUSE => &last.cause,
                CAIRN_LAST_ERROR_REMEDY => &last.remedy,
                _ => return Err(Failure::argument("part", format_args!("{part} is no part of a message"))),
            };
            // SAFETY: the caller's promise about `text`, `capacity` and `length` is copy_text's.
            unsafe { copy_text(part, text, capacity, length) }
        })
    })
    .unwrap_or_else(|failure| failure.code)
}

/// The last failure of a thread: the whole message, and its parts.
#[derive(Default)]
struct LastError {
    message: String,
    function: String,
    field: String,
    cause: String,
    remedy: String,
}

thread_local! {
    static LAST_ERROR: RefCell<LastError> = RefCell::default();
}

/// Makes a failure this thread's last error.
pub(super) fn set_last_error(function: &str, failure: &Failure) {
    // A thread that is ending may have dropped its thread-local values already.
    let _ = LAST_ERROR.try_with(|last| {
        if let Ok(mut last) = last.try_borrow_mut() {
            let part = |part: &Option<String>| part.clone().unwrap_or_default();
            *last = LastError {
                message: format!("{function}: {failure}"),
                function: function.to_owned(),
                field: part(&failure.field),
                cause: failure.cause.clone(),
                remedy: part(&failure.remedy),
            };
        }
    });
}

/// A failure: the code for the program, the rest for people.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub(super) code: cairn_result,
    field: Option<String>,
    cause: String,
    remedy: Option<String>,
}

/// The message, without the function's name.
impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(field) = &self.field {
            write!(f, "{field}: ")?;
        }
        f.write_str(&self.cause)?;
        match &self.remedy {
            Some(remedy) => write!(f, ". {remedy}"),
            None => Ok(()),
        }
    }
}

/// Result of an entry point's body.
pub(super) type AbiResult<T = cairn_result> = Result<T, Failure>;

impl Failure {
    /// A failure; `cause` is one sentence without a final stop.
    pub(super) fn new(code: cairn_result, cause: impl Into<String>) -> Self {
        Self { code, field: None, cause: cause.into(), remedy: None }
    }

    /// Names the argument, file or field that is wrong.
    #[must_use]
    pub(super) fn field(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// Says what can be done, as an imperative sentence without a final stop.
    #[must_use]
    pub(super) fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }

    /// An argument that breaks its documented rule.
    pub(super) fn argument(name: &str, why: impl std::fmt::Display) -> Self {
        Self::new(CAIRN_ERROR_INVALID_ARGUMENT, why.to_string()).field(name)
    }

    /// A call that needs Direct3D 12, with an object of another device or on a platform without it.
    pub(super) fn no_d3d12() -> Self {
        let (why, remedy) = if cfg!(windows) {
            ("the device or anchor is not of Direct3D 12", "Create the device with cairn_device_create_d3d12")
        } else {
            ("Direct3D 12 is not there on this platform", "Use a CPU device")
        };
        Self::new(CAIRN_ERROR_UNSUPPORTED, why).remedy(remedy)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let code = match error.kind() {
            ErrorKind::InvalidArgument => CAIRN_ERROR_INVALID_ARGUMENT,
            ErrorKind::InvalidBundle => CAIRN_ERROR_INVALID_BUNDLE,
            ErrorKind::Unsupported => CAIRN_ERROR_UNSUPPORTED,
            ErrorKind::RuntimeMissing => CAIRN_ERROR_RUNTIME_MISSING,
            ErrorKind::OutOfMemory => CAIRN_ERROR_OUT_OF_MEMORY,
            ErrorKind::Io => CAIRN_ERROR_IO,
            ErrorKind::Device => CAIRN_ERROR_DEVICE,
            ErrorKind::DeviceRemoved => CAIRN_ERROR_DEVICE_REMOVED,
            ErrorKind::InvalidState => CAIRN_ERROR_INVALID_STATE,
            ErrorKind::Busy => CAIRN_ERROR_BUSY,
            ErrorKind::Cancelled => CAIRN_ERROR_CANCELLED,
            ErrorKind::Poisoned => CAIRN_ERROR_POISONED,
            ErrorKind::Internal => CAIRN_ERROR_INTERNAL,
        };
        let part = |part: Option<&str>| part.map(str::to_owned);
        let (field, remedy) = (part(error.offending_field()), part(error.remedy_text()));
        Self { code, field, cause: error.cause().to_owned(), remedy }
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    #[test]
    fn every_result_has_its_name() {
        let mut named = 0;
        for code in -100..100 {
            // SAFETY: the function gives a static text.
            let name = unsafe { CStr::from_ptr(cairn_result_name(code)) }.to_str().expect("ASCII");
            named += usize::from(name != "unknown result");
            assert_eq!(code < 0 && name != "unknown result", name.starts_with("CAIRN_ERROR_"));
        }
        assert_eq!(named, 19);
    }

    #[test]
    fn each_thread_has_its_own_last_error() {
        set_last_error("f", &Failure::new(CAIRN_ERROR_IO, "here"));
        let mut length = 0;
        let mut text = [0xff_u8; 8];
        // SAFETY: the buffer has the capacity named.
        let read = |text: &mut [u8], length: &mut usize| unsafe {
            cairn_last_error(text.as_mut_ptr().cast(), text.len(), length)
        };
        assert_eq!((read(&mut text, &mut length), length), (CAIRN_OK, 7));
        assert_eq!(&text, b"f: here\0");
        assert_eq!((read(&mut text[..4], &mut length), length), (CAIRN_TRUNCATED, 7));
        assert_eq!(&text[..4], b"f: \0");
        set_last_error("f", &Failure::argument("a", "is wrong").remedy("Mend it"));
        let mut text = [0xff_u8; 32];
        assert_eq!((read(&mut text, &mut length), length), (CAIRN_OK, 23));
        assert_eq!(&text[..24], b"f: a: is wrong. Mend it\0");
        for (part, expected) in (1..).zip([&b"f\0"[..], b"a\0", b"is wrong\0", b"Mend it\0"]) {
            let mut text = [0xff_u8; 16];
            // SAFETY: the buffer has the capacity named.
            let result = unsafe { cairn_last_error_part(part, text.as_mut_ptr().cast(), text.len(), &mut length) };
            assert_eq!((result, length), (CAIRN_OK, expected.len() - 1));
            assert_eq!(&text[..expected.len()], expected);
        }
        for part in [0, 5, u32::MAX] {
            // SAFETY: nothing is written.
            let result = unsafe { cairn_last_error_part(part, std::ptr::null_mut(), 0, &mut length) };
            assert_eq!(result, CAIRN_ERROR_INVALID_ARGUMENT);
        }
        std::thread::spawn(move || {
            assert_eq!((read(&mut text, &mut length), length), (CAIRN_OK, 0));
        })
        .join()
        .expect("the other thread");
    }
}
