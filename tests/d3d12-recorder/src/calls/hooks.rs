//! Functions in the tables of Direct3D's objects, and the hooks that replace them.

use std::cell::Cell;
use std::ffi::c_void;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::OnceLock;

use windows::Win32::System::Memory::{PAGE_PROTECTION_FLAGS, PAGE_READWRITE, VirtualProtect};
use windows::core::IUnknown_Vtbl;

use super::{is_reporting, report};

#[link(name = "ntdll")]
unsafe extern "system" {
    fn RtlCaptureStackBackTrace(skip: u32, count: u32, addresses: *mut *mut c_void, hash: *mut u32) -> u16;
}

/// Code address that called the hook which calls this. Inlining may skip frames, so that addresses of this library are passed over.
#[inline(never)]
pub(super) fn caller() -> usize {
    let mut addresses = [std::ptr::null_mut(); 6];
    // SAFETY: an array of that length.
    let count =
        unsafe { RtlCaptureStackBackTrace(1, addresses.len() as u32, addresses.as_mut_ptr(), std::ptr::null_mut()) };
    let own = own_range();
    let other =
        addresses[..count as usize].iter().map(|address| *address as usize).find(|address| !own.contains(address));
    other.unwrap_or_default()
}

/// A number for the place of this call in the program: the functions that led to it.
pub(super) fn call_site() -> u64 {
    let mut addresses = [std::ptr::null_mut(); 16];
    let mut hash = DefaultHasher::new();
    // SAFETY: an array of that length.
    let count =
        unsafe { RtlCaptureStackBackTrace(0, addresses.len() as u32, addresses.as_mut_ptr(), std::ptr::null_mut()) };
    addresses[..count as usize].hash(&mut hash);
    hash.finish()
}

/// Addresses of this library.
fn own_range() -> std::ops::Range<usize> {
    unsafe extern "C" {
        /// Start of the module, by the linker.
        static __ImageBase: u8;
    }
    let start = &raw const __ImageBase as usize;
    // SAFETY: the module's own headers: the new header's offset at 0x3c, and the image's size at 0x50 in it.
    let size = unsafe {
        let header = (start + 0x3c) as *const u32;
        ((start + header.read_unaligned() as usize + 0x50) as *const u32).read_unaligned()
    };
    start..start + size as usize
}

thread_local! {
    static IS_INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// While it lives, this thread is in a hook: calls that Direct3D makes to itself are not the program's.
pub(super) struct HookGuard(());

impl HookGuard {
    /// `None` if the thread is in a hook already.
    pub(super) fn enter() -> Option<Self> {
        (!IS_INSIDE.replace(true)).then(|| Self(()))
    }
}

impl Drop for HookGuard {
    fn drop(&mut self) {
        IS_INSIDE.set(false);
    }
}

/// Replaces a function in a live table, once. `original` has the old value first, since other threads may call the hook at once.
///
/// # Safety
/// `place` is an entry of a live table of functions with the type `F`.
pub(super) unsafe fn replace<F: Copy>(place: *const F, original: &OnceLock<F>, hook: F) {
    if original.get().is_some() {
        return;
    }
    let mut before = PAGE_PROTECTION_FLAGS::default();
    // SAFETY: the caller's promise; volatile, since the compiler takes the table for constant; variables that live during the calls.
    unsafe {
        original.get_or_init(|| place.read_volatile());
        VirtualProtect(place.cast(), size_of::<F>(), PAGE_READWRITE, &mut before).expect("a table can be written");
        place.cast_mut().write_volatile(hook);
        VirtualProtect(place.cast(), size_of::<F>(), before, &mut before).expect("its protection is as before");
    }
}

/// Declares hooks of one table, and `install`, which puts them into it. `original` is the replaced function, which a hook has to call. Calls
/// that Direct3D makes from inside of a hooked function go to the original directly, and calls that fail on purpose do not reach the hook.
macro_rules! hooks {
    ($table:ident; $(fn $name:ident[$original:ident]($this:ident $(, $argument:ident: $kind:ty)* $(,)?) $(-> $result:ty)? $body:block)*) => {
        #[allow(non_upper_case_globals, reason = "Direct3D's names")]
        mod originals {
            use super::*;
            $(pub(super) static $name: std::sync::OnceLock<unsafe extern "system" fn(*mut c_void $(, $kind)*) $(-> $result)?> =
                std::sync::OnceLock::new();)*
        }
        #[allow(non_snake_case, reason = "Direct3D's names")]
        mod hooked {
            use super::*;
            $(pub(super) unsafe extern "system" fn $name($this: *mut c_void $(, $argument: $kind)*) $(-> $result)? {
                let $original = *originals::$name.get().expect("the original function");
                match $crate::calls::hooks::HookGuard::enter() {
                    Some(_guard) => {
                        if let Some(failure) = $crate::calls::faults::ReturnValue::injected(stringify!($name)) {
                            return failure;
                        }
                        $body
                    }
                    // SAFETY: the caller's own arguments, passed on.
                    None => unsafe { $original($this $(, $argument)*) },
                }
            })*
        }
        /// Puts the hooks into a table, once.
        ///
        /// # Safety
        /// The table is live, and the same for all objects of its kind.
        pub(in crate::calls) unsafe fn install(table: *const $table) {
            // SAFETY: the caller's promise.
            unsafe { $($crate::calls::hooks::replace(&raw const (*table).$name, &originals::$name, hooked::$name);)* }
        }
    };
}
pub(super) use hooks;

/// Declares a hook of `IUnknown::Release` for each kind of object.
macro_rules! releases {
    ($($kind:ident)*) => {$(
        /// Hook of the last release of objects of a kind.
        pub(super) mod $kind {
            use super::*;

            static ORIGINAL: OnceLock<unsafe extern "system" fn(*mut c_void) -> u32> = OnceLock::new();

            unsafe extern "system" fn hook(this: *mut c_void) -> u32 {
                let original = ORIGINAL.get().expect("the original function");
                if is_reporting() {
                    // SAFETY: the caller's own argument, passed on.
                    return unsafe { original(this) };
                }
                // Before the release: afterwards the address may be another object's.
                let id = report(0, |calls| calls.id(this));
                // SAFETY: the caller's own argument, passed on.
                let count = unsafe { original(this) };
                if let (0, Some(id)) = (count, id) {
                    report(caller(), |calls| calls.released(this as usize, id));
                }
                count
            }

            /// Puts the hook into the table of a live object, once.
            ///
            /// # Safety
            /// The object is live.
            pub(in crate::calls) unsafe fn install(object: *mut c_void) {
                // SAFETY: an object starts with the address of its table, and that with the functions of `IUnknown`.
                unsafe { replace(&raw const (**object.cast::<*const IUnknown_Vtbl>()).Release, &ORIGINAL, hook) };
            }
        }
    )*};
}

releases! { device queue allocator list fence resource heap descriptor_heap query_heap root_signature pipeline }
