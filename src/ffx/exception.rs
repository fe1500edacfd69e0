//! Calls of foreign code that may throw C++ exceptions.

/// Makes a call; `None` if it threw a C++ exception of Microsoft's compilers. Other exceptions, such as an invalid read, are not caught.
///
/// An exception skips the destructors of Rust in `call`, which has none, being `Copy`. Only 64-bit Windows on x86 catches; elsewhere there are no
/// such libraries.
pub(crate) fn catch<T: Copy, F: Fn() -> T + Copy>(call: F) -> Option<T> {
    #[cfg(all(windows, target_arch = "x86_64"))]
    return catching::catch(call);
    #[cfg(not(all(windows, target_arch = "x86_64")))]
    Some(call())
}

#[cfg(all(windows, target_arch = "x86_64"))]
mod catching {
    use std::ffi::c_void;

    pub(super) fn catch<T: Copy, F: Fn() -> T + Copy>(call: F) -> Option<T> {
        let mut state = (call, None::<T>);
        // SAFETY: the function takes a pointer to this type, which lives during the call.
        unsafe { cairn_call_catching(run::<T, F>, (&raw mut state).cast()) };
        state.1
    }

    /// Makes the call of a state, and writes its result there.
    ///
    /// # Safety
    /// A state of this type.
    unsafe extern "C-unwind" fn run<T: Copy, F: Fn() -> T + Copy>(state: *mut c_void) {
        let state = state.cast::<(F, Option<T>)>();
        // SAFETY: the caller's promise; the call is copied, so that nothing is borrowed while it runs.
        unsafe { (*state).1 = Some(((*state).0)()) };
    }

    unsafe extern "C" {
        /// Calls `function` with `state`; returns too where it throws.
        fn cairn_call_catching(function: unsafe extern "C-unwind" fn(*mut c_void), state: *mut c_void);
    }

    /// Code of C++ exceptions (Microsoft, `ehdata.h`: `EH_EXCEPTION_NUMBER`).
    const CPP_EXCEPTION: u32 = 0xE06D_7363;

    /// `EXCEPTION_RECORD`, as far as it is read.
    #[repr(C)]
    struct ExceptionRecord {
        code: u32,
    }

    /// The filter of `__C_specific_handler`: 1 to continue in `cairn_call_catching`, 0 to look for another handler.
    ///
    /// # Safety
    /// `pointers` is an `EXCEPTION_POINTERS`, whose first field points to the record.
    unsafe extern "C" fn filter(pointers: *const *const ExceptionRecord, _frame: *const c_void) -> i32 {
        // SAFETY: the caller's promise.
        i32::from(unsafe { (**pointers).code } == CPP_EXCEPTION)
    }

    // Rust has no `__try`, so this is one in assembly: a function with the handler that Microsoft's compilers give to `__try`, and that handler's
    // table of one range, its filter and the place where it continues. A return address belongs to the range, hence the `nop` within it.
    std::arch::global_asm!(
        "    .text",
        "    .globl cairn_call_catching",
        "    .def cairn_call_catching",
        "    .scl 2",
        "    .type 32",
        "    .endef",
        "    .seh_proc cairn_call_catching",
        "cairn_call_catching:",
        "    sub rsp, 40",
        "    .seh_stackalloc 40",
        "    .seh_endprologue",
        "    mov rax, rcx",
        "    mov rcx, rdx",
        ".Lcairn_try:",
        "    call rax",
        "    nop",
        ".Lcairn_try_end:",
        "    add rsp, 40",
        "    ret",
        "    .seh_handler __C_specific_handler, @unwind, @except",
        "    .seh_handlerdata",
        "    .long 1",
        "    .rva .Lcairn_try, .Lcairn_try_end, {filter}, .Lcairn_try_end",
        "    .text",
        "    .seh_endproc",
        filter = sym filter,
    );
}
