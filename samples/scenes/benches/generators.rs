//! How near frames half way between two anchors come to the true ones, by each generator on the same pictures, as a presenter shows
//! them: `cargo xtask bench --lab`, or `cargo bench --package scenes --bench generators` on Windows.
//!
//! Anchors are 1/15 s apart, and the truth is drawn at the moment half way. Motion and depth are the scene's own, as an engine has
//! them, or found in the pictures. AMD's libraries are those in `CAIRN_FFX_DIR`; without them their row is left out.
//!
//! `--size WIDTHxHEIGHT` (640x360), `--pairs COUNT` of each scene (8). Without `--bench`, as under `cargo test`, one small pair is made
//! and nothing is said of it.

#[cfg(windows)]
#[path = "generators/table.rs"]
mod table;

fn main() {
    #[cfg(windows)]
    if let Err(why) = table::run() {
        eprintln!("error: {why}");
        std::process::exit(1);
    }
    #[cfg(not(windows))]
    println!("Direct3D 12 is Windows only: cargo xtask bench --lab makes the table here");
}
