//! A Windows program that compiles shaders: `compile LIBRARY [SOURCE BLOB]...`, where LIBRARY is d3dcompiler_47.dll. Each source
//! has an entry `main` of profile cs_5_0 and finds what it includes beside itself. The compiler's messages go to standard error;
//! a warning is an error.

use std::ffi::{CStr, CString, OsStr, c_char, c_void};
use std::os::windows::ffi::OsStrExt;
use std::path::Path;
use std::process::ExitCode;

#[link(name = "kernel32")]
unsafe extern "system" {
    fn LoadLibraryW(name: *const u16) -> *mut c_void;
    fn GetProcAddress(library: *mut c_void, name: *const c_char) -> *mut c_void;
}

/// `ID3DBlob` with the functions that are called here.
#[repr(C)]
struct Blob {
    calls: *const BlobCalls,
}

#[repr(C)]
struct BlobCalls {
    query: *const c_void,
    add: *const c_void,
    release: unsafe extern "system" fn(*mut Blob) -> u32,
    address: unsafe extern "system" fn(*mut Blob) -> *const u8,
    size: unsafe extern "system" fn(*mut Blob) -> usize,
}

type Compile = unsafe extern "system" fn(
    source: *const u8,
    size: usize,
    name: *const c_char,
    defines: *const c_void,
    include: *const c_void,
    entry: *const c_char,
    profile: *const c_char,
    flags: u32,
    effect_flags: u32,
    code: *mut *mut Blob,
    messages: *mut *mut Blob,
) -> i32;

type Strip = unsafe extern "system" fn(code: *const u8, size: usize, flags: u32, stripped: *mut *mut Blob) -> i32;

/// IEEE strictness, so that checks for NaN are not optimised away; the highest level of optimisation; warnings are errors.
const FLAGS: u32 = 1 << 13 | 1 << 15 | 1 << 18;
/// Reflection, debug and test data, which are removed.
const STRIPPED: u32 = 1 | 2 | 4;
/// `D3D_COMPILE_STANDARD_FILE_INCLUDE`.
const INCLUDE_BESIDE: *const c_void = 1 as *const c_void;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let library = arguments.next().expect("the library");
    let library = std::path::absolute(library).expect("a path");
    let wide: Vec<u16> = library.as_os_str().encode_wide().chain([0]).collect();
    let handle = unsafe { LoadLibraryW(wide.as_ptr()) };
    assert!(!handle.is_null(), "{} cannot be loaded", library.display());
    let call = |name: &CStr| {
        let address = unsafe { GetProcAddress(handle, name.as_ptr()) };
        assert!(!address.is_null(), "it has no {name:?}");
        address
    };
    let compile: Compile = unsafe { std::mem::transmute(call(c"D3DCompile")) };
    let strip: Strip = unsafe { std::mem::transmute(call(c"D3DStripShader")) };
    let mut status = ExitCode::SUCCESS;
    while let (Some(source), Some(blob)) = (arguments.next(), arguments.next()) {
        match compiled(compile, strip, &source) {
            Ok(code) => std::fs::write(blob, code).expect("the blob is written"),
            Err(messages) => {
                eprintln!("{}", messages.trim_end());
                status = ExitCode::FAILURE;
            }
        }
    }
    status
}

fn compiled(compile: Compile, strip: Strip, source: &OsStr) -> Result<Vec<u8>, String> {
    let path = std::path::absolute(Path::new(source)).expect("a path");
    let text = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let name = CString::new(path.to_string_lossy().into_owned()).expect("a path");
    let (mut code, mut messages) = (std::ptr::null_mut(), std::ptr::null_mut());
    let result = unsafe {
        compile(
            text.as_ptr(),
            text.len(),
            name.as_ptr(),
            std::ptr::null(),
            INCLUDE_BESIDE,
            c"main".as_ptr(),
            c"cs_5_0".as_ptr(),
            FLAGS,
            0,
            &mut code,
            &mut messages,
        )
    };
    let messages = bytes(messages);
    let code = bytes(code);
    if result < 0 || code.is_empty() {
        return Err(format!("{}: {result:#x}\n{}", path.display(), String::from_utf8_lossy(&messages)));
    }
    let mut stripped = std::ptr::null_mut();
    let result = unsafe { strip(code.as_ptr(), code.len(), STRIPPED, &mut stripped) };
    if result < 0 { Err(format!("{}: stripping it: {result:#x}", path.display())) } else { Ok(bytes(stripped)) }
}

/// The bytes of a blob, which is released. Empty for null.
fn bytes(blob: *mut Blob) -> Vec<u8> {
    if blob.is_null() {
        return Vec::new();
    }
    unsafe {
        let calls = &*(*blob).calls;
        let held = std::slice::from_raw_parts((calls.address)(blob), (calls.size)(blob)).to_vec();
        (calls.release)(blob);
        held
    }
}
