//! The driver as another process starts it, with the libraries in `CAIRN_FFX_DIR`: AMD's own, or the test double. On Windows, or in the lab.

#[cfg(windows)]
mod pan;

fn main() {
    #[cfg(windows)]
    test_support::trials::run(pan::trials());
}
