//! Loaded libraries of this process and their versions. Windows only.

use std::path::{Path, PathBuf};

use windows::Win32::System::LibraryLoader::GetModuleHandleW;
use windows::core::{PCWSTR, w};

use crate::libraries::{FileVersion, module_file};

/// The file of the first library of this name in the process, whoever loaded it.
pub(super) fn loaded(name: PCWSTR) -> Option<PathBuf> {
    // SAFETY: a NUL-terminated name, by the type's promise; no reference is taken.
    module_file(unsafe { GetModuleHandleW(name) }.ok()?)
}

/// File names of the libraries that determine a graphics device's results, in addition to the driver.
const RESULT_LIBRARIES: [PCWSTR; 9] = [
    w!("onnxruntime.dll"),
    w!("DirectML.dll"),
    w!("d3d12.dll"),
    w!("D3D12Core.dll"),
    w!("dxgi.dll"),
    w!("amd_fidelityfx_loader_dx12.dll"),
    w!("amd_fidelityfx_framegeneration_dx12.dll"),
    w!("amd_fidelityfx_upscaler_dx12.dll"),
    w!("amd_fidelityfx_dx12.dll"),
];

/// A library of this process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoadedLibrary {
    /// Its file.
    pub path: PathBuf,
    /// The version in its file's version resource, e.g. `1.15.4.0`.
    pub version: Option<String>,
}

/// The loaded libraries that determine a graphics device's results: those of ONNX Runtime, DirectML, Direct3D and AMD's ffx-api.
/// For manifests. Libraries that are not loaded yet are missing. Windows only.
pub fn loaded_libraries() -> Vec<LoadedLibrary> {
    RESULT_LIBRARIES
        .into_iter()
        .filter_map(loaded)
        .map(|path| LoadedLibrary { version: FileVersion::read(&path).map(|version| version.to_string()), path })
        .collect()
}

/// A library's path and file version, as text for messages.
pub(super) fn described(path: &Path) -> String {
    match FileVersion::read(path) {
        Some(version) => format!("{} (version {version})", path.display()),
        None => format!("{} (of no version)", path.display()),
    }
}
