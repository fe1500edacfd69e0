//! The constants that shaders share with the processor's code stand once, in Rust: `src/gpu/shaders/constants.hlsli` is made of them.
//!
//! A module lists its own with [`shader_constants`]. `cargo xtask shaders` writes the file before it compiles the shaders; the test here fails
//! while it differs.

use std::fmt::Write as _;

/// A constant as the shaders have it.
pub(crate) struct Constant {
    pub(crate) name: fn() -> String,
    /// Its type: `float`, or `[float]` of an array.
    pub(crate) kind: &'static str,
    /// Its number, or its numbers with commas.
    pub(crate) value: fn() -> String,
}

impl Constant {
    fn declaration(&self) -> String {
        let (name, value) = ((self.name)(), (self.value)());
        match self.kind.strip_prefix('[') {
            Some(kind) => {
                let kind = kind.trim_end_matches(']');
                format!("static const {kind} {name}[{}] = {{ {value} }};", value.split(',').count())
            }
            None => format!("static const {} {name} = {value};", self.kind),
        }
    }
}

/// The constants of a module.
#[derive(Clone, Copy)]
pub(crate) struct Constants {
    /// The file they stand in.
    pub(crate) file: &'static str,
    pub(crate) list: &'static [Constant],
}

/// The numbers of a constant: of itself, or of an array.
pub(crate) fn numbers<T: ToString>(of: &[T]) -> String {
    of.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
}

/// A name that begins with the prefix.
pub(crate) fn prefixed(prefix: &str, name: &str) -> String {
    if name.starts_with(prefix) { name.to_owned() } else { format!("{prefix}{name}") }
}

/// The constants of this module that shaders have, under names that begin with the prefix: `float NAME`, `int NAME` or `uint NAME` as a number,
/// `uint2 NAME` of an array of two, `[uint] NAME` as an array; `[uint] NAME.flattened` of an array of arrays.
macro_rules! shader_constants {
    ($prefix:literal: $($kind:tt $name:ident $(.$how:ident)?),+ $(,)?) => {
        pub(crate) const SHADER_CONSTANTS: $crate::shader_constants::Constants = $crate::shader_constants::Constants {
            file: file!(),
            list: &[$($crate::shader_constants::Constant {
                name: || $crate::shader_constants::prefixed($prefix, stringify!($name)),
                kind: stringify!($kind),
                value: || $crate::shader_constants::shader_constants!(@value $kind $name $($how)?),
            }),+],
        };
    };
    (@value float $name:ident) => { ($name as f32).to_string() };
    (@value uint2 $name:ident) => { format!("uint2({})", $crate::shader_constants::numbers(&$name)) };
    (@value [$kind:ident] $name:ident) => { $crate::shader_constants::numbers(&$name) };
    (@value [$kind:ident] $name:ident flattened) => { $crate::shader_constants::numbers($name.as_flattened()) };
    (@value $kind:ident $name:ident) => { ($name as i64).to_string() };
}
pub(crate) use shader_constants;

/// The file's text.
fn text(all: &[Constants]) -> String {
    let mut text =
        "// Constants of the processor's code, whose sources say what they mean. Written by `cargo xtask shaders`.\n\n\
                    #ifndef CAIRN_CONSTANTS\n#define CAIRN_CONSTANTS\n"
            .to_owned();
    for constants in all {
        _ = writeln!(text, "\n// {}", constants.file.replace('\\', "/"));
        for constant in constants.list {
            text.push_str(&wrapped(&constant.declaration()));
        }
    }
    text + "\n#endif\n"
}

/// A declaration on lines of at most 120 letters.
fn wrapped(line: &str) -> String {
    let mut text = String::new();
    let mut length = 0;
    for word in line.split(' ') {
        if length > 0 && length + 1 + word.len() > 120 {
            text.push_str("\n    ");
            length = 4;
        } else if length > 0 {
            text.push(' ');
            length += 1;
        }
        text.push_str(word);
        length += word.len();
    }
    text + "\n"
}

mod tests {
    use super::*;

    /// Path that the file is written to instead of being compared.
    const WRITE: &str = "CAIRN_WRITE_SHADER_CONSTANTS";

    #[test]
    fn the_shaders_have_the_constants_of_the_processors_code() {
        let made = text(&[crate::framegen::cpu::shader_constants(), crate::guidance::shader_constants()].concat());
        if let Some(path) = std::env::var_os(WRITE) {
            return std::fs::write(path, made).unwrap();
        }
        let written = include_str!("gpu/shaders/constants.hlsli").replace("\r\n", "\n");
        assert!(written == made, "src/gpu/shaders/constants.hlsli is of other constants: run `cargo xtask shaders`");
    }

    #[test]
    fn numbers_are_written_as_hlsl_has_them() {
        const SMALL: f32 = 1e-5;
        const THIRD: f32 = 0.3;
        const BYTE: u8 = 250;
        const PAIR: [usize; 2] = [20, 12];
        const TABLE: [[i16; 2]; 2] = [[1, -2], [3, 4]];
        shader_constants!("TEST_": float SMALL, float THIRD, float BYTE, int BYTE, uint2 PAIR, [int] TABLE.flattened, [uint] PAIR);
        let text = text(&[SHADER_CONSTANTS]);
        for line in [
            "static const float TEST_SMALL = 0.00001;",
            "static const float TEST_THIRD = 0.3;",
            "static const float TEST_BYTE = 250;",
            "static const int TEST_BYTE = 250;",
            "static const uint2 TEST_PAIR = uint2(20, 12);",
            "static const int TEST_TABLE[4] = { 1, -2, 3, 4 };",
            "static const uint TEST_PAIR[2] = { 20, 12 };",
        ] {
            assert!(text.contains(line), "{line} in {text}");
        }
        assert!(text.contains("// src/shader_constants.rs\n"), "{text}");
    }

    #[test]
    fn long_tables_are_wrapped() {
        let line = format!("static const int A[99] = {{ {} }};", numbers(&[1_234_567; 99]));
        let text = wrapped(&line);
        assert!(text.lines().count() > 5 && text.lines().all(|line| line.len() <= 120), "{text}");
        assert_eq!(text.split_whitespace().collect::<Vec<_>>(), line.split_whitespace().collect::<Vec<_>>());
    }
}
