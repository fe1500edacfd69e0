//! Keys by Windows virtual-key code, and their names.

use std::fmt;

/// Names of virtual-key codes in control scripts. The first name of a code is the one that scripts are written with.
const NAMES: &[(u8, &str)] = &[
    (0x01, "MOUSE_LEFT"),
    (0x02, "MOUSE_RIGHT"),
    (0x04, "MOUSE_MIDDLE"),
    (0x05, "MOUSE_X1"),
    (0x06, "MOUSE_X2"),
    (0x08, "BACKSPACE"),
    (0x09, "TAB"),
    (0x0D, "ENTER"),
    (0x10, "SHIFT"),
    (0x11, "CTRL"),
    (0x12, "ALT"),
    (0x13, "PAUSE"),
    (0x14, "CAPS_LOCK"),
    (0x1B, "ESC"),
    (0x1B, "ESCAPE"),
    (0x20, "SPACE"),
    (0x21, "PAGE_UP"),
    (0x22, "PAGE_DOWN"),
    (0x23, "END"),
    (0x24, "HOME"),
    (0x25, "LEFT"),
    (0x26, "UP"),
    (0x27, "RIGHT"),
    (0x28, "DOWN"),
    (0x2D, "INSERT"),
    (0x2E, "DELETE"),
    (0xA0, "LEFT_SHIFT"),
    (0xA1, "RIGHT_SHIFT"),
    (0xA2, "LEFT_CTRL"),
    (0xA3, "RIGHT_CTRL"),
    (0xA4, "LEFT_ALT"),
    (0xA5, "RIGHT_ALT"),
    (0xBA, "SEMICOLON"),
    (0xBB, "EQUALS"),
    (0xBC, "COMMA"),
    (0xBD, "MINUS"),
    (0xBE, "PERIOD"),
    (0xBF, "SLASH"),
    (0xC0, "BACKQUOTE"),
    (0xDB, "LEFT_BRACKET"),
    (0xDC, "BACKSLASH"),
    (0xDD, "RIGHT_BRACKET"),
    (0xDE, "QUOTE"),
];

/// A key or mouse button: its Windows virtual-key code.
///
/// Its text form is a name: `A` to `Z`, `0` to `9`, `F1` to `F24`, `NUM0` to `NUM9`, names such as `SPACE`, `SHIFT`, `LEFT` and
/// `MOUSE_LEFT`, and `VK_0x00` to `VK_0xFF` for every code.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key(pub u8);

impl Key {
    /// The key of a name, in upper or lower case; `None` for an unknown name.
    pub fn from_name(name: &str) -> Option<Self> {
        if name.len() > 16 || !name.is_ascii() {
            return None;
        }
        let name = name.to_ascii_uppercase();
        if let [letter @ (b'A'..=b'Z' | b'0'..=b'9')] = name.as_bytes() {
            return Some(Self(*letter));
        }
        if let Some(hex) = name.strip_prefix("VK_0X") {
            let code = u8::from_str_radix(hex, 16).ok()?;
            return (hex.len() == 2 && !hex.starts_with('+')).then_some(Self(code));
        }
        let numbered = |prefix: &str, first: u8, numbers: std::ops::RangeInclusive<u8>| {
            let digits = name.strip_prefix(prefix)?;
            let number: u8 = digits.parse().ok()?;
            let is_canonical =
                digits.bytes().all(|b| b.is_ascii_digit()) && (digits.len() == 1 || !digits.starts_with('0'));
            (is_canonical && numbers.contains(&number)).then(|| Self(first + number - numbers.start()))
        };
        numbered("F", 0x70, 1..=24)
            .or_else(|| numbered("NUM", 0x60, 0..=9))
            .or_else(|| NAMES.iter().find(|(_, known)| *known == name).map(|(code, _)| Self(*code)))
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            code @ (b'A'..=b'Z' | b'0'..=b'9') => write!(f, "{}", char::from(code)),
            code @ 0x60..=0x69 => write!(f, "NUM{}", code - 0x60),
            code @ 0x70..=0x87 => write!(f, "F{}", code - 0x6F),
            code => match NAMES.iter().find(|(known, _)| *known == code) {
                Some((_, name)) => f.write_str(name),
                None => write!(f, "VK_0x{code:02X}"),
            },
        }
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A set of keys: one bit for each of the 256 virtual-key codes, bit `code % 64` of word `code / 64`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct KeySet(pub [u64; 4]);

impl KeySet {
    /// No key.
    pub const NONE: Self = Self([0; 4]);

    /// Whether `key` is in the set.
    pub fn contains(self, key: Key) -> bool {
        self.0[usize::from(key.0 / 64)] >> (key.0 % 64) & 1 == 1
    }

    /// Adds `key`.
    pub fn insert(&mut self, key: Key) {
        self.0[usize::from(key.0 / 64)] |= 1 << (key.0 % 64);
    }

    /// Removes `key`.
    pub fn remove(&mut self, key: Key) {
        self.0[usize::from(key.0 / 64)] &= !(1 << (key.0 % 64));
    }

    /// The keys, in order of their codes.
    pub fn iter(self) -> impl Iterator<Item = Key> {
        (0..=255).map(Key).filter(move |key| self.contains(*key))
    }

    /// Whether the set is empty.
    pub fn is_empty(self) -> bool {
        self == Self::NONE
    }
}

impl FromIterator<Key> for KeySet {
    fn from_iter<I: IntoIterator<Item = Key>>(keys: I) -> Self {
        let mut set = Self::NONE;
        keys.into_iter().for_each(|key| set.insert(key));
        set
    }
}

impl fmt::Debug for KeySet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_reads_back() {
        for code in 0..=255 {
            let name = Key(code).to_string();
            assert_eq!(Key::from_name(&name), Some(Key(code)), "{name}");
            assert_eq!(Key::from_name(&name.to_lowercase()), Some(Key(code)), "{name}");
            assert_eq!(Key::from_name(&format!("VK_0x{code:02x}")), Some(Key(code)));
            assert!(!name.contains(char::is_whitespace) && !name.contains('#'));
        }
    }

    #[test]
    fn names_mean_windows_virtual_keys() {
        for (name, code) in [
            ("W", 87),
            ("0", 48),
            ("SPACE", 32),
            ("TAB", 9),
            ("ENTER", 13),
            ("SHIFT", 16),
            ("CTRL", 17),
            ("LEFT", 37),
            ("UP", 38),
            ("RIGHT", 39),
            ("DOWN", 40),
            ("MOUSE_LEFT", 1),
            ("MOUSE_RIGHT", 2),
            ("MOUSE_MIDDLE", 4),
            ("F1", 112),
            ("F24", 135),
            ("NUM0", 96),
            ("NUM9", 105),
            ("escape", 27),
        ] {
            assert_eq!(Key::from_name(name), Some(Key(code)), "{name}");
        }
        for bad in ["", "F0", "F25", "F01", "F+1", "NUM10", "VK_0x1", "VK_0x100", "VK_0x+1", "É", "LEFTSHIFTLEFTSHIFT"]
        {
            assert_eq!(Key::from_name(bad), None, "{bad:?}");
        }
    }

    #[test]
    fn each_key_has_a_bit_of_its_own() {
        for code in 0..=255 {
            let mut set = KeySet::NONE;
            set.insert(Key(code));
            assert_eq!(set.iter().collect::<Vec<_>>(), [Key(code)]);
            set.remove(Key(code));
            assert!(set.is_empty());
        }
        assert_eq!((0..=255).map(Key).collect::<KeySet>(), KeySet([u64::MAX; 4]));
    }
}
