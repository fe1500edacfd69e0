#![no_main]

use study::fuzz_targets;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz_targets::seed_picture(bytes));
