//! The recorder of Direct3D 12 calls, where it is this program's `d3d12.dll` (`cargo xtask test recorder`).

use std::collections::BTreeMap;
use std::ffi::c_void;
use std::sync::OnceLock;

use cairn::gpu::windows::Win32::Foundation::HMODULE;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::{
    D3D12_RESOURCE_STATES, ID3D12GraphicsCommandList, ID3D12Resource,
};
use cairn::gpu::windows::core::{Interface, PCSTR, s};

#[link(name = "kernel32")]
unsafe extern "system" {
    fn GetModuleHandleA(name: PCSTR) -> HMODULE;
    fn GetProcAddress(module: HMODULE, name: PCSTR) -> *const c_void;
}

/// A broken rule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// The identifier of Microsoft's debug layer, or the recorder's own.
    pub id: String,
    /// The objects and values.
    pub text: String,
}

/// Address of a function of the recorder; null if it is not loaded.
fn find(name: PCSTR) -> *const c_void {
    // Found once: the name is Windows' own library's when DirectML has loaded that.
    static MODULE: OnceLock<usize> = OnceLock::new();
    // SAFETY: a name that ends.
    let module = *MODULE.get_or_init(|| unsafe { GetModuleHandleA(s!("d3d12.dll")) }.0 as usize);
    // SAFETY: a name that ends; a module that lives as long as the process.
    unsafe { GetProcAddress(HMODULE(module as *mut c_void), name) }
}

/// Whether the recorder is this program's `d3d12.dll`.
pub fn is_loaded() -> bool {
    !find(s!("RecorderStateOf")).is_null()
}

/// A function of the recorder.
///
/// # Panics
/// The recorder is not loaded.
///
/// # Safety
/// `F` is the type of the function with that name.
unsafe fn function<F: Copy>(name: PCSTR) -> F {
    assert_eq!(size_of::<F>(), size_of::<usize>(), "a function");
    let found = find(name);
    assert!(!found.is_null(), "the recorder is this program's d3d12.dll: run it by `cargo xtask test recorder`");
    // SAFETY: the caller's promise; both are addresses of functions.
    unsafe { std::mem::transmute_copy(&found) }
}

/// The rules that this process breaks during `work`. They are not printed.
pub fn findings_of(work: impl FnOnce()) -> Vec<Finding> {
    type Receive = unsafe extern "system" fn(*mut c_void, *const u8, usize, *const u8, usize);
    unsafe extern "system" fn receive(
        to: *mut c_void,
        id: *const u8,
        id_size: usize,
        text: *const u8,
        text_size: usize,
    ) {
        let text_of = |start, size| {
            // SAFETY: the recorder's text.
            String::from_utf8_lossy(unsafe { std::slice::from_raw_parts(start, size) }).into_owned()
        };
        // SAFETY: the vector below.
        unsafe { &mut *to.cast::<Vec<Finding>>() }
            .push(Finding { id: text_of(id, id_size), text: text_of(text, text_size) });
    }
    // SAFETY: the recorder's functions.
    let (keep, take) = unsafe {
        (
            function::<extern "system" fn()>(s!("RecorderKeepFindings")),
            function::<unsafe extern "system" fn(Receive, *mut c_void)>(s!("RecorderTakeFindings")),
        )
    };
    keep();
    work();
    let mut findings: Vec<Finding> = Vec::new();
    // SAFETY: a vector that lives during the call.
    unsafe { take(receive, (&raw mut findings).cast()) };
    findings
}

/// Counts of the work that this process's queues executed since the last call: by the name of the event in which it was submitted, an empty
/// one for work outside of events, and by the names of `d3d12_recorder::counts::Counts`.
pub fn take_counts() -> BTreeMap<String, BTreeMap<String, u64>> {
    type Receive = unsafe extern "system" fn(*mut c_void, *const u8, usize);
    unsafe extern "system" fn receive(to: *mut c_void, text: *const u8, size: usize) {
        // SAFETY: the recorder's text, and the vector below.
        unsafe { (*to.cast::<Vec<u8>>()).extend_from_slice(std::slice::from_raw_parts(text, size)) };
    }
    // SAFETY: the recorder's function.
    let take = unsafe { function::<unsafe extern "system" fn(Receive, *mut c_void)>(s!("RecorderTakeCounts")) };
    let mut text: Vec<u8> = Vec::new();
    // SAFETY: a vector that lives during the call.
    unsafe { take(receive, (&raw mut text).cast()) };
    serde_json::from_slice(&text).expect("the recorder's counts")
}

/// The state of a resource after everything that was submitted; `None` where its subresources differ, or while a queue waits for a fence.
pub fn state_of(resource: &ID3D12Resource) -> Option<D3D12_RESOURCE_STATES> {
    // SAFETY: the recorder's function.
    let state = unsafe { function::<extern "system" fn(*mut c_void) -> i64>(s!("RecorderStateOf")) };
    i32::try_from(state(resource.as_raw())).ok().filter(|state| *state >= 0).map(D3D12_RESOURCE_STATES)
}

/// Whether a list is being recorded.
pub fn is_open(list: &ID3D12GraphicsCommandList) -> bool {
    // SAFETY: the recorder's function.
    let is_open = unsafe { function::<extern "system" fn(*mut c_void) -> i32>(s!("RecorderIsOpen")) };
    is_open(list.as_raw()) != 0
}

/// Reports the objects that are alive now.
pub fn report_live() {
    // SAFETY: the recorder's function.
    let report = unsafe { function::<extern "system" fn()>(s!("RecorderReportLive")) };
    report();
}

/// A call to Direct3D that fails on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// This call, from 1 on, for lack of memory.
    Once(u64),
    /// This call and all later ones, since the device is removed.
    Removal(u64),
}

/// Calls to Direct3D fail as `failure` says while [`while_failing`] runs something. Calls are counted anew.
pub fn set_failure(failure: Option<Failure>) {
    let (call, is_removal) = match failure {
        None => (0, false),
        Some(Failure::Once(call)) => (call, false),
        Some(Failure::Removal(call)) => (call, true),
    };
    // SAFETY: the recorder's function.
    let fail = unsafe { function::<extern "system" fn(u64, i32)>(s!("RecorderFailCall")) };
    fail(call, is_removal.into());
}

/// Runs something with failing calls; returns its result, and the number of counted calls so far.
pub fn while_failing<T>(work: impl FnOnce() -> T) -> (T, u64) {
    // SAFETY: the recorder's function.
    let arm = unsafe { function::<extern "system" fn(i32) -> u64>(s!("RecorderArmFailure")) };
    arm(1);
    let result = work();
    (result, arm(0))
}

/// A number for each call that was counted since [`set_failure`] with `None`: the same for calls of the same place in the program.
pub fn call_sites() -> Vec<u64> {
    type Receive = unsafe extern "system" fn(*mut c_void, *const u64, usize);
    unsafe extern "system" fn receive(to: *mut c_void, numbers: *const u64, count: usize) {
        // SAFETY: the recorder's numbers, and the vector below.
        unsafe { (*to.cast::<Vec<u64>>()).extend_from_slice(std::slice::from_raw_parts(numbers, count)) };
    }
    // SAFETY: the recorder's function.
    let take = unsafe { function::<unsafe extern "system" fn(Receive, *mut c_void)>(s!("RecorderTakeSites")) };
    let mut sites: Vec<u64> = Vec::new();
    // SAFETY: a vector that lives during the call.
    unsafe { take(receive, (&raw mut sites).cast()) };
    sites
}
