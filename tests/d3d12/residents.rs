//! What is told to Direct3D about which memory is on the device, noted and checked against Direct3D's rules: its functions are replaced by ones
//! that note what they are given. Bringing memory back is played, as the lab's driver does nothing there.

use std::collections::HashMap;
use std::ffi::c_void;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Foundation::{E_NOTIMPL, E_OUTOFMEMORY, S_OK};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{HRESULT, Interface};

use super::tables::replace;

/// How memory comes back.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum Back {
    /// Beside its caller, a while later.
    Later,
    /// While its caller waits, as the system has no other way.
    AtOnce,
    /// Not at all, beside its caller or where the system has no other way.
    NotLater,
    NotAtOnce,
}

static BACK: AtomicU32 = AtomicU32::new(Back::Later as u32);

pub(crate) fn comes_back(how: Back) {
    BACK.store(how as u32, Ordering::SeqCst);
}

/// What was told, objects by their addresses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Told {
    Priority(usize, D3D12_RESIDENCY_PRIORITY),
    Evicted(Vec<usize>),
    /// With a fence and its value.
    Enqueued(Vec<usize>, usize, u64),
    MadeResident(Vec<usize>),
    /// The queue for anchors waits for a fence.
    Waits(usize, u64),
    /// It is given lists.
    Executes,
}

#[derive(Default)]
struct Notes {
    told: Vec<Told>,
    evicted: HashMap<usize, bool>,
    faults: Vec<String>,
    queue: usize,
}

static NOTES: Mutex<Option<Notes>> = Mutex::new(None);

fn note(with: impl FnOnce(&mut Notes)) {
    with(NOTES.lock().expect("nobody panics here").get_or_insert_default());
}

/// What was told since the last time, and which rules were broken.
pub(crate) fn told() -> (Vec<Told>, Vec<String>) {
    let (mut told, mut faults) = Default::default();
    note(|notes| (told, faults) = (std::mem::take(&mut notes.told), std::mem::take(&mut notes.faults)));
    (told, faults)
}

/// # Safety
/// So many live objects.
unsafe fn addresses(count: u32, objects: *const *mut c_void) -> Vec<usize> {
    // SAFETY: the caller's promise.
    unsafe { std::slice::from_raw_parts(objects, count as usize) }.iter().map(|object| *object as usize).collect()
}

/// Memory comes and goes once each.
fn turns(notes: &mut Notes, objects: &[usize], is_evicted: bool) {
    for object in objects {
        if notes.evicted.insert(*object, is_evicted).unwrap_or(false) == is_evicted {
            notes.faults.push(format!("{object:x} is {} twice", if is_evicted { "evicted" } else { "brought back" }));
        }
    }
}

unsafe extern "system" fn evict(_: *mut c_void, count: u32, objects: *const *mut c_void) -> HRESULT {
    // SAFETY: the caller's own objects.
    let objects = unsafe { addresses(count, objects) };
    note(|notes| {
        turns(notes, &objects, true);
        notes.told.push(Told::Evicted(objects));
    });
    S_OK
}

unsafe extern "system" fn make_resident(_: *mut c_void, count: u32, objects: *const *mut c_void) -> HRESULT {
    if BACK.load(Ordering::SeqCst) == Back::NotAtOnce as u32 {
        return E_OUTOFMEMORY;
    }
    // SAFETY: the caller's own objects.
    let objects = unsafe { addresses(count, objects) };
    note(|notes| {
        turns(notes, &objects, false);
        notes.told.push(Told::MadeResident(objects));
    });
    S_OK
}

unsafe extern "system" fn enqueue(
    _: *mut c_void,
    _: D3D12_RESIDENCY_FLAGS,
    count: u32,
    objects: *const *mut c_void,
    fence: *mut c_void,
    value: u64,
) -> HRESULT {
    match BACK.load(Ordering::SeqCst) {
        how if how == Back::Later as u32 => {}
        how if how == Back::NotLater as u32 => return E_OUTOFMEMORY,
        _ => return E_NOTIMPL,
    }
    // SAFETY: the caller's own objects, and its fence.
    let (objects, held) = unsafe { (addresses(count, objects), ID3D12Fence::from_raw_borrowed(&fence).cloned()) };
    note(|notes| {
        turns(notes, &objects, false);
        notes.told.push(Told::Enqueued(objects, fence as usize, value));
    });
    std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(50));
        // SAFETY: a live fence.
        unsafe { held.expect("a fence").Signal(value) }.expect("it is signalled");
    });
    S_OK
}

