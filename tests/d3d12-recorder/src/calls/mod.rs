//! The calls of this process.

mod barriers;
mod device;
mod exports;
mod faults;
mod hooks;
mod list;
mod queue;
mod resource;
mod swapchain;
mod tiles;
mod views;

use std::backtrace::Backtrace;
use std::cell::Cell;
use std::collections::HashMap;
use std::ffi::c_void;
use std::io::Write;

use lock_order::Mutex;
use windows::Win32::Foundation::{CloseHandle, HANDLE, HMODULE, WAIT_OBJECT_0};
use windows::Win32::System::LibraryLoader::{
    GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT, GetModuleFileNameW,
    GetModuleHandleExW,
};
use windows::Win32::System::Threading::WaitForSingleObject;
use windows::core::PCWSTR;

use self::swapchain::SwapChain;
use crate::recorder::{ObjectKind, Recorder};
use crate::rules::Finding;
use crate::timeline::Id;

/// The recorder, and the numbers of live objects.
struct Calls {
    recorder: Recorder,
    /// By address.
    ids: HashMap<usize, Id>,
    /// Live swap chains by address.
    chains: HashMap<usize, SwapChain>,
}

static CALLS: Mutex<Option<Calls>> = Mutex::new(None);

/// An event of our own that a fence sets when it has a value, for which the program has an event as well.
struct FenceEvent {
    event: HANDLE,
    fence: Id,
    value: u64,
}

// SAFETY: a handle is a number.
unsafe impl Send for FenceEvent {}

impl Drop for FenceEvent {
    fn drop(&mut self) {
        // SAFETY: our own event, closed once.
        _ = unsafe { CloseHandle(self.event) };
    }
}

static EVENTS: Mutex<Vec<FenceEvent>> = Mutex::new(Vec::new());

/// Fence values whose events are set.
fn reached() -> Vec<(Id, u64)> {
    // SAFETY: an event that lives during the call.
    let is_set = |one: &mut FenceEvent| unsafe { WaitForSingleObject(one.event, 0) } == WAIT_OBJECT_0;
    EVENTS.lock().extract_if(.., is_set).map(|one| (one.fence, one.value)).collect()
}

thread_local! {
    static IS_REPORTING: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread is in [`report`]: a reference that is released then was taken there, and is not the last one.
fn is_reporting() -> bool {
    IS_REPORTING.get()
}

/// Reports a call of the code at `caller` to the recorder.
fn report<T>(caller: usize, event: impl FnOnce(&mut Calls) -> T) -> T {
    let mut calls = CALLS.lock();
    let calls = calls.get_or_insert_with(|| {
        let mut recorder = Recorder::default();
        recorder.set_completions(reached);
        Calls { recorder, ids: HashMap::new(), chains: HashMap::new() }
    });
    calls.recorder.set_caller(caller);
    IS_REPORTING.set(true);
    let result = event(calls);
    IS_REPORTING.set(false);
    print(calls.recorder.take_findings());
    result
}

/// Reports the objects that are alive; for the end of the process, when no other thread runs.
fn report_live() {
    // A thread that was ended could hold it.
    let Some(mut calls) = CALLS.try_lock() else { return };
    if let Some(calls) = calls.as_mut() {
        calls.recorder.set_caller(0);
        calls.recorder.report_live();
        print(calls.recorder.take_findings());
    }
}

/// Findings, while they are kept for the program.
static KEPT: Mutex<Option<Vec<Finding>>> = Mutex::new(None);

/// Keeps findings from now on.
fn keep_findings() {
    KEPT.lock().get_or_insert_default();
}

/// The kept findings, and no more are kept.
fn take_kept() -> Vec<Finding> {
    KEPT.lock().take().unwrap_or_default()
}

/// Prints findings unless they are kept: each in one piece, since other threads print as well.
fn print(findings: Vec<Finding>) {
    if findings.is_empty() {
        return;
    }
    if let Some(kept) = KEPT.lock().as_mut() {
        return kept.extend(findings);
    }
    for mut finding in findings {
        if let Some(module) = module_of(finding.caller) {
            finding.text = format!("{} [{module}]", finding.text);
        }
        let mut out = std::io::stdout().lock();
        _ = out.write_all(finding.to_json().as_bytes()).and_then(|()| out.flush());
    }
}

/// File name of the module that has a code address.
fn module_of(address: usize) -> Option<String> {
    let mut module = HMODULE::default();
    let flags = GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT;
    // SAFETY: by these flags the address is no string, and a variable that lives during the call.
    unsafe { GetModuleHandleExW(flags, PCWSTR(address as *const u16), &mut module) }.ok()?;
    let mut path = [0; 512];
    // SAFETY: a live module.
    let length = unsafe { GetModuleFileNameW(Some(module), &mut path) } as usize;
    let path = String::from_utf16_lossy(&path[..length]);
    Some(path.rsplit('\\').next()?.to_owned())
}

impl Calls {
    /// Number of the live object at an address.
    fn id(&self, object: *mut c_void) -> Option<Id> {
        self.ids.get(&(object as usize)).copied()
    }

    /// Addresses of live queues.
    fn queues(&self) -> Vec<*mut c_void> {
        let is_queue = |id: &Id| self.recorder.kind(*id) == Some(ObjectKind::Queue);
        self.ids.iter().filter(|(_, id)| is_queue(id)).map(|(address, _)| *address as *mut c_void).collect()
    }

    /// A new object. Findings name the library that made it, if it is not the program itself.
    fn add(&mut self, object: *mut c_void, kind: ObjectKind, label: impl Into<String>) -> Id {
        let mut label = label.into();
        if let Some(library) = module_of(self.recorder.caller()).filter(|module| module.ends_with(".dll")) {
            label = format!("{label} by {library}");
        }
        let id = self.recorder.create(kind, label, Some(Backtrace::force_capture()));
        self.ids.insert(object as usize, id);
        id
    }

    /// Number of an object before its release.
    fn released(&mut self, object: usize, id: Id) {
        if self.is_buffer(object) {
            return;
        }
        if self.ids.get(&object) == Some(&id) {
            self.ids.remove(&object);
        }
        self.recorder.release(id);
    }
}
