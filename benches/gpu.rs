//! What the library's compute shaders cost on a Direct3D 12 device, beside a shader that blends two textures of the same size:
//! `cargo xtask bench --lab`, or `cargo bench --bench gpu` on Windows.
//!
//! Time is the device's own, between two of its timestamps; every line is measured in the same run, its turns interleaved with the
//! others', and the ratio of the medians is what counts. Blending moves 12 bytes to a pixel and little else, so a line's ratio also
//! says how many bytes could have been moved in its time: that is told beside the least that anybody must move who reads both
//! pictures and what guides them once, and writes the result once. A software driver computes much more slowly than it moves.
//! Without `--bench`, as under `cargo test`, everything runs once at a tiny size and nothing is measured.

#[cfg(windows)]
#[path = "gpu/blend.rs"]
mod blend;
#[cfg(windows)]
#[path = "gpu/lines.rs"]
mod lines;
#[cfg(windows)]
#[path = "../tests/d3d12/pictures.rs"]
mod pictures;

fn main() {
    #[cfg(windows)]
    lines::run();
    #[cfg(not(windows))]
    println!("Direct3D 12 is Windows only: cargo xtask bench --lab measures it here");
}
