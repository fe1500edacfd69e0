//! Checks that dispatches of a command list are separated by barriers where they use the same memory. Direct3D's functions are replaced by
//! hooks that report this thread's recording to a checker, then call the originals.

use std::cell::RefCell;
use std::collections::HashMap;
use std::ffi::c_void;
use std::sync::OnceLock;

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{HRESULT, Interface};

use super::engine::closed_list;
use super::function_tables::replace_function;

/// Checks one command list at a time.
#[derive(Default)]
pub struct Checker {
    /// Views by the CPU address of their descriptor.
    views: HashMap<usize, View>,
    /// Descriptors that are written consecutively, without a dispatch between them, form one table.
    table_number: u32,
    next_descriptor: usize,
    /// The views of the next dispatch: those of the table at this address.
    bound: Option<usize>,
    step: usize,
    /// Resources that were used as unordered views since their last UAV barrier.
    pending: Vec<usize>,
    /// The states after the recorded barriers.
    states: HashMap<usize, D3D12_RESOURCE_STATES>,
    /// Number of dispatches so far.
    pub dispatches: usize,
    /// Descriptions of missing or wrong barriers.
    pub faults: Vec<String>,
}

#[derive(Clone, Copy)]
struct View {
    resource: usize,
    is_unordered: bool,
    table: u32,
}

impl Checker {
    /// A checker of a heap whose descriptors are `step` bytes apart.
    pub fn new(step: usize) -> Self {
        Self { step, ..Self::default() }
    }

    /// A view of `resource` was written to the descriptor at `address`.
    pub fn describe(&mut self, address: usize, resource: usize, is_unordered: bool) {
        self.table_number += u32::from(address != self.next_descriptor);
        self.next_descriptor = address + self.step;
        self.views.insert(address, View { resource, is_unordered, table: self.table_number });
    }

    /// The table that starts at `address` is bound.
    pub fn bind(&mut self, address: usize) {
        self.bound = Some(address);
    }

    /// A UAV barrier for `resource`, or for all resources.
    pub fn unordered_barrier(&mut self, resource: Option<usize>) {
        self.pending.retain(|used| resource.is_some_and(|resource| resource != *used));
    }

    /// A transition barrier.
    pub fn transition(&mut self, resource: usize, before: D3D12_RESOURCE_STATES, after: D3D12_RESOURCE_STATES) {
        if let Some(known) = self.states.insert(resource, after).filter(|known| *known != before) {
            self.faults.push(format!("a barrier from {before:?} where the resource is in {known:?}"));
        }
        self.unordered_barrier(Some(resource));
    }

    /// A dispatch with the bound table.
    pub fn dispatch(&mut self) {
        self.dispatches += 1;
        let number = self.dispatches;
        let Some(first) = self.bound else { return self.faults.push(format!("dispatch {number} has no table")) };
        let Some(table) = self.views.get(&first).map(|view| view.table) else {
            return self.faults.push(format!("dispatch {number} has a table without views"));
        };
        let addresses = (0..).map(|i| first + i * self.step);
        let views = addresses.map_while(|at| self.views.get(&at).filter(|view| view.table == table).copied());
        let views: Vec<View> = views.collect();
        for view in &views {
            if self.pending.contains(&view.resource) {
                self.faults.push(format!("dispatch {number} uses what an earlier one may still write"));
            }
            let needed = match view.is_unordered {
                true => D3D12_RESOURCE_STATE_UNORDERED_ACCESS,
                false => D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE,
            };
            if let Some(state) = self.states.get(&view.resource).filter(|state| !state.contains(needed)) {
                self.faults.push(format!("dispatch {number} needs a resource in {needed:?} that is in {state:?}"));
            }
        }
        self.pending.extend(views.iter().filter(|view| view.is_unordered).map(|view| view.resource));
        // Later descriptors belong to another table.
        self.next_descriptor = 0;
    }

    /// The list is closed: the next one starts without state.
    pub fn close(&mut self) {
        self.pending.clear();
        self.states.clear();
        self.bound = None;
    }
}

thread_local! {
    static CHECKER: RefCell<Option<Checker>> = const { RefCell::new(None) };
    /// Start addresses of the bound descriptor heap, for the processor and for shaders.
    static HEAP: RefCell<(usize, u64)> = const { RefCell::new((0, 0)) };
}

/// The checker after all that this thread records during `work` into lists of devices like `device`.
pub fn checked(device: &ID3D12Device, work: impl FnOnce()) -> Checker {
    install(device);
    // SAFETY: a live device.
    let step = unsafe { device.GetDescriptorHandleIncrementSize(D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV) };
    CHECKER.with_borrow_mut(|checker| *checker = Some(Checker::new(step as usize)));
    work();
    CHECKER.take().expect("it was put there above")
}

