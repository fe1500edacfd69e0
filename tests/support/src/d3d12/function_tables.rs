//! Replaces functions in the tables that all Direct3D objects of a kind share.

use std::ffi::c_void;
use std::sync::OnceLock;

#[link(name = "kernel32")]
unsafe extern "system" {
    fn VirtualProtect(address: *mut c_void, size: usize, protection: u32, before: *mut u32) -> i32;
}
const READ_WRITE: u32 = 4;

/// Writes `replacement` into the entry `place` of a live table for the rest of the process. `original` gets the old value first: other
/// threads may be using the table, and `replacement` can be called at once. A second call changes nothing.
#[allow(clippy::not_unsafe_ptr_arg_deref, reason = "only for tests, which pass entries of live tables")]
pub fn replace_function<F: Copy>(place: *const F, original: &OnceLock<F>, replacement: F) {
    assert_eq!(size_of::<F>(), size_of::<usize>(), "a function");
    // SAFETY: an entry in a live table. Volatile, since the compiler assumes that an interface's table is constant.
    original.get_or_init(|| unsafe { place.read_volatile() });
    let place = place.cast_mut();
    let mut before = 0;
    // SAFETY: the page of a live table, and a variable that lives during the call.
    assert!(unsafe { VirtualProtect(place.cast(), size_of::<F>(), READ_WRITE, &mut before) } != 0, "it can be written");
    // SAFETY: a table that the process may write now, and a function of the same type. Volatile, as above: otherwise the compiler could omit
    // the write.
    unsafe { place.write_volatile(replacement) };
    // SAFETY: as above.
    assert!(unsafe { VirtualProtect(place.cast(), size_of::<F>(), before, &mut before) } != 0, "it is as before");
}
