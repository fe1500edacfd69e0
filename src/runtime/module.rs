//! Loaded libraries of this process and their versions. Windows only.

use std::ffi::c_void;
use std::fmt;
use std::os::windows::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use windows::Win32::System::LibraryLoader::{GetModuleFileNameW, GetModuleHandleW};
use windows::core::{BOOL, PCWSTR, w};

/// A loaded library of this process.
pub(super) struct LoadedModule {
    pub(super) path: PathBuf,
}

/// The first library of this name in the process, whoever loaded it.
pub(super) fn loaded(name: PCWSTR) -> Option<LoadedModule> {
    // SAFETY: a NUL-terminated name, by the type's promise; no reference is taken.
    let handle = unsafe { GetModuleHandleW(name) }.ok()?;
    let mut wide = vec![0; 1 << 15];
    // SAFETY: a loaded module and a buffer with its length.
    let length = unsafe { GetModuleFileNameW(Some(handle), &mut wide) } as usize;
    Some(LoadedModule { path: String::from_utf16_lossy(&wide[..length]).into() })
}

// The `windows` crate has these only in a feature that also adds the whole file system API.
windows::core::link!("version.dll" "system" fn GetFileVersionInfoSizeW(file: PCWSTR, handle: *mut u32) -> u32);
windows::core::link!("version.dll" "system" fn GetFileVersionInfoW(file: PCWSTR, handle: u32, size: u32, block: *mut c_void) -> BOOL);
windows::core::link!("version.dll" "system" fn VerQueryValueW(block: *const c_void, name: PCWSTR, found: *mut *const c_void, length: *mut u32) -> BOOL);

/// The start of VS_FIXEDFILEINFO: signature, version of this struct, and the file's own version, most significant half first.
type FileInfoStart = [u32; 4];

/// A file's version, most significant part first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct LibraryVersion(pub(super) [u16; 4]);

impl fmt::Display for LibraryVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d] = self.0;
        write!(f, "{a}.{b}.{c}.{d}")
    }
}

impl LibraryVersion {
    /// The version in a library file's version resource; `None` without one.
    pub(super) fn of(path: &Path) -> Option<Self> {
        let name: Vec<u16> = path.as_os_str().encode_wide().chain([0]).collect();
        let name = PCWSTR(name.as_ptr());
        // SAFETY: a NUL-terminated path that lives during the call.
        let size = unsafe { GetFileVersionInfoSizeW(name, std::ptr::null_mut()) };
        let mut block = vec![0u8; size as usize];
        // SAFETY: as above, and a buffer of the size from the call above.
        unsafe { GetFileVersionInfoW(name, 0, size, block.as_mut_ptr().cast()) }.ok().ok()?;
        let (mut found, mut length) = (std::ptr::null(), 0);
        // SAFETY: a block that the call above filled, a static name, and pointers that are valid during the call.
        let has_version = unsafe { VerQueryValueW(block.as_ptr().cast(), w!("\\"), &mut found, &mut length) };
        if !has_version.as_bool() || found.is_null() || (length as usize) < size_of::<FileInfoStart>() {
            return None;
        }
        // SAFETY: inside the block and long enough, as checked; it may be unaligned.
        let [_, _, high, low] = unsafe { found.cast::<FileInfoStart>().read_unaligned() };
        let halves = |word: u32| [(word >> 16) as u16, word as u16];
        let ([a, b], [c, d]) = (halves(high), halves(low));
        Some(Self([a, b, c, d]))
    }
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
        .map(|module| LoadedLibrary {
            version: LibraryVersion::of(&module.path).map(|version| version.to_string()),
            path: module.path,
        })
        .collect()
}

/// A library's path and file version, as text for messages.
pub(super) fn described(path: &Path) -> String {
    match LibraryVersion::of(path) {
        Some(version) => format!("{} (version {version})", path.display()),
        None => format!("{} (of no version)", path.display()),
    }
}
