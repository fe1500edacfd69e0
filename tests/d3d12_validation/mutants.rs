//! Mutants: each changes one kind of call that the library makes to Direct3D 12, so that the call breaks one rule.

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::OnceLock;

use cairn::framegen::shader::DESCRIPTORS;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use test_support::d3d12::engine::closed_list;
use test_support::d3d12::function_tables::replace_function;

/// The variable that names a mutant.
const VARIABLE: &str = "CAIRN_VALIDATION_MUTANT";

/// Descriptors of a frame, which resizes a picture and generates a frame.
pub(crate) const DESCRIPTORS_OF_FRAME: u32 = DESCRIPTORS + 2;

/// One broken rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mutant {
    /// No UAV barrier is recorded.
    UavBarrierDropped,
    /// Textures that a dispatch reads are put into the state of copies.
    WrongState,
    /// No barrier is recorded between the dispatch that writes a texture and one that reads it.
    ReadWhileWritten,
    /// Every frame writes its descriptors over those of the first, which is in flight.
    DescriptorOverwritten,
    /// Views of buffers end behind the buffer.
    ViewOutOfBounds,
    /// Shaders access buffers outside of their views, which have one element.
    AccessOutOfBounds,
}

const MUTANTS: [(&str, Mutant); 6] = [
    ("uav-barrier-dropped", Mutant::UavBarrierDropped),
    ("wrong-state", Mutant::WrongState),
    ("read-while-written", Mutant::ReadWhileWritten),
    ("descriptor-overwritten", Mutant::DescriptorOverwritten),
    ("view-out-of-bounds", Mutant::ViewOutOfBounds),
    ("access-out-of-bounds", Mutant::AccessOutOfBounds),
];

impl Mutant {
    /// The mutant that the variable names, if it is set.
    pub(crate) fn from_environment() -> Option<Self> {
        let name = std::env::var(VARIABLE).ok()?;
        let known = MUTANTS.iter().find(|(known, _)| *known == name);
        Some(known.unwrap_or_else(|| panic!("{VARIABLE} names {name:?}, which is none")).1)
    }
}

static MUTANT: OnceLock<Mutant> = OnceLock::new();

thread_local! {
    /// Start addresses of the bound descriptor heap, for the processor and for shaders.
    static HEAP: Cell<(usize, u64)> = const { Cell::new((0, 0)) };
    /// Bytes of the descriptors of one frame.
    static FRAME: Cell<usize> = const { Cell::new(0) };
}

fn is(mutant: Mutant) -> bool {
    MUTANT.get() == Some(&mutant)
}

/// Alters the calls of this process from now on.
pub(crate) fn install(mutant: Mutant, gpu: &Gpu) {
    MUTANT.set(mutant).expect("one mutant per process");
    let device = gpu.device();
    // SAFETY: a live device.
    let step = unsafe { device.GetDescriptorHandleIncrementSize(D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV) };
    FRAME.set((step * DESCRIPTORS_OF_FRAME) as usize);
    let list = closed_list(device);
    let (device, list) = (Interface::vtable(device), Interface::vtable(&list));
    replace_function(&raw const list.ResourceBarrier, &RESOURCE_BARRIER, resource_barrier);
    replace_function(&raw const list.SetDescriptorHeaps, &SET_HEAPS, set_heaps);
    replace_function(&raw const list.SetComputeRootDescriptorTable, &SET_TABLE, set_table);
    replace_function(&raw const device.CreateShaderResourceView, &CREATE_INPUT, create_input);
    replace_function(&raw const device.CreateUnorderedAccessView, &CREATE_OUTPUT, create_output);
}

type ResourceBarrier = unsafe extern "system" fn(*mut c_void, u32, *const D3D12_RESOURCE_BARRIER);
type SetHeaps = unsafe extern "system" fn(*mut c_void, u32, *const *mut c_void);
type SetTable = unsafe extern "system" fn(*mut c_void, u32, D3D12_GPU_DESCRIPTOR_HANDLE);
type CreateInput = unsafe extern "system" fn(
    *mut c_void,
    *mut c_void,
    *const D3D12_SHADER_RESOURCE_VIEW_DESC,
    D3D12_CPU_DESCRIPTOR_HANDLE,
);
type CreateOutput = unsafe extern "system" fn(
    *mut c_void,
    *mut c_void,
    *mut c_void,
    *const D3D12_UNORDERED_ACCESS_VIEW_DESC,
    D3D12_CPU_DESCRIPTOR_HANDLE,
);

static RESOURCE_BARRIER: OnceLock<ResourceBarrier> = OnceLock::new();
static SET_HEAPS: OnceLock<SetHeaps> = OnceLock::new();
static SET_TABLE: OnceLock<SetTable> = OnceLock::new();
static CREATE_INPUT: OnceLock<CreateInput> = OnceLock::new();
static CREATE_OUTPUT: OnceLock<CreateOutput> = OnceLock::new();

