//! Version of the operating system.

use std::ffi::{CStr, c_char};

use windows::Win32::System::LibraryLoader::{GetModuleHandleW, GetProcAddress};
use windows::core::{s, w};

/// Version of Windows, or of Wine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct System {
    /// Major, minor and build number; `None` if the system does not report them.
    pub build: Option<[u32; 3]>,
    /// Wine's version, if Wine provides the system.
    pub wine: Option<String>,
}

impl System {
    /// The system of this process.
    pub fn current() -> Self {
        Self { build: build(), wine: wine() }
    }
}

/// Uses `RtlGetVersion`, since `GetVersionEx` depends on the program's manifest.
fn build() -> Option<[u32; 3]> {
    /// `OSVERSIONINFOW`.
    #[repr(C)]
    struct Version {
        size: u32,
        numbers: [u32; 3],
        platform: u32,
        text: [u16; 128],
    }
    #[link(name = "ntdll")]
    unsafe extern "system" {
        fn RtlGetVersion(version: *mut Version) -> i32;
    }
    let size = size_of::<Version>() as u32;
    let mut version = Version { size, numbers: [0; 3], platform: 0, text: [0; 128] };
    // SAFETY: a struct that says its size.
    (unsafe { RtlGetVersion(&mut version) } == 0).then_some(version.numbers)
}

fn wine() -> Option<String> {
    // SAFETY: a static name; the library is a part of every process.
    let system = unsafe { GetModuleHandleW(w!("ntdll.dll")) }.ok()?;
    // SAFETY: a loaded library and a static name.
    let found = unsafe { GetProcAddress(system, s!("wine_get_version")) }?;
    // SAFETY: Wine's own function, of this type, which gives static text.
    let text = unsafe {
        let version =
            std::mem::transmute::<unsafe extern "system" fn() -> isize, unsafe extern "C" fn() -> *const c_char>(found);
        CStr::from_ptr(version())
    };
    Some(text.to_string_lossy().into_owned())
}
