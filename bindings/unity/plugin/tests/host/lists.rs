//! Checks recorded command lists and their submission against Direct3D's rules: textures are in the states that commands require, submitted
//! lists are closed, allocators are not reset and textures not freed while the queue uses them. Direct3D itself checks these only in its
//! debug layer; without it the behaviour is undefined.

use std::collections::BTreeMap;
use std::ffi::c_void;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock};

use cairn::gpu::windows::Win32::Foundation::{E_FAIL, E_NOINTERFACE, S_OK};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{GUID, HRESULT, IUnknown, IUnknown_Vtbl, Interface};

use test_support::d3d12::function_tables::replace_function;
use test_support::d3d12::textures::Recording;

/// Objects are identified by their addresses.
type Address = usize;

/// Commands that are checked.
enum Command {
    Barrier { texture: Address, before: D3D12_RESOURCE_STATES, after: D3D12_RESOURCE_STATES },
    Copy { to: Address, from: Address },
    Close,
}

#[derive(Default)]
struct Tracker {
    /// Unity's frame fence, which says what the queue has executed.
    fence: Option<ID3D12Fence>,
    commands: BTreeMap<Address, Vec<Command>>,
    /// Allocator of each list.
    allocators: BTreeMap<Address, Address>,
    /// Fence value at which the last list of each allocator has executed.
    busy: BTreeMap<Address, u64>,
    /// State of each texture after everything that was submitted. Textures that are not listed are in COMMON.
    states: BTreeMap<Address, D3D12_RESOURCE_STATES>,
    /// Textures that lists copy from, with the fence value until which they must live.
    used: BTreeMap<Address, u64>,
    /// Number of these textures that were freed.
    freed: usize,
    violations: Vec<String>,
}

static TRACKER: Mutex<Option<Tracker>> = Mutex::new(None);

fn tracker() -> MutexGuard<'static, Option<Tracker>> {
    TRACKER.lock().unwrap_or_else(|e| e.into_inner())
}

/// Calls `work` with the recorded state; does nothing while nothing is checked.
fn with(work: impl FnOnce(&mut Tracker)) {
    if let Some(tracker) = tracker().as_mut() {
        work(tracker);
    }
}

impl Tracker {
    fn has_run(&self, value: u64) -> bool {
        // SAFETY: a live fence.
        self.fence.as_ref().is_none_or(|fence| unsafe { fence.GetCompletedValue() } >= value)
    }

    fn state_of(&self, texture: Address) -> D3D12_RESOURCE_STATES {
        self.states.get(&texture).copied().unwrap_or(D3D12_RESOURCE_STATE_COMMON)
    }

    fn expect(&mut self, what: &str, texture: Address, state: D3D12_RESOURCE_STATES) {
        let found = self.state_of(texture);
        if found != state {
            self.violations.push(format!("{what}: a texture is in {found:?}, not {state:?}"));
        }
    }
}

static THEIR_BARRIER: OnceLock<unsafe extern "system" fn(*mut c_void, u32, *const D3D12_RESOURCE_BARRIER)> =
    OnceLock::new();
static THEIR_COPY: OnceLock<unsafe extern "system" fn(*mut c_void, *mut c_void, *mut c_void)> = OnceLock::new();
static THEIR_CLOSE: OnceLock<unsafe extern "system" fn(*mut c_void) -> HRESULT> = OnceLock::new();
static THEIR_RESET: OnceLock<unsafe extern "system" fn(*mut c_void, *mut c_void, *mut c_void) -> HRESULT> =
    OnceLock::new();
static THEIR_FREEING: OnceLock<unsafe extern "system" fn(*mut c_void) -> HRESULT> = OnceLock::new();

fn record(list: *mut c_void, command: Command) {
    with(|tracker| tracker.commands.entry(list.addr()).or_default().push(command));
}

unsafe extern "system" fn our_barrier(this: *mut c_void, count: u32, barriers: *const D3D12_RESOURCE_BARRIER) {
    for place in 0..count as usize {
        // SAFETY: the array has the stated number of elements.
        let barrier = unsafe { &*barriers.add(place) };
        if barrier.Type == D3D12_RESOURCE_BARRIER_TYPE_TRANSITION {
            // SAFETY: the kind says which it is.
            let told = unsafe { &barrier.Anonymous.Transition };
            let texture = told.pResource.as_ref().map_or(0, |resource| resource.as_raw().addr());
            record(this, Command::Barrier { texture, before: told.StateBefore, after: told.StateAfter });
        }
    }
    let theirs = THEIR_BARRIER.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, handed on.
    unsafe { theirs(this, count, barriers) }
}

