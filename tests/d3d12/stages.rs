//! Records the names of GPU work on queues (`BeginEvent`, `EndEvent`).

use std::ffi::{CStr, c_void};
use std::sync::{Mutex, OnceLock};

use cairn::gpu::windows::Win32::Graphics::Direct3D12::ID3D12CommandQueue;
use cairn::gpu::windows::core::Interface;

use super::tables::replace;

/// The recorded events, with queues by their addresses.
struct Told {
    /// Queues that are recorded.
    heard: Vec<usize>,
    /// Names with their queue, in order.
    names: Vec<(usize, String)>,
    /// Queues with an event that has not ended, once for each such event.
    open: Vec<usize>,
}

static TOLD: Mutex<Told> = Mutex::new(Told { heard: Vec::new(), names: Vec::new(), open: Vec::new() });

type Begin = unsafe extern "system" fn(*mut c_void, u32, *const c_void, u32);
type End = unsafe extern "system" fn(*mut c_void);
static THEIR_BEGIN: OnceLock<Begin> = OnceLock::new();
static THEIR_END: OnceLock<End> = OnceLock::new();

/// Records the events of `queue`, which must be idle, for the rest of the process. Queues share their table of functions, and others may
/// be in the middle of an event, so other queues are ignored.
pub(crate) fn listen(queue: &ID3D12CommandQueue) {
    TOLD.lock().expect("nobody panics here").heard.push(queue.as_raw() as usize);
    let table = Interface::vtable(queue);
    replace(&raw const table.BeginEvent, &THEIR_BEGIN, our_begin);
    replace(&raw const table.EndEvent, &THEIR_END, our_end);
}

/// The names recorded on a queue since the last call; all events have ended.
pub(crate) fn told(queue: &ID3D12CommandQueue) -> Vec<String> {
    let address = queue.as_raw() as usize;
    let mut told = TOLD.lock().expect("nobody panics here");
    assert!(!told.open.contains(&address), "what begins ends");
    told.names.extract_if(.., |(of, _)| *of == address).map(|(_, name)| name).collect()
}

unsafe extern "system" fn our_begin(this: *mut c_void, kind: u32, name: *const c_void, size: u32) {
    assert_eq!(kind, 1, "bytes that end with a zero");
    // SAFETY: the caller's own text of `size` bytes.
    let bytes = unsafe { std::slice::from_raw_parts(name.cast::<u8>(), size as usize) };
    let text = CStr::from_bytes_with_nul(bytes).expect("one zero, at the end").to_str().expect("UTF-8").to_owned();
    let mut told = TOLD.lock().expect("nobody panics here");
    if told.heard.contains(&(this as usize)) {
        told.names.push((this as usize, text));
        told.open.push(this as usize);
    }
    drop(told);
    let theirs = THEIR_BEGIN.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, passed on.
    unsafe { theirs(this, kind, name, size) }
}

unsafe extern "system" fn our_end(this: *mut c_void) {
    let mut told = TOLD.lock().expect("nobody panics here");
    if told.heard.contains(&(this as usize)) {
        let at = told.open.iter().rposition(|of| *of == this as usize).expect("it has begun");
        told.open.remove(at);
    }
    drop(told);
    let theirs = THEIR_END.get().expect("what it replaces");
    // SAFETY: the caller's own queue.
    unsafe { theirs(this) }
}
