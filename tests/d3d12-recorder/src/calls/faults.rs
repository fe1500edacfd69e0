//! Calls that fail on purpose, without reaching Direct3D.

use std::ffi::c_void;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use lock_order::Mutex;
use windows::Win32::Foundation::E_OUTOFMEMORY;
use windows::Win32::Graphics::Direct3D12::{
    D3D12_FENCE_FLAG_NONE, ID3D12CommandQueue, ID3D12Device, ID3D12Device_Vtbl, ID3D12Fence,
};
use windows::Win32::Graphics::Dxgi::DXGI_ERROR_DEVICE_REMOVED;
use windows::core::{HRESULT, Interface};

use super::hooks::{HookGuard, call_site, replace};
use super::report;

/// Whether calls are counted, and fail when it is their turn.
static IS_ARMED: AtomicBool = AtomicBool::new(false);
/// Calls so far that could fail.
static COUNT: AtomicU64 = AtomicU64::new(0);
/// Number of the call that fails, from 1; 0 for none.
static FAILING: AtomicU64 = AtomicU64::new(0);
/// Whether all later calls fail too, because the device is removed.
static IS_REMOVAL: AtomicBool = AtomicBool::new(false);

/// Call sites (hashes of the call stack) so far, while none is to fail.
static SITES: Mutex<Vec<u64>> = Mutex::new(Vec::new());

/// Call sites (hashes of the call stack) of the calls that were counted since [`fail`], if none was to fail.
pub(super) fn sites() -> Vec<u64> {
    SITES.lock().clone()
}

/// From now on, while armed, call number `call` fails for lack of memory; or it and all later ones, since the device is removed.
pub(super) fn fail(call: u64, is_removal: bool) {
    COUNT.store(0, Ordering::SeqCst);
    *FINISHED.lock() = 0;
    SITES.lock().clear();
    IS_REMOVAL.store(is_removal, Ordering::SeqCst);
    FAILING.store(call, Ordering::SeqCst);
}

/// Arms or disarms; returns the number of calls that were counted.
pub(super) fn arm(is_armed: bool) -> u64 {
    IS_ARMED.store(is_armed, Ordering::SeqCst);
    COUNT.load(Ordering::SeqCst)
}

/// Functions that fail on removed devices only: ONNX Runtime waits for ever for a signal that it took for queued.
const REMOVAL_ONLY: [&str; 2] = ["Signal", "Wait"];

/// The number of the failing call at whose removal the queues' work was finished; 0 before.
static FINISHED: Mutex<u64> = Mutex::new(0);

/// Whether the device is removed. The first thread that learns so waits for its work, and all of it counts as complete: the call that removed
/// the device may be one of another thread, such as that of DXGI's swap chain, and not be there yet.
fn enter_removal() -> bool {
    let failing = FAILING.load(Ordering::SeqCst);
    let has_failed = failing > 0 && COUNT.load(Ordering::SeqCst) >= failing;
    let is_removed = IS_ARMED.load(Ordering::SeqCst) && IS_REMOVAL.load(Ordering::SeqCst) && has_failed;
    if is_removed {
        let mut finished = FINISHED.lock();
        if *finished != failing {
            finish_work();
            *finished = failing;
        }
        report(0, |calls| calls.recorder.remove_device());
    }
    is_removed
}

/// Return value of a hooked function.
pub(super) trait ReturnValue: Sized {
    /// The failure of this call of a function, if it fails on purpose.
    fn injected(function: &str) -> Option<Self>;
}

impl ReturnValue for () {
    fn injected(_: &str) -> Option<Self> {
        None
    }
}

impl ReturnValue for u64 {
    fn injected(_: &str) -> Option<Self> {
        // A removed device's fences have the highest value.
        enter_removal().then_some(u64::MAX)
    }
}

impl ReturnValue for HRESULT {
    fn injected(function: &str) -> Option<Self> {
        if !IS_ARMED.load(Ordering::SeqCst) {
            return None;
        }
        let failing = FAILING.load(Ordering::SeqCst);
        if failing == 0 {
            // In the order of their numbers.
            let mut sites = SITES.lock();
            sites.push(call_site());
            COUNT.fetch_add(1, Ordering::SeqCst);
            return None;
        }
        let call = COUNT.fetch_add(1, Ordering::SeqCst) + 1;
        if call < failing {
            return None;
        }
        if enter_removal() {
            return Some(DXGI_ERROR_DEVICE_REMOVED);
        }
        let fails = !IS_REMOVAL.load(Ordering::SeqCst) && call == failing && !REMOVAL_ONLY.contains(&function);
        fails.then_some(E_OUTOFMEMORY)
    }
}

/// Longest wait for a queue, which may wait for a signal that is never queued.
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// Waits until all queues are done. A device that is removed in truth runs nothing any more, so that the program may release everything; the
/// driver beneath this simulation would still use it.
fn finish_work() {
    for queue in report(0, |calls| calls.queues()) {
        // SAFETY: a live queue, which is not released here. These calls come from inside of a hook, so that they are not recorded.
        unsafe {
            let queue = ID3D12CommandQueue::from_raw_borrowed(&queue).expect("a queue");
            let mut device: Option<ID3D12Device> = None;
            queue.GetDevice(&mut device).expect("its device");
            let fence: ID3D12Fence =
                device.expect("its device").CreateFence(0, D3D12_FENCE_FLAG_NONE).expect("a fence");
            queue.Signal(&fence, 1).expect("a signal");
            let began = Instant::now();
            while fence.GetCompletedValue() < 1 && began.elapsed() < LONGEST_WAIT {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    }
}

static REASON: OnceLock<unsafe extern "system" fn(*mut c_void) -> HRESULT> = OnceLock::new();

/// `ID3D12Device::GetDeviceRemovedReason`, which names the removal that is simulated. It cannot fail.
unsafe extern "system" fn removed_reason(this: *mut c_void) -> HRESULT {
    let _guard = HookGuard::enter();
    if enter_removal() {
        return DXGI_ERROR_DEVICE_REMOVED;
    }
    let original = REASON.get().expect("the original function");
    // SAFETY: the caller's own argument, passed on.
    let reason = unsafe { original(this) };
    if reason.is_err() {
        report(0, |calls| calls.recorder.remove_device());
    }
    reason
}

/// Puts the hook into the table of all devices, once.
///
/// # Safety
/// The table is live.
pub(super) unsafe fn install(table: *const ID3D12Device_Vtbl) {
    // SAFETY: the caller's promise.
    unsafe { replace(&raw const (*table).GetDeviceRemovedReason, &REASON, removed_reason) };
}