unsafe extern "system" fn our_copy(this: *mut c_void, to: *mut c_void, from: *mut c_void) {
    record(this, Command::Copy { to: to.addr(), from: from.addr() });
    // SAFETY: a live resource, by the caller's promise.
    if let Some(from) = unsafe { ID3D12Resource::from_raw_borrowed(&from) } {
        DestructionObserver::attach(from);
    }
    let theirs = THEIR_COPY.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, handed on.
    unsafe { theirs(this, to, from) }
}

unsafe extern "system" fn our_close(this: *mut c_void) -> HRESULT {
    record(this, Command::Close);
    let theirs = THEIR_CLOSE.get().expect("what it replaces");
    // SAFETY: the caller's own list.
    unsafe { theirs(this) }
}

unsafe extern "system" fn our_reset(this: *mut c_void, allocator: *mut c_void, pipeline: *mut c_void) -> HRESULT {
    with(|tracker| {
        tracker.commands.remove(&this.addr());
        tracker.allocators.insert(this.addr(), allocator.addr());
    });
    let theirs = THEIR_RESET.get().expect("what it replaces");
    // SAFETY: the caller's own arguments, handed on.
    unsafe { theirs(this, allocator, pipeline) }
}

unsafe extern "system" fn our_freeing(this: *mut c_void) -> HRESULT {
    let mut has_run = true;
    with(|tracker| {
        has_run = tracker.has_run(tracker.busy.get(&this.addr()).copied().unwrap_or(0));
        if !has_run {
            tracker.violations.push("an allocator is reset whose list has not run".to_owned());
        }
    });
    if !has_run {
        // Really resetting it would crash the process.
        return E_FAIL;
    }
    let theirs = THEIR_FREEING.get().expect("what it replaces");
    // SAFETY: the caller's own allocator.
    unsafe { theirs(this) }
}

/// Starts to check the lists of a device. A later call starts again from nothing.
pub(super) fn begin(device: &ID3D12Device, fence: &ID3D12Fence) {
    let kind = D3D12_COMMAND_LIST_TYPE_DIRECT;
    let any = Recording::new(device, kind);
    let table = Interface::vtable(any.list());
    replace_function(&raw const table.ResourceBarrier, &THEIR_BARRIER, our_barrier);
    replace_function(&raw const table.CopyResource, &THEIR_COPY, our_copy);
    replace_function(&raw const table.Close, &THEIR_CLOSE, our_close);
    replace_function(&raw const table.Reset, &THEIR_RESET, our_reset);
    // SAFETY: a live device.
    let allocator: ID3D12CommandAllocator = unsafe { device.CreateCommandAllocator(kind) }.expect("an allocator");
    let table = Interface::vtable(&allocator);
    replace_function(&raw const table.Reset, &THEIR_FREEING, our_freeing);
    *tracker() = Some(Tracker { fence: Some(fence.clone()), ..Tracker::default() });
}

/// Stops the checks.
pub(super) fn end() {
    let left = tracker().take();
    drop(left);
}

/// Registers a new list and forgets an earlier list of the same address.
pub(super) fn register(list: &ID3D12GraphicsCommandList) {
    with(|tracker| _ = tracker.commands.remove(&list.as_raw().addr()));
}

/// Sets the state of a texture.
pub(super) fn set_state(texture: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
    with(|tracker| _ = tracker.states.insert(texture.as_raw().addr(), state));
}

/// The list was passed to Unity. It executes before the fence reaches `value`.
pub(super) fn passed_to_unity(list: &ID3D12GraphicsCommandList, value: u64) {
    recorded(list, value);
    with(|tracker| {
        let address = list.as_raw().addr();
        if !matches!(tracker.commands.get(&address).and_then(|commands| commands.last()), Some(Command::Close)) {
            tracker.violations.push("a list is handed over that is not closed".to_owned());
        }
        if let Some(allocator) = tracker.allocators.get(&address) {
            tracker.busy.insert(*allocator, value);
        }
    });
}

/// The list was recorded. It executes before the fence reaches `value`: its copy sources are in use until then.
pub(super) fn recorded(list: &ID3D12GraphicsCommandList, value: u64) {
    with(|tracker| {
        for command in tracker.commands.get(&list.as_raw().addr()).into_iter().flatten() {
            if let Command::Copy { from, .. } = command {
                tracker.used.insert(*from, value);
            }
        }
    });
}

