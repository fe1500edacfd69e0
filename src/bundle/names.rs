//! File names inside a bundle: `docs/bundle.md` section 1.

/// The longest name, in characters (which are all ASCII, so bytes too).
pub(super) const MAX_NAME: usize = 200;

/// The naming rule that `name` violates; `None` for a valid file name inside a bundle.
///
/// A valid name cannot lead out of the bundle on any system: it has no root, drive, backslash, `.` or `..`, no device name of Windows
/// (`NUL`, `com1.bin`), and no component that Windows would shorten (a final dot).
pub(super) fn violation(name: &str) -> Option<&'static str> {
    if name.is_empty() {
        return Some("the name is empty");
    }
    if name.len() > MAX_NAME {
        return Some("the name is longer than 200 characters");
    }
    name.split('/').find_map(component_violation)
}

fn component_violation(part: &str) -> Option<&'static str> {
    if part.is_empty() {
        return Some("the name has an empty component: it is absolute, ends in `/` or repeats one");
    }
    if part == "." || part == ".." {
        return Some("the name has a `.` or `..` component");
    }
    if !part.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-')) {
        return Some("the name has a character outside A-Z a-z 0-9 . _ - and /");
    }
    if part.ends_with('.') {
        return Some("a component of the name ends in a dot");
    }
    is_windows_device_name(part).then_some("a component of the name is a device name of Windows")
}

fn is_windows_device_name(part: &str) -> bool {
    let stem = part.split('.').next().unwrap_or(part).to_ascii_uppercase();
    match stem.as_str() {
        "CON" | "PRN" | "AUX" | "NUL" => true,
        other => ["COM", "LPT"]
            .iter()
            .any(|port| other.strip_prefix(port).is_some_and(|n| matches!(n.as_bytes(), [b'0'..=b'9']))),
    }
}

#[cfg(test)]
mod tests {
    use super::violation;

    #[test]
    fn plain_names_are_valid() {
        for name in
            ["a", "weights.bin", "a/b/c.onnx", "-", "..a", "a..b", "COM", "COM10", "console.bin", &"a".repeat(200)]
        {
            assert_eq!(violation(name), None, "{name}");
        }
    }

    #[test]
    fn names_that_lead_out_of_the_bundle_are_refused() {
        for name in [
            "",
            ".",
            "..",
            "../a",
            "a/..",
            "a/../b",
            "./a",
            "a/./b",
            "/a",
            "//a",
            "a/",
            "a//b",
            "\\a",
            "a\\b",
            "..\\a",
            "C:a",
            "C:/a",
            "c:\\a",
            "\\\\host\\share",
            "//?/C:/a",
            "file:///a",
            "a\0b",
            "a b",
            "ä",
            "a:stream",
            "NUL",
            "nul.bin",
            "b/CoM1",
            "lpt9.onnx",
            "a.",
            "b./c",
            "~/a\n",
            "%2e%2e/a",
            &"a".repeat(201),
        ] {
            assert!(violation(name).is_some(), "{name:?}");
        }
    }
}
