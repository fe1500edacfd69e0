//! Mutants of the library's calls: each changes one kind of call, so that it breaks a rule of Direct3D 12.

use std::cell::{Cell, RefCell};
use std::ffi::c_void;
use std::sync::OnceLock;
use std::time::Duration;

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{HRESULT, Interface};
use test_support::d3d12::engine::{closed_list, fence};
use test_support::d3d12::function_tables::replace_function;
use test_support::d3d12::textures::readback;

/// One broken rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mutant {
    UavBarrierDropped,
    UavBarrierOfAnother,
    TransitionDropped,
    TransitionTwice,
    WrongStateBefore,
    WrongStateAfter,
    SameStates,
    CombinedStates,
    StateWithoutFlag,
    StateOfAnotherList,
    NoSuchSubresource,
    SplitNotEnded,
    SplitNotBegun,
    PipelineNotSet,
    RootSignatureNotSet,
    TableNotSet,
    ConstantsNotSet,
    HeapNotSet,
    DescriptorNotWritten,
    DescriptorOfAnotherKind,
    DescriptorOverwritten,
    ViewOutOfBounds,
    WaitDropped,
    WaitForEarlierValue,
    ExecutedTwice,
    NotClosed,
    MappedBehindEnd,
    FenceNotWaited,
    ReleaseDropped,
}
use Mutant::*;

impl Mutant {
    /// Whether its dispatches lack something that drivers need: they get no thread groups then, which the rules do not look at.
    fn is_incomplete(self) -> bool {
        matches!(
            self,
            PipelineNotSet
                | RootSignatureNotSet
                | TableNotSet
                | ConstantsNotSet
                | HeapNotSet
                | DescriptorNotWritten
                | DescriptorOfAnotherKind
                | ViewOutOfBounds
                | CombinedStates
                | StateWithoutFlag
                | StateOfAnotherList
        )
    }
}

thread_local! {
    /// Tests run one at a time, each with all of its calls on its own thread.
    static MUTANT: Cell<Option<Mutant>> = const { Cell::new(None) };
    /// Whether the one call is altered that a mutant alters once.
    static IS_DONE: Cell<bool> = const { Cell::new(false) };
    /// The first view that is written.
    static FIRST: Cell<Option<WrittenView>> = const { Cell::new(None) };
    /// A buffer that the library does not know.
    static OTHER: RefCell<Option<ID3D12Resource>> = const { RefCell::new(None) };
}

/// Arguments of `CreateUnorderedAccessView`; the resources live as long as the frames.
type WrittenView = (*mut c_void, *mut c_void, D3D12_UNORDERED_ACCESS_VIEW_DESC, D3D12_CPU_DESCRIPTOR_HANDLE);

/// A mutant while it lives.
pub(crate) struct Active(());

impl Drop for Active {
    fn drop(&mut self) {
        MUTANT.set(None);
        OTHER.take();
    }
}

/// Alters this thread's calls.
pub(crate) fn activate(gpu: &Gpu, mutant: Option<Mutant>) -> Active {
    OTHER.set(Some(readback(gpu.device(), 4)));
    MUTANT.set(mutant);
    IS_DONE.set(false);
    FIRST.set(None);
    Active(())
}

fn is(mutant: Mutant) -> bool {
    MUTANT.get() == Some(mutant)
}

/// The first time that a mutant asks.
fn once(mutant: Mutant) -> bool {
    is(mutant) && !IS_DONE.replace(true)
}

/// Declares hooks of functions, each with the original by its name in `originals`.
macro_rules! hooks {
    ($($table:ident.$name:ident[$original:ident]($this:ident $(, $argument:ident: $kind:ty)*) $(-> $result:ty)? $body:block)*) => {
        #[allow(non_upper_case_globals, reason = "Direct3D's names")]
        mod originals {
            use super::*;
            $(pub(super) static $name: OnceLock<unsafe extern "system" fn(*mut c_void $(, $kind)*) $(-> $result)?> = OnceLock::new();)*
        }
        #[allow(non_snake_case, reason = "Direct3D's names")]
        mod hooked {
            use super::*;
            $(pub(super) unsafe extern "system" fn $name($this: *mut c_void $(, $argument: $kind)*) $(-> $result)? {
                let $original = *originals::$name.get().expect("the original function");
                // SAFETY: the caller's own arguments, or those altered by a mutant.
                unsafe { $body }
            })*
        }
        /// Puts the hooks, which do nothing without a mutant, into the tables of all devices' objects.
        pub(crate) fn install(gpu: &Gpu) {
            let device = gpu.device();
            let list = closed_list(device);
            let (fence, resource) = (fence(device), readback(device, 4));
            let queue = gpu.frames().d3d12();
            let tables = Tables {
                device: Interface::vtable(device),
                list: Interface::vtable(&list),
                queue: Interface::vtable(queue),
                fence: Interface::vtable(&fence),
                resource: Interface::vtable(&resource),
                unknown: &Interface::vtable(&resource).base__.base__.base__.base__,
            };
            $(replace_function(&raw const tables.$table.$name, &originals::$name, hooked::$name);)*
        }
    };
}

