//! What queues are told that their work is called.

use std::ffi::{CStr, c_void};
use std::sync::{Mutex, Once, OnceLock};

use cairn::gpu::windows::Win32::Graphics::Direct3D12::ID3D12CommandQueue;
use cairn::gpu::windows::core::Interface;

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

#[link(name = "kernel32")]
unsafe extern "system" {
    fn VirtualProtect(address: *mut c_void, size: usize, protection: u32, before: *mut u32) -> i32;
}
const READ_WRITE: u32 = 4;

/// Puts `ours` into a place of a table of functions.
fn replace<F: Copy>(place: *const F, ours: F) {
    assert_eq!(size_of::<F>(), size_of::<usize>(), "a function");
    let place = place.cast_mut();
    let mut before = 0;
    // SAFETY: the page of a live table, and a place that lives during the call.
    assert!(unsafe { VirtualProtect(place.cast(), size_of::<F>(), READ_WRITE, &mut before) } != 0, "it can be written");
    // SAFETY: a table that the process may write now, and a function of the same type. Volatile, as the compiler takes the table of
    // an interface for constant, and leaves out what it need not write.
    unsafe { place.write_volatile(ours) };
    // SAFETY: as above.
    assert!(unsafe { VirtualProtect(place.cast(), size_of::<F>(), before, &mut before) } != 0, "it is as before");
}

/// Listens to `queue`, which is at rest, for the rest of the process. Queues share their table of functions, and others may be in the
/// midst of something: so their own functions are known before ours are called, and of other queues nothing is counted.
pub(crate) fn listen(queue: &ID3D12CommandQueue) {
    static REPLACED: Once = Once::new();
    TOLD.lock().expect("nobody panics here").heard.push(queue.as_raw() as usize);
    let table = Interface::vtable(queue);
    REPLACED.call_once(|| {
        THEIR_BEGIN.get_or_init(|| table.BeginEvent);
        THEIR_END.get_or_init(|| table.EndEvent);
        replace(&raw const table.BeginEvent, our_begin);
        replace(&raw const table.EndEvent, our_end);
    });
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
