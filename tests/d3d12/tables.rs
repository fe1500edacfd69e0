//! Functions of Direct3D's objects, replaced in the tables that all objects of a kind share.

use std::ffi::c_void;
use std::sync::OnceLock;

#[link(name = "kernel32")]
unsafe extern "system" {
    fn VirtualProtect(address: *mut c_void, size: usize, protection: u32, before: *mut u32) -> i32;
}
const READ_WRITE: u32 = 4;

/// Puts `ours` into a place of a table of functions for the rest of the process, and before that what was there into `theirs`: others
/// may be in the midst of something, and ours is called at once. Done again it changes nothing.
pub(crate) fn replace<F: Copy>(place: *const F, theirs: &OnceLock<F>, ours: F) {
    assert_eq!(size_of::<F>(), size_of::<usize>(), "a function");
    // SAFETY: a place in a live table. Volatile, as the compiler takes the table of an interface for constant.
    theirs.get_or_init(|| unsafe { place.read_volatile() });
    let place = place.cast_mut();
    let mut before = 0;
    // SAFETY: the page of a live table, and a place that lives during the call.
    assert!(unsafe { VirtualProtect(place.cast(), size_of::<F>(), READ_WRITE, &mut before) } != 0, "it can be written");
    // SAFETY: a table that the process may write now, and a function of the same type. Volatile, as above: what need not be written
    // would be left out.
    unsafe { place.write_volatile(ours) };
    // SAFETY: as above.
    assert!(unsafe { VirtualProtect(place.cast(), size_of::<F>(), before, &mut before) } != 0, "it is as before");
}