fn report(event: impl FnOnce(&mut Checker)) {
    CHECKER.with_borrow_mut(|checker| {
        if let Some(checker) = checker {
            event(checker);
        }
    });
}

/// Replaces functions without a result: each reports its call, then calls the original.
macro_rules! reporting {
    ($($table:ident.$name:ident($($argument:ident: $kind:ty),*) -> $result:ty { $report:expr })*) => {
        #[allow(non_upper_case_globals, reason = "Direct3D's names")]
        mod originals {
            use super::*;
            $(pub(super) static $name: OnceLock<unsafe extern "system" fn(*mut c_void, $($kind),*) -> $result> = OnceLock::new();)*
        }
        #[allow(non_snake_case, reason = "Direct3D's names")]
        mod hooks {
            use super::*;
            $(pub(super) unsafe extern "system" fn $name(this: *mut c_void, $($argument: $kind),*) -> $result {
                $report;
                let original = originals::$name.get().expect("the original function");
                // SAFETY: the caller's own arguments, passed on.
                unsafe { original(this, $($argument),*) }
            })*
        }
        fn install(device: &ID3D12Device) {
            let list = closed_list(device);
            let (device, list) = (Interface::vtable(device), Interface::vtable(&list));
            $(replace_function(&raw const $table!(device, list).$name, &originals::$name, hooks::$name);)*
        }
    };
}

macro_rules! device {
    ($device:ident, $list:ident) => {
        $device
    };
}
macro_rules! list {
    ($device:ident, $list:ident) => {
        $list
    };
}

reporting! {
    device.CreateShaderResourceView(
        resource: *mut c_void, wanted: *const D3D12_SHADER_RESOURCE_VIEW_DESC, at: D3D12_CPU_DESCRIPTOR_HANDLE
    ) -> () { report(|checker| checker.describe(at.ptr, resource as usize, false)) }
    device.CreateUnorderedAccessView(
        resource: *mut c_void, counter: *mut c_void, wanted: *const D3D12_UNORDERED_ACCESS_VIEW_DESC,
        at: D3D12_CPU_DESCRIPTOR_HANDLE
    ) -> () { report(|checker| checker.describe(at.ptr, resource as usize, true)) }
    list.SetDescriptorHeaps(count: u32, heaps: *const *mut c_void) -> () {
        // SAFETY: the caller's own heaps, which are live.
        unsafe { note_heaps(count, heaps) }
    }
    list.SetComputeRootDescriptorTable(parameter: u32, table: D3D12_GPU_DESCRIPTOR_HANDLE) -> () {
        report(|checker| {
            let (processor, shaders) = HEAP.with_borrow(|heap| *heap);
            checker.bind(processor + (table.ptr - shaders) as usize);
        })
    }
    list.ResourceBarrier(count: u32, barriers: *const D3D12_RESOURCE_BARRIER) -> () {
        // SAFETY: the caller's `count` barriers.
        unsafe { note_barriers(std::slice::from_raw_parts(barriers, count as usize)) }
    }
    list.Dispatch(x: u32, y: u32, z: u32) -> () { report(Checker::dispatch) }
    list.Close() -> HRESULT { report(Checker::close) }
}

/// # Safety
/// `count` live heaps.
unsafe fn note_heaps(count: u32, heaps: *const *mut c_void) {
    for i in 0..count as usize {
        // SAFETY: the caller's promise; nothing is released.
        let heap = unsafe { ID3D12DescriptorHeap::from_raw_borrowed(&*heaps.add(i)) }.expect("a heap");
        // SAFETY: a live heap.
        if unsafe { heap.GetDesc() }.Type == D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV {
            // SAFETY: a live heap that shaders see.
            let starts = unsafe {
                (heap.GetCPUDescriptorHandleForHeapStart().ptr, heap.GetGPUDescriptorHandleForHeapStart().ptr)
            };
            HEAP.with_borrow_mut(|heap| *heap = starts);
        }
    }
}

/// # Safety
/// Each barrier's union member matches its type.
unsafe fn note_barriers(barriers: &[D3D12_RESOURCE_BARRIER]) {
    for barrier in barriers {
        match barrier.Type {
            D3D12_RESOURCE_BARRIER_TYPE_UAV => {
                // SAFETY: the caller's promise.
                let resource = unsafe { &barrier.Anonymous.UAV.pResource };
                let resource = resource.as_ref().map(|resource| resource.as_raw() as usize);
                report(|checker| checker.unordered_barrier(resource));
            }
            D3D12_RESOURCE_BARRIER_TYPE_TRANSITION => {
                // SAFETY: the caller's promise.
                let one = unsafe { &barrier.Anonymous.Transition };
                let resource = one.pResource.as_ref().expect("a resource").as_raw() as usize;
                report(|checker| checker.transition(resource, one.StateBefore, one.StateAfter));
            }
            _ => {}
        }
    }
}