unsafe extern "system" fn resource_barrier(this: *mut c_void, count: u32, barriers: *const D3D12_RESOURCE_BARRIER) {
    // SAFETY: the caller's barriers, read as bits: they hold no references.
    let given = (0..count as usize).map(|i| unsafe { barriers.add(i).read() });
    let altered: Vec<_> = given.filter_map(altered_barrier).collect();
    if !altered.is_empty() {
        let original = RESOURCE_BARRIER.get().expect("the original function");
        // SAFETY: the caller's list, and barriers that live during the call.
        unsafe { original(this, altered.len() as u32, altered.as_ptr()) };
    }
}

/// The barrier that is recorded instead, if any.
fn altered_barrier(mut barrier: D3D12_RESOURCE_BARRIER) -> Option<D3D12_RESOURCE_BARRIER> {
    if barrier.Type == D3D12_RESOURCE_BARRIER_TYPE_UAV {
        return (!is(Mutant::UavBarrierDropped)).then_some(barrier);
    }
    if barrier.Type != D3D12_RESOURCE_BARRIER_TYPE_TRANSITION {
        return Some(barrier);
    }
    // SAFETY: the member of its type; its resource lives during the call.
    let one = unsafe { &mut *barrier.Anonymous.Transition };
    // SAFETY: a live resource.
    let is_texture = one
        .pResource
        .as_ref()
        .is_some_and(|resource| unsafe { resource.GetDesc() }.Dimension == D3D12_RESOURCE_DIMENSION_TEXTURE2D);
    let is_read = one.StateAfter == D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
    if is_texture && is_read && is(Mutant::WrongState) {
        one.StateAfter = D3D12_RESOURCE_STATE_COPY_SOURCE;
    }
    let is_written = one.StateBefore == D3D12_RESOURCE_STATE_UNORDERED_ACCESS;
    (!(is_texture && is_written && is_read && is(Mutant::ReadWhileWritten))).then_some(barrier)
}

unsafe extern "system" fn set_heaps(this: *mut c_void, count: u32, heaps: *const *mut c_void) {
    // SAFETY: the caller's heaps; nothing is released.
    let heap = unsafe { ID3D12DescriptorHeap::from_raw_borrowed(&*heaps) }.expect("a heap");
    // SAFETY: a live heap that shaders see.
    HEAP.set(unsafe { (heap.GetCPUDescriptorHandleForHeapStart().ptr, heap.GetGPUDescriptorHandleForHeapStart().ptr) });
    let original = SET_HEAPS.get().expect("the original function");
    // SAFETY: the caller's own arguments.
    unsafe { original(this, count, heaps) };
}

unsafe extern "system" fn set_table(this: *mut c_void, parameter: u32, mut table: D3D12_GPU_DESCRIPTOR_HANDLE) {
    if is(Mutant::DescriptorOverwritten) {
        let start = HEAP.get().1;
        table.ptr = start + (table.ptr - start) % FRAME.get() as u64;
    }
    let original = SET_TABLE.get().expect("the original function");
    // SAFETY: the caller's own arguments, or a table of the same heap.
    unsafe { original(this, parameter, table) };
}

/// The descriptor that is written instead: the same one of the first frame.
fn altered_descriptor(mut at: D3D12_CPU_DESCRIPTOR_HANDLE) -> D3D12_CPU_DESCRIPTOR_HANDLE {
    if is(Mutant::DescriptorOverwritten) {
        let start = HEAP.get().0;
        at.ptr = start + (at.ptr - start) % FRAME.get();
    }
    at
}

unsafe extern "system" fn create_input(
    this: *mut c_void,
    resource: *mut c_void,
    desc: *const D3D12_SHADER_RESOURCE_VIEW_DESC,
    at: D3D12_CPU_DESCRIPTOR_HANDLE,
) {
    // SAFETY: the library gives a description for every view.
    let mut wanted = unsafe { desc.read() };
    if wanted.ViewDimension == D3D12_SRV_DIMENSION_BUFFER {
        // SAFETY: the member of its dimension.
        let buffer = unsafe { &mut wanted.Anonymous.Buffer };
        match MUTANT.get() {
            Some(Mutant::ViewOutOfBounds) => buffer.NumElements += 1 << 20,
            Some(Mutant::AccessOutOfBounds) => buffer.NumElements = 1,
            _ => {}
        }
    }
    let original = CREATE_INPUT.get().expect("the original function");
    // SAFETY: the caller's own arguments, a smaller view, or a descriptor of the same heap.
    unsafe { original(this, resource, &raw const wanted, altered_descriptor(at)) };
}

unsafe extern "system" fn create_output(
    this: *mut c_void,
    resource: *mut c_void,
    counter: *mut c_void,
    desc: *const D3D12_UNORDERED_ACCESS_VIEW_DESC,
    at: D3D12_CPU_DESCRIPTOR_HANDLE,
) {
    let original = CREATE_OUTPUT.get().expect("the original function");
    // SAFETY: the caller's own arguments, or a descriptor of the same heap.
    unsafe { original(this, resource, counter, desc, altered_descriptor(at)) };
}
