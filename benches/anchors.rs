//! The cost of a world's latent steps on a Direct3D 12 device, and their effect on frames of an engine at the same time, as ratios of one
//! run:
//! `cargo xtask bench --lab`, or `cargo bench --bench anchors` on Windows.
//!
//! Without `--bench`, as under `cargo test`, it does nothing, because a world on DirectML takes gigabytes.

#[cfg(windows)]
#[path = "anchors/lines.rs"]
mod lines;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    #[cfg(windows)]
    if std::env::args().any(|argument| argument == "--bench") {
        return lines::run();
    }
    #[cfg(not(windows))]
    println!("Direct3D 12 is Windows only: cargo xtask bench --lab measures it here");
    Ok(())
}
