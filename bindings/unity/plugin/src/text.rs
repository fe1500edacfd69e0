//! Copies text into a caller's buffer.

use std::ffi::c_char;

/// Copies as much of `text` as fits, with a terminating NUL, and writes the full length.
///
/// # Safety
/// `to` is null, or has room for `capacity` bytes; `length` is null or can be written.
pub(crate) unsafe fn copy(text: &str, to: *mut c_char, capacity: usize, length: *mut usize) {
    if !length.is_null() && length.is_aligned() {
        // SAFETY: checked, and the caller's promise.
        unsafe { length.write(text.len()) };
    }
    if to.is_null() || capacity == 0 {
        return;
    }
    let mut end = text.len().min(capacity - 1);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    // SAFETY: `end` is less than the capacity, and the two do not overlap.
    unsafe { std::ptr::copy_nonoverlapping(text.as_ptr(), to.cast(), end) };
    // SAFETY: as above.
    unsafe { to.add(end).write(0) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_truncated_between_characters() {
        for (capacity, expected) in [(0, "xxxx"), (1, ""), (2, "a"), (3, "a"), (4, "aä")] {
            let mut buffer = [b'x'; 5];
            let mut length = 0;
            // SAFETY: the buffer has the stated capacity.
            unsafe { copy("aä", buffer.as_mut_ptr().cast(), capacity, &mut length) };
            let end = if capacity == 0 { 4 } else { buffer.iter().position(|byte| *byte == 0).expect("an end") };
            assert_eq!((std::str::from_utf8(&buffer[..end]), length), (Ok(expected), 3), "{capacity}");
        }
        // SAFETY: nothing is written.
        unsafe { copy("a", std::ptr::null_mut(), 7, std::ptr::null_mut()) };
    }
}
