//! The functions of `d3d12.dll`, passed on to Windows' own.

use std::ffi::c_void;
use std::sync::OnceLock;

use windows::Win32::Foundation::HMODULE;
use windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryW};
use windows::core::{BOOL, GUID, HRESULT, PCSTR, s, w};

use super::{device, report, swapchain};
use crate::counts::to_json;

/// Windows' own library.
fn library() -> HMODULE {
    static LIBRARY: OnceLock<usize> = OnceLock::new();
    // SAFETY: Windows' own library. By its whole path, since the name alone is this library's.
    let load =
        || unsafe { LoadLibraryW(w!("C:\\windows\\system32\\d3d12.dll")) }.expect("Windows' d3d12.dll").0 as usize;
    HMODULE(*LIBRARY.get_or_init(load) as *mut c_void)
}

/// A function of Windows' own library.
///
/// # Safety
/// `F` is the type of the function with that name.
unsafe fn original<F: Copy>(name: PCSTR) -> F {
    assert_eq!(size_of::<F>(), size_of::<usize>(), "a function");
    // SAFETY: a live library, and a name that ends.
    let found = unsafe { GetProcAddress(library(), name) }.expect("a function of d3d12.dll");
    // SAFETY: the caller's promise; both are addresses of functions.
    unsafe { std::mem::transmute_copy(&found) }
}

/// `D3D12CreateDevice`: the device's calls are recorded.
///
/// # Safety
/// As the original.
#[unsafe(no_mangle)]
pub(super) unsafe extern "system" fn D3D12CreateDevice(
    adapter: *mut c_void,
    level: i32,
    id: *const GUID,
    device: *mut *mut c_void,
) -> HRESULT {
    type Create = unsafe extern "system" fn(*mut c_void, i32, *const GUID, *mut *mut c_void) -> HRESULT;
    // SAFETY: the caller's own adapter.
    unsafe { swapchain::record_factories(adapter) };
    // SAFETY: the caller's own arguments, passed on.
    let result = unsafe { original::<Create>(s!("D3D12CreateDevice"))(adapter, level, id, device) };
    if result.is_ok() && !device.is_null() {
        // SAFETY: a device that was just created.
        unsafe { device::record(*device) };
    }
    result
}

/// Functions that make no device.
macro_rules! passed_on {
    ($($name:ident($($argument:ident: $kind:ty),*);)*) => {$(
        /// Passed on.
        ///
        /// # Safety
        /// As the original.
        #[unsafe(no_mangle)]
        pub(super) unsafe extern "system" fn $name($($argument: $kind),*) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                original::<unsafe extern "system" fn($($kind),*) -> HRESULT>(PCSTR(concat!(stringify!($name), "\0").as_ptr()))($($argument),*)
            }
        }
    )*};
}

passed_on! {
    D3D12GetDebugInterface(id: *const GUID, made: *mut *mut c_void);
    D3D12GetInterface(class: *const GUID, id: *const GUID, made: *mut *mut c_void);
    D3D12EnableExperimentalFeatures(count: u32, features: *const GUID, settings: *mut c_void, sizes: *mut u32);
    D3D12SerializeRootSignature(desc: *const c_void, version: i32, made: *mut *mut c_void, error: *mut *mut c_void);
    D3D12SerializeVersionedRootSignature(desc: *const c_void, made: *mut *mut c_void, error: *mut *mut c_void);
    D3D12CreateRootSignatureDeserializer(bytes: *const c_void, size: usize, id: *const GUID, made: *mut *mut c_void);
    D3D12CreateVersionedRootSignatureDeserializer(bytes: *const c_void, size: usize, id: *const GUID, made: *mut *mut c_void);
}

const PROCESS_DETACH: u32 = 0;

/// At the end of the process, objects that are alive are reported.
///
/// # Safety
/// Called by Windows.
#[unsafe(no_mangle)]
pub(super) unsafe extern "system" fn DllMain(_: HMODULE, reason: u32, reserved: *mut c_void) -> BOOL {
    // Null if the library alone is unloaded.
    if reason == PROCESS_DETACH && !reserved.is_null() {
        super::report_live();
    }
    true.into()
}

