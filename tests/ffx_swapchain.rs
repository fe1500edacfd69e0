//! AMD's swap chain in a window: of the double, which records its presents, and of AMD's own libraries if `CAIRN_FFX_DIR` names
//! them. On Windows, or in the lab.

#[cfg(windows)]
#[path = "support/trials.rs"]
#[macro_use]
mod trials;
#[cfg(windows)]
#[path = "ffx/swapchain.rs"]
mod swapchain;

fn main() {
    #[cfg(windows)]
    trials::run(swapchain::trials());
}
