//! AMD's swap chain in a window: of the double, which records its presents, and of AMD's own libraries if `CAIRN_FFX_DIR` names
//! them. On Windows, or in the lab.

#[cfg(windows)]
use test_support::trials;
#[cfg(windows)]
mod swapchain;

fn main() {
    #[cfg(windows)]
    trials::run(swapchain::trials());
}