struct Tables<'a> {
    device: &'a ID3D12Device_Vtbl,
    list: &'a ID3D12GraphicsCommandList_Vtbl,
    queue: &'a ID3D12CommandQueue_Vtbl,
    fence: &'a ID3D12Fence_Vtbl,
    resource: &'a ID3D12Resource_Vtbl,
    /// Of resources.
    unknown: &'a cairn::gpu::windows::core::IUnknown_Vtbl,
}

hooks! {
    list.ResourceBarrier[original](this, count: u32, barriers: *const D3D12_RESOURCE_BARRIER) {
        // Read as bits: they hold no references.
        let given = (0..count as usize).map(|i| barriers.add(i).read());
        let altered: Vec<_> = given.flat_map(altered_barriers).collect();
        if !altered.is_empty() {
            original(this, altered.len() as u32, altered.as_ptr());
        }
    }
    list.SetDescriptorHeaps[original](this, count: u32, heaps: *const *mut c_void) {
        if !is(HeapNotSet) {
            original(this, count, heaps);
        }
    }
    list.SetComputeRootSignature[original](this, root: *mut c_void) {
        if !is(RootSignatureNotSet) {
            original(this, root);
        }
    }
    list.SetPipelineState[original](this, pipeline: *mut c_void) {
        if !is(PipelineNotSet) {
            original(this, pipeline);
        }
    }
    list.SetComputeRootDescriptorTable[original](this, parameter: u32, table: D3D12_GPU_DESCRIPTOR_HANDLE) {
        if !is(TableNotSet) && !is(RootSignatureNotSet) {
            original(this, parameter, table);
        }
    }
    list.SetComputeRoot32BitConstants[original](this, parameter: u32, count: u32, values: *const c_void, offset: u32) {
        if !is(ConstantsNotSet) && !is(RootSignatureNotSet) {
            original(this, parameter, count, values, offset);
        }
    }
    list.Dispatch[original](this, x: u32, y: u32, z: u32) {
        match MUTANT.get().is_some_and(Mutant::is_incomplete) {
            true => original(this, 0, 0, 0),
            false => original(this, x, y, z),
        }
    }
    list.Close[original](this) -> HRESULT {
        if once(NotClosed) { HRESULT(0) } else { original(this) }
    }
    device.CreateShaderResourceView[original](
        this, resource: *mut c_void, desc: *const D3D12_SHADER_RESOURCE_VIEW_DESC, at: D3D12_CPU_DESCRIPTOR_HANDLE
    ) {
        if !is(ViewOutOfBounds) {
            return original(this, resource, desc, at);
        }
        let mut desc = desc.read();
        if desc.ViewDimension == D3D12_SRV_DIMENSION_BUFFER {
            desc.Anonymous.Buffer.NumElements += 1 << 20;
        }
        original(this, resource, &raw const desc, at);
    }
    device.CreateUnorderedAccessView[original](
        this, resource: *mut c_void, counter: *mut c_void, desc: *const D3D12_UNORDERED_ACCESS_VIEW_DESC,
        at: D3D12_CPU_DESCRIPTOR_HANDLE
    ) {
        if is(DescriptorNotWritten) {
            return;
        }
        if is(DescriptorOfAnotherKind) {
            let device = ID3D12Device::from_raw_borrowed(&this).expect("a device");
            let empty = D3D12_SHADER_RESOURCE_VIEW_DESC {
                Format: (*desc).Format,
                ViewDimension: D3D12_SRV_DIMENSION_TEXTURE2D,
                Shader4ComponentMapping: D3D12_DEFAULT_SHADER_4_COMPONENT_MAPPING,
                ..Default::default()
            };
            return device.CreateShaderResourceView(None, Some(&empty), at);
        }
        original(this, resource, counter, desc, at);
        if is(DescriptorOverwritten) {
            // With the same view again, so that drivers come to no harm.
            let (resource, counter, desc, at) = FIRST.get().unwrap_or((resource, counter, *desc, at));
            FIRST.set(Some((resource, counter, desc, at)));
            original(this, resource, counter, &raw const desc, at);
        }
    }
    queue.Wait[original](this, fence: *mut c_void, value: u64) -> HRESULT {
        if is(WaitDropped) {
            return HRESULT(0);
        }
        original(this, fence, if is(WaitForEarlierValue) { value.saturating_sub(1) } else { value })
    }
    queue.ExecuteCommandLists[original](this, count: u32, lists: *const *mut c_void) {
        original(this, count, lists);
        if once(ExecutedTwice) {
            original(this, count, lists);
        }
    }
    fence.GetCompletedValue[original](this) -> u64 {
        if is(FenceNotWaited) {
            // The work ends in this time, so that drivers come to no harm, but nothing in the program has seen it.
            std::thread::sleep(Duration::from_millis(200));
            return u64::MAX - 1;
        }
        original(this)
    }
    resource.Map[original](this, subresource: u32, read: *const D3D12_RANGE, data: *mut *mut c_void) -> HRESULT {
        let behind = D3D12_RANGE { Begin: 0, End: usize::MAX };
        original(this, subresource, if once(MappedBehindEnd) { &behind } else { read }, data)
    }
    unknown.Release[original](this) -> u32 {
        if once(ReleaseDropped) { 1 } else { original(this) }
    }
}

