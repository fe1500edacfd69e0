//! Version numbers of the binary interface and of the library.

/// The version of the binary interface that this header declares. Compare it with cairn_abi_version() of the loaded library.
///
/// History: 1 was the first; since 2, devices are created with cairn_device_options.
pub const CAIRN_ABI_VERSION: u32 = 2;

/// The version of the library that this header belongs to: major * 1000000 + minor * 1000 + patch.
pub const CAIRN_VERSION: u32 = 1000;

/// The version of the loaded library's binary interface. If it differs from CAIRN_ABI_VERSION of the header, call nothing else:
/// structs or functions have changed.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: the number itself; cannot fail.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub extern "C" fn cairn_abi_version() -> u32 {
    CAIRN_ABI_VERSION
}

/// The version of the loaded library, in the form of CAIRN_VERSION. If the binary interface is equal and the library is not older
/// than the header, the library has everything that the header declares.
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
    fn the_version_equals_the_packages() {
        let [major, minor, patch] =
            [env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), env!("CARGO_PKG_VERSION_PATCH")]
                .map(|part| part.parse::<u32>().expect("a number"));
        assert_eq!(cairn_version(), major * 1_000_000 + minor * 1_000 + patch);
    }
}
