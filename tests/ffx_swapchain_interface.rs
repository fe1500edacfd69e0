//! A swap chain of AMD's as a host in C has it: of the double, and of AMD's own libraries where `CAIRN_FFX_DIR` names them. On Windows,
//! or in the lab.

#[cfg(windows)]
#[path = "support/trials.rs"]
#[macro_use]
mod trials;
#[cfg(windows)]
#[path = "ffx/swapchain_interface.rs"]
mod swapchain_interface;

fn main() {
    #[cfg(windows)]
    trials::run(swapchain_interface::trials());
}
