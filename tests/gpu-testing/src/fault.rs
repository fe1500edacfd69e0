//! A fault on purpose: results of the device that are altered as they are read. Tests of programs that compare results turn it on; such a program
//! must then report a difference.

use std::sync::atomic::{AtomicBool, Ordering};

static ON: AtomicBool = AtomicBool::new(false);

/// Alters all that is read from now on in this process.
pub fn turn_on() {
    ON.store(true, Ordering::Relaxed);
}

/// Whether results are altered.
pub fn is_on() -> bool {
    ON.load(Ordering::Relaxed)
}

/// Flips bits 4 to 6 of every 16th byte, if results are altered.
pub fn alter(bytes: &mut [u8]) {
    if is_on() {
        bytes.iter_mut().step_by(16).for_each(|byte| *byte ^= 0x70);
    }
}
