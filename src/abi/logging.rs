//! Passes the library's log messages to the host's callback.

use std::ffi::{c_char, c_void};
use std::sync::{Arc, OnceLock};

use crate::locks::Mutex;
use crate::quiet_mutex;

use super::boundary::call;
use super::gate::{CallKind, Gate};
use super::results::{CAIRN_ERROR_BUSY, CAIRN_ERROR_UNSUPPORTED, CAIRN_OK, Failure, cairn_result};

/// No messages.
pub const CAIRN_LOG_OFF: u32 = 0;
/// Something failed.
pub const CAIRN_LOG_ERROR: u32 = 1;
/// Something unexpected happened, and the work continues.
pub const CAIRN_LOG_WARNING: u32 = 2;
/// Information for users.
pub const CAIRN_LOG_INFO: u32 = 3;
/// Information for developers.
pub const CAIRN_LOG_DEBUG: u32 = 4;
/// All messages.
pub const CAIRN_LOG_TRACE: u32 = 5;

/// Gets one message. level is one of CAIRN_LOG_ERROR to CAIRN_LOG_TRACE; target names the part of the library, such as
/// "cairn::onnxruntime"; both texts are UTF-8 and valid during the call only. user is the pointer that was set with the callback.
///
/// It is called on the thread that logs the message, also on several at once, without any lock held. It may call Cairn, but must not
/// destroy an object that a call further up the stack is using, and must not throw. Messages that its own thread logs while it runs
/// are dropped.
pub type cairn_log_callback =
    Option<unsafe extern "C" fn(level: u32, target: *const c_char, message: *const c_char, user: *mut c_void)>;

/// Sets the callback that gets messages up to level, CAIRN_LOG_OFF to CAIRN_LOG_TRACE. A null callback ends logging. The whole process
/// has one callback; without one nothing is logged.
///
/// When this returns, the former callback is not running and will not be called again, so the memory of its user pointer may be freed.
///
/// Ownership: user stays the caller's; on success it must live until another callback is set, on failure nothing changes.
/// Threads: any thread; waits for calls of the former callback. Not from within that callback.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT for another level; CAIRN_ERROR_BUSY from within the former callback;
/// CAIRN_ERROR_UNSUPPORTED when the library is linked into a program that has set a logger of its own.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_set_log_callback(
    level: u32,
    callback: cairn_log_callback,
    user: *mut c_void,
) -> cairn_result {
    call("cairn_set_log_callback", || {
        let filter = filter(level).ok_or_else(|| {
            Failure::argument("level", format!("{level} is none. Use CAIRN_LOG_OFF to CAIRN_LOG_TRACE, 0 to 5"))
        })?;
        static IS_INSTALLED: OnceLock<bool> = OnceLock::new();
        if !IS_INSTALLED.get_or_init(|| log::set_logger(&CallbackLogger).is_ok()) {
            return Err(
                Failure::new(CAIRN_ERROR_UNSUPPORTED, "this program has a logger of its own").remedy("Use that")
            );
        }
        let filter = callback.map_or(log::LevelFilter::Off, |_| filter);
        let sink = callback.map(|callback| Arc::new(Sink { callback, user, filter, gate: Gate::default() }));
        let former = {
            let mut current = SINK.lock();
            if current.as_ref().is_some_and(|sink| sink.gate.has_call_of_this_thread()) {
                return Err(
                    Failure::new(CAIRN_ERROR_BUSY, "this is the former callback itself").remedy("Return from it first")
                );
            }
            log::set_max_level(filter);
            std::mem::replace(&mut *current, sink)
        };
        if let Some(former) = former {
            former.gate.wait_empty();
        }
        Ok(CAIRN_OK)
    })
}

static SINK: Mutex<Option<Arc<Sink>>> = Mutex::new(None);

