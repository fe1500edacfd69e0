//! Records the names of GPU work on queues (`BeginEvent`, `EndEvent`).

use std::ffi::{CStr, c_void};
use std::sync::{Mutex, OnceLock};

use cairn::gpu::windows::Win32::Graphics::Direct3D12::ID3D12CommandQueue;
use cairn::gpu::windows::core::Interface;
use test_support::d3d12::function_tables::replace_function;

/// The recorded events, with queues by their addresses.
struct EventLog {
    /// Queues whose events are recorded.
    queues: Vec<usize>,
    /// Names with their queue, in order.
    names: Vec<(usize, String)>,
    /// Queues with an event that has not ended, once for each such event.
    open: Vec<usize>,
}

static LOG: Mutex<EventLog> = Mutex::new(EventLog { queues: Vec::new(), names: Vec::new(), open: Vec::new() });

type Begin = unsafe extern "system" fn(*mut c_void, u32, *const c_void, u32);
type End = unsafe extern "system" fn(*mut c_void);
static ORIGINAL_BEGIN: OnceLock<Begin> = OnceLock::new();
static ORIGINAL_END: OnceLock<End> = OnceLock::new();

/// Records the events of `queue`, which must be idle, for the rest of the process. Queues share their table of functions, and others may
/// be in the middle of an event, so other queues are ignored.
pub(crate) fn record_events(queue: &ID3D12CommandQueue) {
    LOG.lock().expect("nobody panics here").queues.push(queue.as_raw() as usize);
    let table = Interface::vtable(queue);
    replace_function(&raw const table.BeginEvent, &ORIGINAL_BEGIN, hook_begin);
    replace_function(&raw const table.EndEvent, &ORIGINAL_END, hook_end);
}

/// Takes the names recorded on a queue since the last call. Panics if an event has not ended.
pub(crate) fn take_names(queue: &ID3D12CommandQueue) -> Vec<String> {
    let address = queue.as_raw() as usize;
    let mut log = LOG.lock().expect("nobody panics here");
    assert!(!log.open.contains(&address), "every event has ended");
    log.names.extract_if(.., |(of, _)| *of == address).map(|(_, name)| name).collect()
}

unsafe extern "system" fn hook_begin(this: *mut c_void, kind: u32, name: *const c_void, size: u32) {
    assert_eq!(kind, 1, "bytes that end with a zero");
    // SAFETY: the caller's own text of `size` bytes.
    let bytes = unsafe { std::slice::from_raw_parts(name.cast::<u8>(), size as usize) };
    let text = CStr::from_bytes_with_nul(bytes).expect("one zero, at the end").to_str().expect("UTF-8").to_owned();
    let mut log = LOG.lock().expect("nobody panics here");
    if log.queues.contains(&(this as usize)) {
        log.names.push((this as usize, text));
        log.open.push(this as usize);
    }
    drop(log);
    let original = ORIGINAL_BEGIN.get().expect("the original function");
    // SAFETY: the caller's own arguments, passed on.
    unsafe { original(this, kind, name, size) }
}

unsafe extern "system" fn hook_end(this: *mut c_void) {
    let mut log = LOG.lock().expect("nobody panics here");
    if log.queues.contains(&(this as usize)) {
        let at = log.open.iter().rposition(|of| *of == this as usize).expect("it has begun");
        log.open.remove(at);
    }
    drop(log);
    let original = ORIGINAL_END.get().expect("the original function");
    // SAFETY: the caller's own queue.
    unsafe { original(this) }
}
