//! Two numbers: one that must be equal, one that grows.

/// What the library was built as, to be compared with the constant of the same name in the header a host was compiled with.
///
/// History: 1 is the first; in 2 devices have cairn_device_options.
pub const CAIRN_ABI_VERSION: u32 = 2;

/// The version of the library this header belongs to: major * 1000000 + minor * 1000 + patch.
pub const CAIRN_VERSION: u32 = 1000;

/// The binary interface of the loaded library. It must be equal to CAIRN_ABI_VERSION of the header, or nothing else may be
/// called: structs or functions have changed in a way that old hosts cannot know.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: the number itself; cannot fail.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub extern "C" fn cairn_abi_version() -> u32 {
    CAIRN_ABI_VERSION
}

/// The version of the loaded library, as CAIRN_VERSION. Where the binary interface is equal, a library that is not older
/// than the header has all that the header names.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: the number itself; cannot fail.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub extern "C" fn cairn_version() -> u32 {
    CAIRN_VERSION
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_the_package_s() {
        let [major, minor, patch] =
            [env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), env!("CARGO_PKG_VERSION_PATCH")]
                .map(|part| part.parse::<u32>().expect("a number"));
        assert_eq!(cairn_version(), major * 1_000_000 + minor * 1_000 + patch);
    }
}
