//! Compiles the C program that turns bytes into calls of the C interface.

use std::path::PathBuf;

fn main() {
    let out = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo names a folder"));
    // A saved rollout that some of the calls read.
    let state = format!("\"{}\"", out.join("calls-state.bin").display());
    let mut build = cc::Build::new();
    build.std("c11").define("_GNU_SOURCE", None).define("STATE_FILE", state.as_str());
    build.include("../include").file("calls.c").compile("calls");
    for path in ["calls.c", "../include/cairn.h", "../tests/abi"] {
        println!("cargo::rerun-if-changed={path}");
    }
}