/// The barriers that are recorded instead of one.
fn altered_barriers(mut barrier: D3D12_RESOURCE_BARRIER) -> Vec<D3D12_RESOURCE_BARRIER> {
    let Some(mutant) = MUTANT.get() else { return vec![barrier] };
    if barrier.Type == D3D12_RESOURCE_BARRIER_TYPE_UAV {
        return match mutant {
            UavBarrierDropped => Vec::new(),
            UavBarrierOfAnother => {
                // SAFETY: the member of its type; no reference is held.
                let one = unsafe { &mut *barrier.Anonymous.UAV };
                // SAFETY: the same pointer without a reference, as barriers have it.
                one.pResource = OTHER.with_borrow(|other| unsafe { std::mem::transmute_copy(other) });
                vec![barrier]
            }
            _ => vec![barrier],
        };
    }
    if barrier.Type != D3D12_RESOURCE_BARRIER_TYPE_TRANSITION {
        return vec![barrier];
    }
    // SAFETY: the member of its type; its resource lives during the call.
    let one = unsafe { &mut *barrier.Anonymous.Transition };
    let resource = one.pResource.as_ref().expect("a resource");
    // SAFETY: a live resource.
    let desc = unsafe { resource.GetDesc() };
    let is_texture = desc.Dimension == D3D12_RESOURCE_DIMENSION_TEXTURE2D;
    let is_read = one.StateAfter == D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
    match mutant {
        TransitionDropped if is_texture => return Vec::new(),
        TransitionTwice => {
            // SAFETY: bits of a barrier, which holds no reference.
            let again = unsafe { std::ptr::read(&raw const barrier) };
            return vec![again, barrier];
        }
        WrongStateBefore if is_texture => one.StateBefore = D3D12_RESOURCE_STATE_COPY_DEST,
        WrongStateAfter if is_texture && is_read => one.StateAfter = D3D12_RESOURCE_STATE_COPY_SOURCE,
        SameStates => one.StateBefore = one.StateAfter,
        CombinedStates if is_read => one.StateAfter |= D3D12_RESOURCE_STATE_UNORDERED_ACCESS,
        StateWithoutFlag if is_read => one.StateAfter = D3D12_RESOURCE_STATE_DEPTH_WRITE,
        StateOfAnotherList if is_read => one.StateAfter |= D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE,
        NoSuchSubresource => one.Subresource = 64,
        SplitNotEnded => barrier.Flags = D3D12_RESOURCE_BARRIER_FLAG_BEGIN_ONLY,
        SplitNotBegun => barrier.Flags = D3D12_RESOURCE_BARRIER_FLAG_END_ONLY,
        _ => {}
    }
    vec![barrier]
}
