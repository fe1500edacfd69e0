//! A library with ffx-api's five exports that plays the releases of AMD's SDK, and a strict judge of who calls it. Windows only.
//!
//! A copy of it stands under each name of AMD's, and beside it a text with that name and `.txt` behind it says what it plays
//! (`role`). What it was asked is appended to `calls.txt` in the same folder, and what was wrong with it to
//! `judgement.txt`; the numbers that it was told to `told.txt`.
//!
//! It generates frames and larger ones with shaders of its own (`interpolate.hlsl`, `upscale.hlsl`), so that pixels show whether what it was told of motion, depth,
//! states and all else is right.
//!
//! It shares nothing with the bindings under test: what it knows of structs are offsets, in `memory` and where they are read.
#![cfg(windows)]

mod frames;
mod judge;
mod memory;
mod proxy;
mod queries;
mod role;
mod settings;
mod swapchain;
mod told;
mod upscale;
mod work;

use std::ffi::c_void;

use judge::Judge;

const OK: u32 = 0;
const UNKNOWN_STRUCT: u32 = 2;
const RUNTIME: u32 = 3;
const NO_PROVIDER: u32 = 4;
const PARAMETER: u32 = 6;

/// Makes a context.
///
/// # Safety
/// As of ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ffxCreateContext(context: *mut *mut c_void, head: *mut u8, callbacks: *const c_void) -> u32 {
    // SAFETY: the caller's promise about the chain and the place.
    Judge::hears("create", |judge| unsafe { judge.create(context, head, callbacks) })
}

/// Ends a context.
///
/// # Safety
/// As of ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ffxDestroyContext(context: *mut *mut c_void, callbacks: *const c_void) -> u32 {
    // SAFETY: the caller's promise about the place.
    Judge::hears("destroy", |judge| unsafe { judge.destroy(context, callbacks) })
}

/// Sets something.
///
/// # Safety
/// As of ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ffxConfigure(context: *mut *mut c_void, head: *const u8) -> u32 {
    // SAFETY: the caller's promise about the chain and the place.
    Judge::hears("configure", |judge| unsafe { judge.configure(context, head) })
}

/// Asks something.
///
/// # Safety
/// As of ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ffxQuery(context: *mut *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: the caller's promise about the chain and the place.
    Judge::hears("query", |judge| unsafe { judge.query(context, head) })
}

/// Records work.
///
/// # Safety
/// As of ffx-api's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ffxDispatch(context: *mut *mut c_void, head: *const u8) -> u32 {
    // SAFETY: the caller's promise about the chain and the place.
    Judge::hears("dispatch", |judge| unsafe { judge.dispatch(context, head) })
}
