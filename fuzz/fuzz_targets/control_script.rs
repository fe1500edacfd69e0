#![no_main]

#[path = "../bodies.rs"]
#[allow(dead_code, reason = "each target needs one body")]
mod bodies;
#[path = "../../tests/support/mod.rs"]
mod support;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| bodies::control_script(bytes));
