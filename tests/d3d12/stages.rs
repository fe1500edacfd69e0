//! What queues are told that their work is called.

use std::ffi::{CStr, c_void};
use std::sync::{Mutex, OnceLock};

use cairn::gpu::windows::Win32::Graphics::Direct3D12::ID3D12CommandQueue;
use cairn::gpu::windows::core::Interface;

use super::tables::replace;

/// What came, of queues by their addresses.
struct Told {
    /// Queues that are listened to.
    heard: Vec<usize>,
    /// In the order in which they came.
    names: Vec<(usize, String)>,
    /// Queues with a name that has not ended, once for each.
    open: Vec<usize>,
}

static TOLD: Mutex<Told> = Mutex::new(Told { heard: Vec::new(), names: Vec::new(), open: Vec::new() });

type Begin = unsafe extern "system" fn(*mut c_void, u32, *const c_void, u32);
type End = unsafe extern "system" fn(*mut c_void);
static THEIR_BEGIN: OnceLock<Begin> = OnceLock::new();
static THEIR_END: OnceLock<End> = OnceLock::new();

/// Listens to `queue`, which is at rest, for the rest of the process. Queues share their table of functions, and others may be in the
/// midst of something: of those nothing is counted.
pub(crate) fn listen(queue: &ID3D12CommandQueue) {
    TOLD.lock().expect("nobody panics here").heard.push(queue.as_raw() as usize);
    let table = Interface::vtable(queue);
    replace(&raw const table.BeginEvent, &THEIR_BEGIN, our_begin);
    replace(&raw const table.EndEvent, &THEIR_END, our_end);
}

/// What a queue was told since this was last asked; all of it has ended.
pub(crate) fn told(queue: &ID3D12CommandQueue) -> Vec<String> {
    let address = queue.as_raw() as usize;
    let mut told = TOLD.lock().expect("nobody panics here");
    assert!(!told.open.contains(&address), "what begins ends");
    told.names.extract_if(.., |(of, _)| *of == address).map(|(_, name)| name).collect()
}

unsafe extern "system" fn our_begin(this: *mut c_void, kind: u32, name: *const c_void, size: u32) {
    assert_eq!(kind, 1, "bytes that end with a zero");
    // SAFETY: the caller's own text of so many bytes.
    let bytes = unsafe { std::slice::from_raw_parts(name.cast::<u8>(), size as usize) };
    let text = CStr::from_bytes_with_nul(bytes).expect("one zero, at the end").to_str().expect("UTF-8").to_owned();
    let mut told = TOLD.lock().expect("nobody panics here");
    if told.heard.contains(&(this as usize)) {
        told.names.push((this as usize, text));
        told.open.push(this as usize);
    }
    drop(told);
    let theirs = THEIR_BEGIN.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, handed on.
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
