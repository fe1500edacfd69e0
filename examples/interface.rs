//! Prints the constants and struct layouts of the C interface as Rust has them: the first part of `abi.txt`.

fn main() {
    print!("{}", cairn::abi::record::layout());
}
