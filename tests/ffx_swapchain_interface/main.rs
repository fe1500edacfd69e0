//! AMD's swap chain through the C interface: of the double, and of AMD's own libraries if `CAIRN_FFX_DIR` names them. On Windows,
//! or in the lab.

#[cfg(windows)]
use test_support::trials;
#[cfg(windows)]
mod swapchain_interface;

fn main() {
    #[cfg(windows)]
    trials::run(swapchain_interface::trials());
}