/// The list was submitted to the queue after all others. It executes before the fence reaches `value`.
pub(super) fn submitted(list: &ID3D12CommandList, value: u64) {
    with(|tracker| {
        for command in tracker.commands.remove(&list.as_raw().addr()).unwrap_or_default() {
            match command {
                Command::Barrier { texture, before, after } => {
                    tracker.expect("a barrier", texture, before);
                    tracker.states.insert(texture, after);
                }
                Command::Copy { to, from } => {
                    tracker.expect("the copy's destination", to, D3D12_RESOURCE_STATE_COPY_DEST);
                    tracker.expect("the copy's source", from, D3D12_RESOURCE_STATE_COPY_SOURCE);
                    let until = tracker.used.entry(from).or_default();
                    *until = value.max(*until);
                }
                Command::Close => {}
            }
        }
    });
}

/// Compares the state that Unity assumes for a texture with its real state.
pub(super) fn compare(texture: Address, believed: D3D12_RESOURCE_STATES) {
    with(|tracker| tracker.expect("what Unity was told", texture, believed));
}

/// Removes the destruction observer from a texture, as if the texture were freed.
pub(super) fn detach_observer(texture: &ID3D12Resource) {
    // SAFETY: a live texture.
    unsafe { texture.SetPrivateDataInterface(&NAME, None) }.expect("a texture that releases it");
}

/// Number of textures that lists copied from and that were freed.
pub(super) fn freed() -> usize {
    tracker().as_ref().map_or(0, |tracker| tracker.freed)
}

/// Takes the violations found since the last call.
pub(super) fn take_violations() -> Vec<String> {
    tracker().as_mut().map(|tracker| std::mem::take(&mut tracker.violations)).unwrap_or_default()
}

/// An object in a texture's private data; Direct3D releases it when the texture is freed.
#[repr(C)]
struct DestructionObserver {
    table: &'static IUnknown_Vtbl,
    count: AtomicU32,
    of: Address,
}

static OBSERVER_TABLE: IUnknown_Vtbl = IUnknown_Vtbl { QueryInterface: query, AddRef: add, Release: release };
/// GUID of the private data; our own.
const NAME: GUID = GUID::from_u128(0x6b1c_40de_8a52_4f0e_9d07_31c2_5be4_70aa);

unsafe extern "system" fn query(this: *mut c_void, id: *const GUID, to: *mut *mut c_void) -> HRESULT {
    // SAFETY: the caller's promise.
    if unsafe { *id } != IUnknown::IID {
        return E_NOINTERFACE;
    }
    // SAFETY: as above.
    unsafe { add(this) };
    // SAFETY: as above.
    unsafe { to.write(this) };
    S_OK
}

unsafe extern "system" fn add(this: *mut c_void) -> u32 {
    // SAFETY: a live destruction observer.
    unsafe { &*this.cast::<DestructionObserver>() }.count.fetch_add(1, Ordering::SeqCst) + 1
}

unsafe extern "system" fn release(this: *mut c_void) -> u32 {
    // SAFETY: a live destruction observer.
    let left = unsafe { &*this.cast::<DestructionObserver>() }.count.fetch_sub(1, Ordering::SeqCst) - 1;
    if left == 0 {
        // SAFETY: made by a `Box`, and this was the last reference.
        let observer = unsafe { Box::from_raw(this.cast::<DestructionObserver>()) };
        with(|tracker| {
            if let Some(until) = tracker.used.remove(&observer.of) {
                tracker.freed += 1;
                if !tracker.has_run(until) {
                    tracker.violations.push("a texture is freed that the queue still uses".to_owned());
                }
            }
            tracker.states.remove(&observer.of);
        });
    }
    left
}

impl DestructionObserver {
    /// Puts such an object into a texture, unless it has one.
    fn attach(to: &ID3D12Resource) {
        let mut size = 0;
        // SAFETY: a live texture; it is asked for the size alone.
        if unsafe { to.GetPrivateData(&NAME, &mut size, None) }.is_ok() && size > 0 {
            return;
        }
        let observer = Box::new(Self { table: &OBSERVER_TABLE, count: AtomicU32::new(1), of: to.as_raw().addr() });
        _ = observer.table;
        // SAFETY: an object with that table, whose one reference is used once.
        let observer = unsafe { IUnknown::from_raw(Box::into_raw(observer).cast()) };
        // SAFETY: a live texture and a live object, to which the texture adds a reference.
        unsafe { to.SetPrivateDataInterface(&NAME, &observer) }.expect("a texture that holds it");
    }
}