/// The host's callback, with the calls of it that have not returned.
struct Sink {
    callback: unsafe extern "C" fn(u32, *const c_char, *const c_char, *mut c_void),
    user: *mut c_void,
    filter: log::LevelFilter,
    gate: Gate,
}

// SAFETY: the pointer is the host's; the documentation of the callback says that it is used on any thread.
unsafe impl Send for Sink {}
// SAFETY: as above.
unsafe impl Sync for Sink {}

/// The process's logger: passes messages to the current callback.
struct CallbackLogger;

impl log::Log for CallbackLogger {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= log::max_level()
    }

    fn log(&self, record: &log::Record<'_>) {
        if quiet_mutex::delays(record) {
            return;
        }
        let text = |text: String| text.replace('\0', " ") + "\0";
        let (target, message) = (text(record.target().to_owned()), text(record.args().to_string()));
        let sink = {
            let current = SINK.lock();
            let accepts = |sink: &&Arc<Sink>| record.level() <= sink.filter && !sink.gate.has_call_of_this_thread();
            let Some(sink) = current.as_ref().filter(accepts) else { return };
            // Under the lock, so that a thread that replaces the callback waits for this call.
            sink.gate.enter(CallKind::Concurrent);
            sink.clone()
        };
        // SAFETY: both texts end in a NUL and live through the call; the rest is the host's promise.
        unsafe { (sink.callback)(record.level() as u32, target.as_ptr().cast(), message.as_ptr().cast(), sink.user) };
        sink.gate.leave(CallKind::Concurrent);
    }

    fn flush(&self) {}
}

/// The filter of a level: CAIRN_LOG_OFF to CAIRN_LOG_TRACE are `log`'s own numbers.
fn filter(level: u32) -> Option<log::LevelFilter> {
    log::LevelFilter::iter().nth(level as usize)
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::super::results::CAIRN_ERROR_INVALID_ARGUMENT;
    use super::*;

    #[derive(Default)]
    struct Messages(Mutex<Vec<(u32, String)>>);

    unsafe extern "C" fn collect(level: u32, target: *const c_char, message: *const c_char, user: *mut c_void) {
        // SAFETY: the test passes `Messages` that outlive the callback, and texts are valid during the call.
        let (messages, target, message) =
            unsafe { (&*user.cast::<Messages>(), CStr::from_ptr(target), CStr::from_ptr(message)) };
        if target.to_bytes() != b"abi-test" {
            return;
        }
        messages.0.lock().push((level, message.to_string_lossy().into_owned()));
        log::error!(target: "abi-test", "an echo that is dropped");
        // SAFETY: refused while the callback runs.
        let refused = unsafe { cairn_set_log_callback(CAIRN_LOG_OFF, None, std::ptr::null_mut()) };
        assert_eq!(refused, CAIRN_ERROR_BUSY);
    }

    #[test]
    fn messages_go_to_the_callback_until_it_is_replaced() {
        let messages = Messages::default();
        let user = std::ptr::from_ref(&messages).cast_mut().cast();
        // SAFETY: `messages` outlive the callback.
        let set = |level, callback| unsafe { cairn_set_log_callback(level, callback, user) };
        assert_eq!(set(6, None), CAIRN_ERROR_INVALID_ARGUMENT);
        assert_eq!(set(CAIRN_LOG_WARNING, Some(collect)), CAIRN_OK);
        log::warn!(target: "abi-test", "one\0{}", 1);
        log::info!(target: "abi-test", "not important enough");
        assert_eq!(set(CAIRN_LOG_TRACE, Some(collect)), CAIRN_OK);
        log::trace!(target: "abi-test", "two");
        assert_eq!(set(CAIRN_LOG_TRACE, None), CAIRN_OK);
        log::error!(target: "abi-test", "too late");
        assert_eq!(*messages.0.lock(), [(CAIRN_LOG_WARNING, "one 1".to_owned()), (CAIRN_LOG_TRACE, "two".to_owned())]);
    }
}
