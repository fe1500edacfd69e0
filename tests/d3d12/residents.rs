//! Records the residency calls that Direct3D gets, and checks them against Direct3D's rules. The functions are replaced by hooks. Making
//! memory resident is simulated, as the lab's driver does nothing there.

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

/// How memory becomes resident again.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum ResidencyMode {
    /// Asynchronously, a while later.
    Later,
    /// Synchronously, as on a system without the asynchronous call.
    AtOnce,
    /// Never: the asynchronous call fails, or (`NotAtOnce`) the synchronous one on a system without the former.
    NotLater,
    NotAtOnce,
}

static BACK: AtomicU32 = AtomicU32::new(ResidencyMode::Later as u32);

pub(crate) fn comes_back(how: ResidencyMode) {
    BACK.store(how as u32, Ordering::SeqCst);
}

/// A recorded call; objects are given by their addresses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum ResidencyCall {
    Priority(usize, D3D12_RESIDENCY_PRIORITY),
    Evicted(Vec<usize>),
    /// With the fence and its value.
    Enqueued(Vec<usize>, usize, u64),
    MadeResident(Vec<usize>),
    /// The queue for anchors waits for a fence value.
    Waits(usize, u64),
    /// The queue executes command lists.
    Executes,
}

#[derive(Default)]
struct Notes {
    calls: Vec<ResidencyCall>,
    evicted: HashMap<usize, bool>,
    faults: Vec<String>,
    queue: usize,
}

static NOTES: Mutex<Option<Notes>> = Mutex::new(None);

fn note(with: impl FnOnce(&mut Notes)) {
    with(NOTES.lock().expect("nobody panics here").get_or_insert_default());
}

/// The calls recorded since the last time, and the broken rules.
pub(crate) fn take_calls() -> (Vec<ResidencyCall>, Vec<String>) {
    let (mut calls, mut faults) = Default::default();
    note(|notes| (calls, faults) = (std::mem::take(&mut notes.calls), std::mem::take(&mut notes.faults)));
    (calls, faults)
}

/// # Safety
/// `count` live objects.
unsafe fn addresses(count: u32, objects: *const *mut c_void) -> Vec<usize> {
    // SAFETY: the caller's promise.
    unsafe { std::slice::from_raw_parts(objects, count as usize) }.iter().map(|object| *object as usize).collect()
}

/// Each object must be evicted and made resident alternately.
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
        notes.calls.push(ResidencyCall::Evicted(objects));
    });
    S_OK
}

unsafe extern "system" fn make_resident(_: *mut c_void, count: u32, objects: *const *mut c_void) -> HRESULT {
    if BACK.load(Ordering::SeqCst) == ResidencyMode::NotAtOnce as u32 {
        return E_OUTOFMEMORY;
    }
    // SAFETY: the caller's own objects.
    let objects = unsafe { addresses(count, objects) };
    note(|notes| {
        turns(notes, &objects, false);
        notes.calls.push(ResidencyCall::MadeResident(objects));
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
        how if how == ResidencyMode::Later as u32 => {}
        how if how == ResidencyMode::NotLater as u32 => return E_OUTOFMEMORY,
        _ => return E_NOTIMPL,
    }
    // SAFETY: the caller's own objects, and its fence.
    let (objects, held) = unsafe { (addresses(count, objects), ID3D12Fence::from_raw_borrowed(&fence).cloned()) };
    note(|notes| {
        turns(notes, &objects, false);
        notes.calls.push(ResidencyCall::Enqueued(objects, fence as usize, value));
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
            notes.calls.push(ResidencyCall::Priority(object, unsafe { *priorities.add(i) }));
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
            notes.calls.push(ResidencyCall::Waits(fence as usize, value));
        }
    });
    let theirs = THEIR_WAIT.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, passed on.
    unsafe { theirs(this, fence, value) }
}

unsafe extern "system" fn execute(this: *mut c_void, count: u32, lists: *const *mut c_void) {
    note(|notes| {
        if this as usize == notes.queue && notes.calls.last() != Some(&ResidencyCall::Executes) {
            notes.calls.push(ResidencyCall::Executes);
        }
    });
    let theirs = THEIR_EXECUTE.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, passed on.
    unsafe { theirs(this, count, lists) }
}

/// Records the residency calls of devices like `gpu` for the rest of the process, and the calls of its own queue for anchors.
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
