//! Memory of this process.

/// Memory of this process, or its growth, in bytes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Memory {
    /// Private memory: without mapped files, whose resident part depends on the machine's other programs.
    pub private: i64,
    /// All resident memory.
    pub resident: i64,
}

/// Memory of this process.
pub fn memory() -> Memory {
    #[repr(C)]
    #[derive(Default)]
    struct Counters {
        size: u32,
        page_faults: u32,
        peak_working_set: usize,
        working_set: usize,
        pools: [usize; 4],
        page_file: usize,
        peak_page_file: usize,
    }
    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GetCurrentProcess() -> *mut std::ffi::c_void;
        fn K32GetProcessMemoryInfo(process: *mut std::ffi::c_void, counters: *mut Counters, size: u32) -> i32;
    }
    let mut counters = Counters { size: size_of::<Counters>() as u32, ..Counters::default() };
    // SAFETY: the process's own handle, and a struct of the given size.
    let succeeded =
        unsafe { K32GetProcessMemoryInfo(GetCurrentProcess(), &mut counters, size_of::<Counters>() as u32) };
    assert!(succeeded != 0 && counters.working_set > 0 && counters.page_file > 0, "the process's size is known");
    Memory { private: counters.page_file.cast_signed() as i64, resident: counters.working_set.cast_signed() as i64 }
}
