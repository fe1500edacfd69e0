//! Library files on Windows: their versions, how they are loaded, and why one is not.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::os::windows::ffi::OsStrExt;
use std::path::Path;

use windows::Win32::Foundation::{
    ERROR_ACCESS_DENIED, ERROR_BAD_EXE_FORMAT, ERROR_DLL_INIT_FAILED, ERROR_MOD_NOT_FOUND, ERROR_PROC_NOT_FOUND,
    HMODULE,
};
use windows::Win32::Storage::FileSystem::{
    GetFileVersionInfoSizeW, GetFileVersionInfoW, VS_FIXEDFILEINFO, VerQueryValueW,
};
use windows::Win32::System::LibraryLoader::{
    LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR, LOAD_LIBRARY_SEARCH_SYSTEM32, LoadLibraryExW,
};
use windows::core::{HRESULT, PCWSTR, w};

/// A NUL-terminated UTF-16 path or name.
pub(crate) fn wide(text: impl AsRef<std::ffi::OsStr>) -> Vec<u16> {
    text.as_ref().encode_wide().chain([0]).collect()
}

/// The version in a file's version resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FileVersion(pub [u16; 4]);

impl fmt::Display for FileVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d] = self.0;
        write!(f, "{a}.{b}.{c}.{d}")
    }
}

impl FileVersion {
    /// Reads it from a file's version resource; None if there is none.
    pub fn read(path: &Path) -> Option<Self> {
        let name = wide(path);
        let name = PCWSTR(name.as_ptr());
        // SAFETY: a NUL-terminated path.
        let size = unsafe { GetFileVersionInfoSizeW(name, None) };
        let mut data = vec![0_u8; size as usize];
        if data.is_empty() {
            return None;
        }
        // SAFETY: memory of the stated size.
        unsafe { GetFileVersionInfoW(name, None, size, data.as_mut_ptr().cast()) }.ok()?;
        let (mut found, mut length) = (std::ptr::null_mut(), 0);
        // SAFETY: the data filled above, and memory for a pointer into it and a length.
        let known = unsafe { VerQueryValueW(data.as_ptr().cast(), w!("\\"), &mut found, &mut length) };
        if !known.as_bool() || found.is_null() || (length as usize) < size_of::<VS_FIXEDFILEINFO>() {
            return None;
        }
        // SAFETY: the system states that at least so many bytes of this struct are there.
        let info = unsafe { found.cast::<VS_FIXEDFILEINFO>().read_unaligned() };
        let halves = |word: u32| [(word >> 16) as u16, (word & 0xffff) as u16];
        let ([a, b], [c, d]) = (halves(info.dwFileVersionMS), halves(info.dwFileVersionLS));
        Some(Self([a, b, c, d]))
    }
}

/// The processor type in a library's PE header, as text, if it is not x64.
fn other_machine(path: &Path) -> Option<String> {
    let mut start = Vec::new();
    File::open(path).ok()?.take(1 << 16).read_to_end(&mut start).ok()?;
    let half = |at: usize| Some(u16::from_le_bytes(*start.get(at..)?.first_chunk()?));
    // The offset of the PE header is a 32-bit number at 0x3c; its upper half is 0 in real libraries.
    let header = usize::from(half(0x3c)?);
    if start.get(header..header + 4)? != b"PE\0\0" {
        return None;
    }
    match half(header + 4)? {
        0x8664 => None,
        0x014c => Some("32-bit x86".to_owned()),
        0xaa64 => Some("64-bit ARM".to_owned()),
        0x01c4 => Some("32-bit ARM".to_owned()),
        other => Some(format!("processors of type {other:#06x}")),
    }
}

/// Loads a library. Its dependencies are searched beside it and in the system directory, and neither beside the program, in the working directory nor
/// along the PATH.
///
/// # Safety
/// Runs the library's initialisers: the caller trusts the file.
pub(crate) unsafe fn load(path: &Path) -> windows::core::Result<HMODULE> {
    let name = wide(path);
    let search = LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR | LOAD_LIBRARY_SEARCH_SYSTEM32;
    // SAFETY: a NUL-terminated path; the caller trusts the file.
    unsafe { LoadLibraryExW(PCWSTR(name.as_ptr()), None, search) }
}

/// Why Windows does not load a library, by the error's code, and what to do. `another_file` is the advice for a file that is wrong itself.
pub(crate) fn load_refusal(path: &Path, code: HRESULT, another_file: &'static str) -> (String, &'static str) {
    /// ERROR_SYSTEM_INTEGRITY_POLICY_VIOLATION, also that of Smart App Control: an unsigned file is refused.
    const BY_POLICY: u32 = 4551;

    if let Some(machine) = other_machine(path) {
        return (format!("it is made for {machine}, and this process is of 64-bit x86"), another_file);
    }
    let old = "Bring Windows and the Visual C++ 2015-2022 redistributable for x64 up to date";
    let known = [
        (
            ERROR_MOD_NOT_FOUND,
            "something that it needs is missing",
            "Install Microsoft's Visual C++ 2015-2022 redistributable for x64",
        ),
        (ERROR_BAD_EXE_FORMAT, "it is no library for 64-bit Windows, or damaged", another_file),
        (ERROR_PROC_NOT_FOUND, "something that it needs is too old", old),
        (ERROR_DLL_INIT_FAILED, "it does not start", old),
        (ERROR_ACCESS_DENIED, "access to it is denied", "Check the file's permissions and the virus scanner's log"),
    ];
    if let Some((_, why, remedy)) = known.into_iter().find(|(error, ..)| error.to_hresult() == code) {
        return (format!("{why} ({:#010x})", code.0), remedy);
    }
    if code == HRESULT::from_win32(BY_POLICY) {
        let remedy = "Windows lets no unsigned library of this name run here: ask whoever set the policy, or turn Smart App Control off";
        return (format!("a policy of this Windows blocks it ({:#010x})", code.0), remedy);
    }
    (format!("the system refuses it ({:#010x})", code.0), another_file)
}
