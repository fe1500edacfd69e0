//! What a library has to say, into our log.
//!
//! Its callback has no pointer of the host's and is one for a whole library, so it is one function for all of them.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The longest message that is read, in units of UTF-16.
const LONGEST: usize = 2048;

thread_local! {
    /// What was said during the present call on this thread.
    static SAID: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Forgets what was said.
pub(super) fn forget() {
    SAID.with_borrow_mut(String::clear);
}

/// What was said on this thread since [`forget`].
pub(super) fn last() -> String {
    SAID.with_borrow(String::clone)
}

/// Gets a message from a library: 0 is an error, all else a warning.
///
/// # Safety
/// `text` is null, or readable up to its zero, or as far as the longest message that is read.
pub(super) unsafe extern "C" fn receive(kind: u32, text: *const u16) {
    if text.is_null() {
        return;
    }
    // SAFETY: stops at the zero, so that nothing behind it is read.
    let length = (0..LONGEST).take_while(|&at| unsafe { text.add(at).read() } != 0).count();
    // SAFETY: the units that were read above.
    let text = String::from_utf16_lossy(unsafe { std::slice::from_raw_parts(text, length) });
    let text = text.trim();
    // A host's logger may do anything; nothing of it may get into the library.
    _ = catch_unwind(AssertUnwindSafe(|| {
        let level = if kind == 0 { log::Level::Error } else { log::Level::Warn };
        log::log!(target: "cairn::ffx", level, "{text}");
        SAID.with_borrow_mut(|said| {
            if said.len() < LONGEST {
                said.push_str(if said.is_empty() { "" } else { ", " });
                said.push_str(text);
            }
        });
    }));
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
    fn what_is_said_is_kept_until_the_next_call() {
        forget();
        say("the first \n");
        say("größer 😀");
        // SAFETY: null is allowed.
        unsafe { receive(0, std::ptr::null()) };
        assert_eq!(last(), "the first, größer 😀");
        std::thread::spawn(|| assert_eq!(last(), "", "another thread's calls are its own")).join().expect("no panic");
        forget();
        assert_eq!(last(), "");
    }

    #[test]
    fn a_message_without_an_end_is_read_so_far_and_no_further() {
        forget();
        let endless = vec![u16::from(b'a'); LONGEST];
        // SAFETY: as long as what is read.
        unsafe { receive(0, endless.as_ptr()) };
        assert_eq!(last().len(), LONGEST);
    }
}