/// Receives the identifier and the text of a finding, in UTF-8, with a value of the caller's.
type Receive =
    unsafe extern "system" fn(context: *mut c_void, id: *const u8, id_size: usize, text: *const u8, text_size: usize);

/// From now on findings are kept rather than printed.
#[unsafe(no_mangle)]
pub(super) extern "system" fn RecorderKeepFindings() {
    super::keep_findings();
}

/// Hands over the findings that were kept. Later ones are printed.
///
/// # Safety
/// `receive` takes `context`.
#[unsafe(no_mangle)]
pub(super) unsafe extern "system" fn RecorderTakeFindings(receive: Receive, context: *mut c_void) {
    for finding in super::take_kept() {
        let (id, text) = (finding.rule.id(), &finding.text);
        // SAFETY: the caller's promise; texts that live during the call.
        unsafe { receive(context, id.as_ptr(), id.len(), text.as_ptr(), text.len()) };
    }
}

/// Reports the objects that are alive.
#[unsafe(no_mangle)]
pub(super) extern "system" fn RecorderReportLive() {
    super::report_live();
}

/// Receives a text in UTF-8, with a value of the caller's.
type ReceiveText = unsafe extern "system" fn(context: *mut c_void, text: *const u8, size: usize);

/// Hands over the counts of the work that was executed since the last call, as JSON (`counts::to_json`).
///
/// # Safety
/// `receive` takes `context`.
#[unsafe(no_mangle)]
pub(super) unsafe extern "system" fn RecorderTakeCounts(receive: ReceiveText, context: *mut c_void) {
    let text = to_json(&report(0, |calls| calls.recorder.take_counts()));
    // SAFETY: the caller's promise; a text that lives during the call.
    unsafe { receive(context, text.as_ptr(), text.len()) };
}

/// While armed, makes call number `call`, from 1 on, fail: once for lack of memory, or with all later ones since the device is removed. 0 for no
/// call. Calls are counted anew.
#[unsafe(no_mangle)]
pub(super) extern "system" fn RecorderFailCall(call: u64, is_removal: BOOL) {
    super::faults::fail(call, is_removal.as_bool());
}

/// Arms the failing call, or disarms it; returns the number of calls that were counted while armed.
#[unsafe(no_mangle)]
pub(super) extern "system" fn RecorderArmFailure(is_armed: BOOL) -> u64 {
    super::faults::arm(is_armed.as_bool())
}

/// The state of a resource after everything that was submitted; -1 where its subresources differ, or while a queue waits for a fence.
#[unsafe(no_mangle)]
pub(super) extern "system" fn RecorderStateOf(resource: *mut c_void) -> i64 {
    let state = report(0, |calls| calls.resource(resource).and_then(|resource| calls.recorder.state_of(resource)));
    state.map_or(-1, |state| i64::from(state.0))
}

/// Whether a command list is being recorded.
#[unsafe(no_mangle)]
pub(super) extern "system" fn RecorderIsOpen(list: *mut c_void) -> BOOL {
    report(0, |calls| calls.id(list).is_some_and(|list| calls.recorder.is_open(list))).into()
}

/// Receives numbers, with a value of the caller's.
type ReceiveNumbers = unsafe extern "system" fn(context: *mut c_void, numbers: *const u64, count: usize);

/// Hands over a number for each call that was counted since `RecorderFailCall(0, ..)`: the same for calls of the same place in the program.
///
/// # Safety
/// `receive` takes `context`.
#[unsafe(no_mangle)]
pub(super) unsafe extern "system" fn RecorderTakeSites(receive: ReceiveNumbers, context: *mut c_void) {
    let sites = super::faults::sites();
    // SAFETY: the caller's promise; numbers that live during the call.
    unsafe { receive(context, sites.as_ptr(), sites.len()) };
}
