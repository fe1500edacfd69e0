//! Reads and writes text in the host's memory: UTF-8 with a final NUL. No pointer is kept.

use std::ffi::c_char;

use super::results::{AbiResult, CAIRN_OK, CAIRN_TRUNCATED, Failure};

/// The longest text that is read, in bytes without its NUL: longer than any path that a system accepts.
const MAX_TEXT: usize = 65_535;

/// Reads a text that may be null. `name` is the argument's name, for messages.
///
/// # Safety
/// `text` is null or points to bytes that can be read up to the first NUL, or up to 65,536 of them.
pub(super) unsafe fn optional_text<'a>(text: *const c_char, name: &str) -> AbiResult<Option<&'a str>> {
    if text.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's promise covers every byte up to the first NUL.
    let is_end = |&i: &usize| unsafe { *text.add(i) } == 0;
    let len = (0..=MAX_TEXT)
        .find(is_end)
        .ok_or_else(|| Failure::argument(name, format!("the text has no NUL in its first {} bytes", MAX_TEXT + 1)))?;
    // SAFETY: these bytes were just read.
    let bytes = unsafe { std::slice::from_raw_parts(text.cast::<u8>(), len) };
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok(Some(text)),
        Err(e) => Err(Failure::argument(name, format!("the text is not UTF-8 (byte {})", e.valid_up_to()))),
    }
}

/// Reads a text that must not be null.
///
/// # Safety
/// As [`optional_text`].
pub(super) unsafe fn required_text<'a>(text: *const c_char, name: &str) -> AbiResult<&'a str> {
    // SAFETY: the caller's promise is the same.
    unsafe { optional_text(text, name) }?.ok_or_else(|| Failure::argument(name, "a null pointer where text must be"))
}

/// Checks the pointers that [`copy_text`] gets, before there is a text; `name` is that of the argument for it.
pub(super) fn check_text_buffer(text: *mut c_char, name: &str, capacity: usize, length: *mut usize) -> AbiResult<()> {
    if text.is_null() && capacity > 0 {
        return Err(Failure::argument(name, "a null pointer with a capacity"));
    }
    if !length.is_aligned() {
        return Err(Failure::argument("length", "the pointer is misaligned"));
    }
    Ok(())
}

/// Copies as many whole characters of `from` as fit into a caller's buffer, with a final NUL; `length` gets the full length in bytes.
/// The result is CAIRN_TRUNCATED if they do not all fit. With a null `text` only `length` is written.
///
/// # Safety
/// `text` is null or has `capacity` writable bytes; `length` is null or can be written.
pub(super) unsafe fn copy_text(from: &str, text: *mut c_char, capacity: usize, length: *mut usize) -> AbiResult {
    check_text_buffer(text, "text", capacity, length)?;
    // A host could never read what follows a NUL, and would call again with more room for ever.
    let from = before_nul(from);
    if !length.is_null() {
        // SAFETY: not null, aligned, and writable by the caller's promise.
        unsafe { length.write(from.len()) };
    }
    if text.is_null() {
        return Ok(CAIRN_OK);
    }
    let Some(max_bytes) = capacity.checked_sub(1) else { return Ok(CAIRN_TRUNCATED) };
    let fitting = truncate(from, max_bytes);
    // SAFETY: `fitting` and its NUL are no longer than the caller's capacity, and cannot overlap text of our own.
    unsafe {
        text.cast::<u8>().copy_from_nonoverlapping(fitting.as_ptr(), fitting.len());
        text.add(fitting.len()).write(0);
    }
    Ok(if fitting.len() == from.len() { CAIRN_OK } else { CAIRN_TRUNCATED })
}

/// A text as a struct's fixed-size array: truncated if too long, padded with zeroes.
pub(super) fn fixed_text<const N: usize>(from: &str) -> [c_char; N] {
    let mut text = [0; N];
    for (to, byte) in text.iter_mut().zip(truncate(from, N.saturating_sub(1)).bytes()) {
        *to = byte as c_char;
    }
    text
}

/// The text before its first NUL.
fn before_nul(text: &str) -> &str {
    text.split('\0').next().unwrap_or_default()
}

/// The longest prefix of whole characters that has at most `max_bytes` bytes and ends before the first NUL.
fn truncate(text: &str, max_bytes: usize) -> &str {
    let text = before_nul(text);
    let end = (0..=max_bytes.min(text.len())).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0);
    &text[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_truncated_between_characters() {
        assert_eq!(truncate("aé", 3), "aé");
        assert_eq!(truncate("aé", 2), "a");
        assert_eq!(truncate("a\0b", 9), "a");
        assert_eq!(fixed_text::<4>("abcdef"), [b'a' as c_char, b'b' as c_char, b'c' as c_char, 0]);
        assert_eq!(fixed_text::<1>("abc"), [0]);
    }

    #[test]
    fn refuses_null_invalid_utf8_and_unterminated_text() {
        // SAFETY: each is ended by a NUL, or has 65,536 bytes.
        unsafe {
            assert!(required_text(std::ptr::null(), "a").is_err());
            assert_eq!(optional_text(std::ptr::null(), "a").unwrap(), None);
            assert!(required_text(c"\xff\xfe".as_ptr(), "a").unwrap_err().to_string().contains("UTF-8 (byte 0)"));
            let endless = vec![b'a'; MAX_TEXT + 1];
            assert!(required_text(endless.as_ptr().cast(), "a").is_err());
            assert_eq!(required_text(c"h\xc3\xb6".as_ptr(), "a").unwrap(), "hö");
        }
    }

    #[test]
    fn nothing_is_written_past_the_capacity() {
        let mut buffer = [7 as c_char; 8];
        let mut length = 0;
        // SAFETY: the capacity named is less than what is there.
        let result = unsafe { copy_text("añb", buffer.as_mut_ptr(), 3, &mut length) }.unwrap();
        assert_eq!((result, length, buffer), (CAIRN_TRUNCATED, 4, [b'a' as c_char, 0, 7, 7, 7, 7, 7, 7]));
        // SAFETY: the buffer has eight bytes.
        let result = unsafe { copy_text("a\0b", buffer.as_mut_ptr(), 8, &mut length) }.unwrap();
        assert_eq!((result, length), (CAIRN_OK, 1), "the text ends before the NUL");
        // SAFETY: nothing is written without a capacity.
        assert_eq!(unsafe { copy_text("ab", buffer.as_mut_ptr(), 0, std::ptr::null_mut()) }.unwrap(), CAIRN_TRUNCATED);
        // SAFETY: as above.
        assert!(unsafe { copy_text("ab", std::ptr::null_mut(), 1, &mut length) }.is_err());
    }
}
