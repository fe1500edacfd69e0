//! Forwards the libraries' messages to our log.
//!
//! ffx-api's message callback has no user pointer and is set once for a whole library, so one function serves all.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Messages are cut to this length, in UTF-16 units.
const LONGEST: usize = 2048;

thread_local! {
    /// Messages received during the current call on this thread.
    static MESSAGES: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Clears this thread's messages.
pub(super) fn clear() {
    MESSAGES.with_borrow_mut(String::clear);
}

/// This thread's messages since [`clear`].
pub(super) fn collected() -> String {
    MESSAGES.with_borrow(String::clone)
}

/// The message callback: kind 0 is an error, all others warnings.
///
/// # Safety
/// `text` is null, or readable up to its terminating zero or up to `LONGEST` units.
pub(super) unsafe extern "C" fn receive(kind: u32, text: *const u16) {
    if text.is_null() {
        return;
    }
    // SAFETY: stops at the zero, so that nothing behind it is read.
    let length = (0..LONGEST).take_while(|&at| unsafe { text.add(at).read() } != 0).count();
    // SAFETY: the units that were read above.
    let text = String::from_utf16_lossy(unsafe { std::slice::from_raw_parts(text, length) });
    let level = if kind == 0 { log::Level::Error } else { log::Level::Warn };
    // A host's logger may panic; the panic must not unwind into the library.
    _ = catch_unwind(AssertUnwindSafe(|| record(level, text.trim())));
}

/// Logs a message, and adds it to those of this thread.
pub(super) fn record(level: log::Level, text: &str) {
    log::log!(target: "cairn::ffx", level, "{text}");
    MESSAGES.with_borrow_mut(|messages| {
        if messages.len() < LONGEST {
            messages.push_str(if messages.is_empty() { "" } else { ", " });
            messages.push_str(text);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn say(text: &str) {
        let units: Vec<u16> = text.encode_utf16().chain([0]).collect();
        // SAFETY: ends with a zero.
        unsafe { receive(1, units.as_ptr()) };
    }

    #[test]
    fn messages_are_kept_until_the_next_call() {
        clear();
        say("the first \n");
        say("größer 😀");
        // SAFETY: null is allowed.
        unsafe { receive(0, std::ptr::null()) };
        assert_eq!(collected(), "the first, größer 😀");
        std::thread::spawn(|| assert_eq!(collected(), "", "another thread's calls are its own"))
            .join()
            .expect("no panic");
        clear();
        assert_eq!(collected(), "");
    }

    #[test]
    fn a_message_without_a_terminator_is_cut() {
        clear();
        let endless = vec![u16::from(b'a'); LONGEST];
        // SAFETY: as long as the part that is read.
        unsafe { receive(0, endless.as_ptr()) };
        assert_eq!(collected().len(), LONGEST);
    }
}
