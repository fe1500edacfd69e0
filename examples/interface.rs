//! Prints constants and structs of the C interface as Rust has them: the first part of `abi.txt`.

fn main() {
    print!("{}", cairn::abi::record::layout());
}
