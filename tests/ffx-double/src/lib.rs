//! A fake ffx-api library (test double) that imitates the releases of AMD's SDK and checks every call strictly. Windows only.
//!
//! Tests copy it to AMD's file names. A text file beside each copy, with `.txt` appended to the name, configures it (`config`). In
//! the same folder it appends the calls to `calls.txt`, rule violations to `judgement.txt`, and the parameters it received to
//! `parameters.txt`.
//!
//! It generates and upscales frames with shaders of its own (`interpolate.hlsl`, `upscale.hlsl`), so that pixels show whether
//! motion, depth, states and all other parameters are right.
//!
//! It makes calls fail on purpose (`faults`). As a loader it does so in front of AMD's own libraries too.
//!
//! It shares no code with the bindings under test: it reads structs by offsets only, with the functions of `field_access`.
#![cfg(windows)]

mod config;
mod effect_library;
// The same file as the library's: a loader in front of AMD's own libraries catches what they throw.
#[path = "../../../src/ffx/exception.rs"]
mod exception;
mod faults;
mod field_access;
mod generation;
mod library;
mod parameter_log;
mod prepared_inputs;
mod proxy;
mod queries;
mod shader_work;
mod swapchain;
mod swapchain_config;
mod upscale;

use std::ffi::c_void;

use library::Library;

const OK: u32 = 0;
const ERROR: u32 = 1;
const UNKNOWN_STRUCT: u32 = 2;
const RUNTIME: u32 = 3;
const NO_PROVIDER: u32 = 4;
const MEMORY: u32 = 5;
const PARAMETER: u32 = 6;
/// No code of ffx-api: the call ends with a C++ exception.
const THREW: u32 = 0xE06D_7363;

/// Creates a context.
///
/// # Safety
/// As for ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C-unwind" fn ffxCreateContext(
    context: *mut *mut c_void,
    head: *mut u8,
    callbacks: *const c_void,
) -> u32 {
    // SAFETY: the caller's promise about the chain and the context's address.
    Library::called("create", |library| unsafe { library.create(context, head, callbacks) })
}

/// Destroys a context.
///
/// # Safety
/// As for ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C-unwind" fn ffxDestroyContext(context: *mut *mut c_void, callbacks: *const c_void) -> u32 {
    // SAFETY: the caller's promise about the context's address.
    Library::called("destroy", |library| unsafe { library.destroy(context, callbacks) })
}

/// Configures a context, or the library.
///
/// # Safety
/// As for ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C-unwind" fn ffxConfigure(context: *mut *mut c_void, head: *const u8) -> u32 {
    // SAFETY: the caller's promise about the chain and the context's address.
    Library::called("configure", |library| unsafe { library.configure(context, head) })
}

/// Queries a context, or the library.
///
/// # Safety
/// As for ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C-unwind" fn ffxQuery(context: *mut *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: the caller's promise about the chain and the context's address.
    Library::called("query", |library| unsafe { library.query(context, head) })
}

/// Records work.
///
/// # Safety
/// As for ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C-unwind" fn ffxDispatch(context: *mut *mut c_void, head: *const u8) -> u32 {
    // SAFETY: the caller's promise about the chain and the context's address.
    Library::called("dispatch", |library| unsafe { library.dispatch(context, head) })
}
