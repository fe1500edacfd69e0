#![no_main]

// The calls go to the library by their C names.
use cairn as _;

unsafe extern "C" {
    fn cairn_fuzz_calls(bytes: *const u8, size: usize);
}

// SAFETY: the player reads as many bytes as there are, and libFuzzer calls it from one thread.
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| unsafe { cairn_fuzz_calls(bytes.as_ptr(), bytes.len()) });
