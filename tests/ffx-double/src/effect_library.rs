//! The library of an effect, to which the double of AMD's loader forwards calls.

use std::ffi::c_void;

use windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryA};
use windows::core::{PCSTR, s};

use crate::THREW;
use crate::exception::catch;

/// An exported function of unknown type.
type Export = unsafe extern "system" fn() -> isize;
type Create = unsafe extern "C-unwind" fn(*mut *mut c_void, *mut u8, *const c_void) -> u32;
type Destroy = unsafe extern "C-unwind" fn(*mut *mut c_void, *const c_void) -> u32;
type Query = unsafe extern "C-unwind" fn(*mut *mut c_void, *mut u8) -> u32;
/// `ffxConfigure` and `ffxDispatch`.
type ConstCall = unsafe extern "C-unwind" fn(*mut *mut c_void, *const u8) -> u32;

/// The functions of an effect's library.
#[derive(Clone, Copy)]
pub(crate) struct EffectLibrary {
    create: Create,
    destroy: Destroy,
    configure: ConstCall,
    query: Query,
    dispatch: ConstCall,
}

impl EffectLibrary {
    /// Loads the library of an effect by its bare name, as AMD's loader does.
    pub(crate) fn load(effect: u64) -> Option<Self> {
        let name = match effect {
            0x1_0000 => s!("amd_fidelityfx_upscaler_dx12.dll"),
            _ => s!("amd_fidelityfx_framegeneration_dx12.dll"),
        };
        // SAFETY: a static name; a copy of this library, or one that a test put there.
        let module = unsafe { LoadLibraryA(name) }.ok()?;
        let find = |name: PCSTR| {
            // SAFETY: a loaded module and a static name.
            unsafe { GetProcAddress(module, name) }
        };
        // SAFETY: ffx-api's functions by their names.
        Some(unsafe {
            Self {
                create: std::mem::transmute::<Export, Create>(find(s!("ffxCreateContext"))?),
                destroy: std::mem::transmute::<Export, Destroy>(find(s!("ffxDestroyContext"))?),
                configure: std::mem::transmute::<Export, ConstCall>(find(s!("ffxConfigure"))?),
                query: std::mem::transmute::<Export, Query>(find(s!("ffxQuery"))?),
                dispatch: std::mem::transmute::<Export, ConstCall>(find(s!("ffxDispatch"))?),
            }
        })
    }
    /// `ffxCreateContext`; [`THREW`] if it throws a C++ exception.
    ///
    /// # Safety
    /// As for ffx-api's function.
    pub(crate) unsafe fn create(&self, context: *mut *mut c_void, head: *mut u8, callbacks: *const c_void) -> u32 {
        // SAFETY: the caller's promise.
        catch(|| unsafe { (self.create)(context, head, callbacks) }).unwrap_or(THREW)
    }

    /// `ffxDestroyContext`; [`THREW`] if it throws a C++ exception.
    ///
    /// # Safety
    /// As for ffx-api's function.
    pub(crate) unsafe fn destroy(&self, context: *mut *mut c_void, callbacks: *const c_void) -> u32 {
        // SAFETY: the caller's promise.
        catch(|| unsafe { (self.destroy)(context, callbacks) }).unwrap_or(THREW)
    }

    /// `ffxConfigure`; [`THREW`] if it throws a C++ exception.
    ///
    /// # Safety
    /// As for ffx-api's function.
    pub(crate) unsafe fn configure(&self, context: *mut *mut c_void, head: *const u8) -> u32 {
        // SAFETY: the caller's promise.
        catch(|| unsafe { (self.configure)(context, head) }).unwrap_or(THREW)
    }

    /// `ffxQuery`; [`THREW`] if it throws a C++ exception.
    ///
    /// # Safety
    /// As for ffx-api's function.
    pub(crate) unsafe fn query(&self, context: *mut *mut c_void, head: *mut u8) -> u32 {
        // SAFETY: the caller's promise.
        catch(|| unsafe { (self.query)(context, head) }).unwrap_or(THREW)
    }

    /// `ffxDispatch`; [`THREW`] if it throws a C++ exception.
    ///
    /// # Safety
    /// As for ffx-api's function.
    pub(crate) unsafe fn dispatch(&self, context: *mut *mut c_void, head: *const u8) -> u32 {
        // SAFETY: the caller's promise.
        catch(|| unsafe { (self.dispatch)(context, head) }).unwrap_or(THREW)
    }
}
