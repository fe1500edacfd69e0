//! The cost of the library's compute shaders on a Direct3D 12 device, relative to a shader that blends two textures of the same size:
//! `cargo xtask bench --lab`, or `cargo bench --bench gpu` on Windows.
//!
//! Times are differences of device timestamps. All lines are measured in the same run, in interleaved turns, and the result is the ratio
//! of the medians. Blending moves 12 bytes per pixel and computes little, so a line's ratio also gives the bytes that
//! could have been moved in its time. It is printed beside the lower bound: reading both pictures and the guidance once, and writing the
//! result once. A software driver computes much more slowly than it moves memory.
//! Without `--bench`, as under `cargo test`, everything runs once at a tiny size and nothing is measured.

#[cfg(windows)]
#[path = "gpu/lines.rs"]
mod lines;

fn main() {
    #[cfg(windows)]
    lines::run();
    #[cfg(not(windows))]
    println!("Direct3D 12 is Windows only: cargo xtask bench --lab measures it here");
}
