//! AMD's own libraries, in the folder that `CAIRN_FFX_DIR` names. On Windows, or in the lab.

#[cfg(windows)]
#[path = "support/trials.rs"]
#[macro_use]
mod trials;
#[cfg(windows)]
#[path = "ffx/amd.rs"]
mod amd;

fn main() {
    #[cfg(windows)]
    trials::run(amd::trials());
}
