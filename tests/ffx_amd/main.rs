//! AMD's own libraries, in the folder that `CAIRN_FFX_DIR` names. On Windows, or in the lab.

#[cfg(windows)]
use test_support::trials;
#[cfg(windows)]
mod amd;

fn main() {
    #[cfg(windows)]
    trials::run(amd::trials());
}
