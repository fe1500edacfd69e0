//! Hooks that record residency calls to Direct3D and check them against Direct3D's rules. Making memory resident is simulated, as the lab's
//! driver does nothing there.

use std::collections::HashMap;
use std::ffi::c_void;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Foundation::{E_NOTIMPL, E_OUTOFMEMORY, S_OK};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{HRESULT, Interface};
use test_support::d3d12::function_tables::replace_function;

/// How memory becomes resident again.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum ResidencyMode {
    /// Asynchronously, a while later.
    Later,
    /// Synchronously, as on a system without the asynchronous call.
    AtOnce,
    /// Never: the asynchronous call fails.
    FailLater,
    /// Never, on a system without the asynchronous call: the synchronous call fails.
    FailAtOnce,
}

static MODE: AtomicU32 = AtomicU32::new(ResidencyMode::Later as u32);

/// Sets how memory becomes resident from now on.
pub(crate) fn set_residency_mode(how: ResidencyMode) {
    MODE.store(how as u32, Ordering::SeqCst);
}

/// A recorded call; objects are given by their addresses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum ResidencyCall {
    /// An object's residency priority is set.
    Priority(usize, D3D12_RESIDENCY_PRIORITY),
    /// Objects are evicted.
    Evicted(Vec<usize>),
    /// Objects are made resident asynchronously, with the fence to signal and its value.
    Enqueued(Vec<usize>, usize, u64),
    /// Objects are made resident synchronously.
    MadeResident(Vec<usize>),
    /// The queue for anchors waits for a fence value.
    Waits(usize, u64),
    /// The queue executes command lists.
    Executes,
}

/// What the hooks record.
#[derive(Default)]
struct Log {
    calls: Vec<ResidencyCall>,
    /// Whether each object is evicted.
    evicted: HashMap<usize, bool>,
    /// Broken rules.
    faults: Vec<String>,
    /// The queue for anchors.
    queue: usize,
}

static LOG: Mutex<Option<Log>> = Mutex::new(None);

fn with_log(change: impl FnOnce(&mut Log)) {
    change(LOG.lock().expect("nobody panics here").get_or_insert_default());
}

/// Takes the calls recorded since the last time, and the broken rules.
pub(crate) fn take_calls() -> (Vec<ResidencyCall>, Vec<String>) {
    let (mut calls, mut faults) = Default::default();
    with_log(|log| (calls, faults) = (std::mem::take(&mut log.calls), std::mem::take(&mut log.faults)));
    (calls, faults)
}

/// # Safety
/// `count` live objects.
unsafe fn addresses(count: u32, objects: *const *mut c_void) -> Vec<usize> {
    // SAFETY: the caller's promise.
    unsafe { std::slice::from_raw_parts(objects, count as usize) }.iter().map(|object| *object as usize).collect()
}

/// Checks that each object is evicted and made resident alternately.
fn check_alternation(log: &mut Log, objects: &[usize], is_evicted: bool) {
    for object in objects {
        if log.evicted.insert(*object, is_evicted).unwrap_or(false) == is_evicted {
            log.faults.push(format!("{object:x} is {} twice", if is_evicted { "evicted" } else { "made resident" }));
        }
    }
}

unsafe extern "system" fn evict(_: *mut c_void, count: u32, objects: *const *mut c_void) -> HRESULT {
    // SAFETY: the caller's own objects.
    let objects = unsafe { addresses(count, objects) };
    with_log(|log| {
        check_alternation(log, &objects, true);
        log.calls.push(ResidencyCall::Evicted(objects));
    });
    S_OK
}

unsafe extern "system" fn make_resident(_: *mut c_void, count: u32, objects: *const *mut c_void) -> HRESULT {
    if MODE.load(Ordering::SeqCst) == ResidencyMode::FailAtOnce as u32 {
        return E_OUTOFMEMORY;
    }
    // SAFETY: the caller's own objects.
    let objects = unsafe { addresses(count, objects) };
    with_log(|log| {
        check_alternation(log, &objects, false);
        log.calls.push(ResidencyCall::MadeResident(objects));
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
    match MODE.load(Ordering::SeqCst) {
        how if how == ResidencyMode::Later as u32 => {}
        how if how == ResidencyMode::FailLater as u32 => return E_OUTOFMEMORY,
        _ => return E_NOTIMPL,
    }
    // SAFETY: the caller's own objects, and its fence.
    let (objects, held) = unsafe { (addresses(count, objects), ID3D12Fence::from_raw_borrowed(&fence).cloned()) };
    with_log(|log| {
        check_alternation(log, &objects, false);
        log.calls.push(ResidencyCall::Enqueued(objects, fence as usize, value));
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
    with_log(|log| {
        for (i, object) in objects.into_iter().enumerate() {
            // SAFETY: as above.
            log.calls.push(ResidencyCall::Priority(object, unsafe { *priorities.add(i) }));
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
static ORIGINAL_WAIT: OnceLock<Wait> = OnceLock::new();
static ORIGINAL_EXECUTE: OnceLock<Execute> = OnceLock::new();

unsafe extern "system" fn wait(this: *mut c_void, fence: *mut c_void, value: u64) -> HRESULT {
    with_log(|log| {
        if this as usize == log.queue {
            log.calls.push(ResidencyCall::Waits(fence as usize, value));
        }
    });
    let original = ORIGINAL_WAIT.get().expect("the original function");
    // SAFETY: the caller's own arguments, passed on.
    unsafe { original(this, fence, value) }
}

unsafe extern "system" fn execute(this: *mut c_void, count: u32, lists: *const *mut c_void) {
    with_log(|log| {
        if this as usize == log.queue && log.calls.last() != Some(&ResidencyCall::Executes) {
            log.calls.push(ResidencyCall::Executes);
        }
    });
    let original = ORIGINAL_EXECUTE.get().expect("the original function");
    // SAFETY: the caller's own arguments, passed on.
    unsafe { original(this, count, lists) }
}

/// Records the residency calls of devices like `gpu` for the rest of the process, and the calls of its own queue for anchors.
pub(crate) fn install(gpu: &Gpu) {
    // Objects of an earlier device are gone, and a new one may have the address of one that was evicted.
    *LOG.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = None;
    static UNUSED: [OnceLock<Move>; 2] = [const { OnceLock::new() }; 2];
    static UNUSED_ENQUEUE: OnceLock<Enqueue> = OnceLock::new();
    static UNUSED_PRIORITY: OnceLock<SetPriority> = OnceLock::new();
    let queue = gpu.anchors().d3d12();
    with_log(|log| log.queue = queue.as_raw() as usize);
    let device = Interface::vtable(gpu.device());
    replace_function(&raw const device.Evict, &UNUSED[0], evict);
    replace_function(&raw const device.MakeResident, &UNUSED[1], make_resident);
    let newer: ID3D12Device3 = gpu.device().cast().expect("a device of today");
    replace_function(&raw const Interface::vtable(&newer).EnqueueMakeResident, &UNUSED_ENQUEUE, enqueue);
    let device: ID3D12Device1 = gpu.device().cast().expect("a device of today");
    replace_function(&raw const Interface::vtable(&device).SetResidencyPriority, &UNUSED_PRIORITY, set_priority);
    let queue = Interface::vtable(queue);
    replace_function(&raw const queue.Wait, &ORIGINAL_WAIT, wait);
    replace_function(&raw const queue.ExecuteCommandLists, &ORIGINAL_EXECUTE, execute);
}
