//! Gives the shared library for Linux its `DT_SONAME`. Without one, a program that is linked with the library's path looks for it at that path
//! only.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libcairn.so");
    }
}