unsafe extern "system" fn set_priority(
    _: *mut c_void,
    count: u32,
    objects: *const *mut c_void,
    priorities: *const D3D12_RESIDENCY_PRIORITY,
) -> HRESULT {
    // SAFETY: the caller's own objects, with a priority each.
    let objects = unsafe { addresses(count, objects) };
    note(|notes| {
        for (i, object) in objects.into_iter().enumerate() {
            // SAFETY: as above.
            notes.told.push(Told::Priority(object, unsafe { *priorities.add(i) }));
        }
    });
    S_OK
}

type Move = unsafe extern "system" fn(*mut c_void, u32, *const *mut c_void) -> HRESULT;
type Enqueue =
    unsafe extern "system" fn(*mut c_void, D3D12_RESIDENCY_FLAGS, u32, *const *mut c_void, *mut c_void, u64) -> HRESULT;
type SetPriority =
    unsafe extern "system" fn(*mut c_void, u32, *const *mut c_void, *const D3D12_RESIDENCY_PRIORITY) -> HRESULT;
type Wait = unsafe extern "system" fn(*mut c_void, *mut c_void, u64) -> HRESULT;
type Execute = unsafe extern "system" fn(*mut c_void, u32, *const *mut c_void);
static THEIR_WAIT: OnceLock<Wait> = OnceLock::new();
static THEIR_EXECUTE: OnceLock<Execute> = OnceLock::new();

unsafe extern "system" fn wait(this: *mut c_void, fence: *mut c_void, value: u64) -> HRESULT {
    note(|notes| {
        if this as usize == notes.queue {
            notes.told.push(Told::Waits(fence as usize, value));
        }
    });
    let theirs = THEIR_WAIT.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, handed on.
    unsafe { theirs(this, fence, value) }
}

unsafe extern "system" fn execute(this: *mut c_void, count: u32, lists: *const *mut c_void) {
    note(|notes| {
        if this as usize == notes.queue && notes.told.last() != Some(&Told::Executes) {
            notes.told.push(Told::Executes);
        }
    });
    let theirs = THEIR_EXECUTE.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, handed on.
    unsafe { theirs(this, count, lists) }
}

/// Notes what devices like `gpu` are told, for the rest of the process, and of queues what its own for anchors is.
pub(crate) fn install(gpu: &Gpu) {
    static UNUSED: [OnceLock<Move>; 2] = [const { OnceLock::new() }; 2];
    static UNUSED_ENQUEUE: OnceLock<Enqueue> = OnceLock::new();
    static UNUSED_PRIORITY: OnceLock<SetPriority> = OnceLock::new();
    let queue = gpu.anchors().d3d12();
    note(|notes| notes.queue = queue.as_raw() as usize);
    let device = Interface::vtable(gpu.device());
    replace(&raw const device.Evict, &UNUSED[0], evict);
    replace(&raw const device.MakeResident, &UNUSED[1], make_resident);
    let newer: ID3D12Device3 = gpu.device().cast().expect("a device of today");
    replace(&raw const Interface::vtable(&newer).EnqueueMakeResident, &UNUSED_ENQUEUE, enqueue);
    let device: ID3D12Device1 = gpu.device().cast().expect("a device of today");
    replace(&raw const Interface::vtable(&device).SetResidencyPriority, &UNUSED_PRIORITY, set_priority);
    let queue = Interface::vtable(queue);
    replace(&raw const queue.Wait, &THEIR_WAIT, wait);
    replace(&raw const queue.ExecuteCommandLists, &THEIR_EXECUTE, execute);
}
