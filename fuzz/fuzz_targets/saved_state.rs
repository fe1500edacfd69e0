#![no_main]

use test_support::fuzz_targets;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    fuzz_targets::saved_state(bytes);
});
