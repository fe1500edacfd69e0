//! A stand-in for Unity over a real device: the registry, one version of the Direct3D 12 interface, and a frame loop with a render thread and a
//! submission thread. It is as strict as the interface allows: it notes each rule of the interface that the plugin breaks, and tests check that
//! list. The rules of Direct3D are checked by the recorder where it is this program's `d3d12.dll`, as in the runners `lab`, `ffx` and `recorder`.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::ffi::{c_int, c_void};
use std::ptr::null;
use std::sync::Mutex;

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use cairn_unity::interfaces::Guid;

use super::plugin::{self, UnityPluginLoad, UnityPluginUnload};
use test_support::d3d12::engine::Engine;
use test_support::d3d12::recorder;
use test_support::d3d12::textures::{self, Recording};

/// The first number of the plugin's events.
const FIRST: c_int = 4711;
const RESERVED: c_int = 2;

/// A process has one Unity, whose functions take no object.
static UNITY: Mutex<Option<Unity>> = Mutex::new(None);
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// The context in which the plugin is called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CallContext {
    /// By the game, whose threads may not call Unity's functions.
    Game,
    /// While Unity loads the plugin, or its device appears or disappears.
    Starting,
    /// In an event on the render thread, where Unity records.
    Recording,
    /// In an event on the submission thread, where the queue may be used.
    Submitting,
    /// In an event on the render thread without a configuration.
    Unconfigured,
}

/// All contexts of events.
const EVENTS: [CallContext; 3] = [CallContext::Recording, CallContext::Submitting, CallContext::Unconfigured];
/// All contexts in which Unity calls the plugin.
const CALLED: [CallContext; 4] =
    [CallContext::Starting, CallContext::Recording, CallContext::Submitting, CallContext::Unconfigured];

thread_local! {
    static PLACE: Cell<CallContext> = const { Cell::new(CallContext::Game) };
}

/// Runs `work` as if Unity called it.
fn at<T>(place: CallContext, work: impl FnOnce() -> T) -> T {
    let before = PLACE.replace(place);
    let done = work();
    PLACE.set(before);
    done
}

/// Runs `work` on a thread of Unity's.
fn on_thread(place: CallContext, work: impl FnOnce() + Send) {
    std::thread::scope(|scope| {
        if let Err(panic) = scope.spawn(|| at(place, work)).join() {
            std::panic::resume_unwind(panic);
        }
    });
}

/// Jobs of the submission thread, done in order.
enum Job {
    /// Submits a closed list to the queue.
    List(ID3D12CommandList),
    /// Calls the plugin, with an event's number and data.
    Event(c_int, usize),
    /// Ends a frame: signals the frame fence with the value.
    Signal(u64),
}

struct Unity {
    engine: Engine,
    version: u32,
    fence: ID3D12Fence,
    /// Value of the fence at the end of the current frame.
    next: u64,
    /// Frames that have ended and whose lists were submitted to the queue.
    submitted: u64,
    /// The list that is being recorded.
    open: Option<Recording>,
    pending: VecDeque<Job>,
    /// Whether the submission thread calls the plugin only at the end of a frame, after the frame's lists.
    lags: bool,
    /// Number of frames by which the submission of lists lags. Events that do not flush do not wait for it.
    delay: u64,
    /// Whether no list is open in events.
    has_no_list: bool,
    /// By how many frames the values of the frame fence that the plugin gets are too low.
    early: u64,
    /// Lists in flight, with everything that they use.
    alive: Vec<Recording>,
    textures: Vec<ID3D12Resource>,
    /// States that Unity assumes for its textures.
    states: BTreeMap<usize, D3D12_RESOURCE_STATES>,
    configured: BTreeMap<c_int, [u32; 3]>,
    device_event: Option<unsafe extern "system" fn(c_int)>,
    calls: BTreeMap<&'static str, u32>,
    wrong: Vec<String>,
}

/// Calls `work` with the running Unity.
fn with<T>(work: impl FnOnce(&mut Unity) -> T) -> T {
    work(UNITY.lock().unwrap_or_else(|e| e.into_inner()).as_mut().expect("a Unity"))
}

impl Unity {
    /// Counts a call of a function. Records a violation if it may not be called in the current context.
    fn called(&mut self, name: &'static str, places: &[CallContext]) {
        *self.calls.entry(name).or_default() += 1;
        let place = PLACE.get();
        if !places.contains(&place) {
            self.wrong.push(format!("{name} is called where it must not be: {place:?}"));
        }
    }

    /// A texture that the plugin passes, if it is one of Unity's.
    fn own(&mut self, resource: *mut c_void, name: &str) -> Option<ID3D12Resource> {
        // SAFETY: null or a live texture.
        let texture = unsafe { ID3D12Resource::from_raw_borrowed(&resource) }.cloned();
        if texture.is_none() || !self.states.contains_key(&resource.addr()) {
            self.wrong.push(format!("{name} is called with a texture that is not Unity's"));
            return None;
        }
        texture
    }

    /// The value that the plugin gets for the end of the current frame.
    fn told_value(&self) -> u64 {
        self.next.saturating_sub(self.early).max(1)
    }

    /// The list that Unity is recording.
    fn list(&mut self) -> &Recording {
        self.open.get_or_insert_with(|| Recording::on(&self.engine.device, &self.engine.direct))
    }

    fn state_of(&self, resource: &ID3D12Resource) -> D3D12_RESOURCE_STATES {
        *self.states.get(&resource.as_raw().addr()).expect("a texture of Unity's")
    }

    /// Transitions a texture of Unity's into a state, in the open list.
    fn transition(&mut self, resource: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        let before = self.state_of(resource);
        self.list().barrier(resource, before, state);
        self.states.insert(resource.as_raw().addr(), state);
    }

    /// Closes the open list and queues it for submission.
    fn close(&mut self) {
        let Some(open) = self.open.take() else { return };
        // SAFETY: an open list.
        unsafe { open.list().Close() }.expect("a list that can be closed");
        self.pending.push_back(Job::List(open.list().cast().expect("a command list")));
        self.alive.push(open);
    }
}

/// Has the submission thread do its jobs, except those of the last `delay` frames.
fn submit(delay: u64) {
    loop {
        let is_due = |unity: &Unity| unity.next - 1 - unity.submitted > delay;
        match with(|unity| is_due(unity).then(|| unity.pending.pop_front()).flatten()) {
            Some(Job::List(list)) => with(|unity| {
                // SAFETY: a closed list, which is kept until it has executed.
                unsafe { unity.engine.direct.ExecuteCommandLists(&[Some(list)]) };
            }),
            Some(Job::Event(number, data)) => on_thread(CallContext::Submitting, || run(number, data)),
            Some(Job::Signal(value)) => with(|unity| {
                // SAFETY: a live queue and fence.
                unsafe { unity.engine.direct.Signal(&unity.fence, value) }.expect("it takes a signal");
                unity.submitted = value;
            }),
            None => return,
        }
    }
}

/// Calls the plugin for an event on this thread.
fn run(number: c_int, data: usize) {
    let event = plugin::cairn_unity_get_event_function();
    // SAFETY: any number and any data are allowed.
    unsafe { event(number, std::ptr::without_provenance_mut(data)) };
}

unsafe extern "system" fn get_device() -> *mut c_void {
    with(|unity| {
        unity.called("GetDevice", &CALLED);
        unity.engine.device.as_raw()
    })
}

unsafe extern "system" fn get_frame_fence() -> *mut c_void {
    with(|unity| {
        unity.called("GetFrameFence", &CALLED);
        unity.fence.as_raw()
    })
}

unsafe extern "system" fn get_next_frame_fence_value() -> u64 {
    with(|unity| {
        unity.called("GetNextFrameFenceValue", &EVENTS);
        unity.told_value()
    })
}

unsafe extern "system" fn get_command_queue() -> *mut c_void {
    with(|unity| {
        unity.called("GetCommandQueue", &[CallContext::Starting, CallContext::Submitting, CallContext::Unconfigured]);
        unity.engine.direct.as_raw()
    })
}

/// A texture and its states, as Unity declares it.
#[repr(C)]
struct States {
    resource: *mut c_void,
    expected: i32,
    current: i32,
}

unsafe extern "system" fn execute_command_list(list: *mut c_void, count: c_int, states: *const States) -> u64 {
    with(|unity| {
        unity.called("ExecuteCommandList", &[CallContext::Recording, CallContext::Unconfigured]);
        let mut after = Vec::new();
        for place in 0..count {
            // SAFETY: the array has the stated number of elements.
            let told = unsafe { &*states.add(place as usize) };
            let Some(texture) = unity.own(told.resource, "ExecuteCommandList") else { continue };
            unity.transition(&texture, D3D12_RESOURCE_STATES(told.expected));
            after.push((told.resource.addr(), D3D12_RESOURCE_STATES(told.current)));
        }
        unity.close();
        // SAFETY: a live list.
        let list = unsafe { ID3D12GraphicsCommandList::from_raw_borrowed(&list) }.expect("a list");
        // SAFETY: as above.
        let kind = unsafe { list.GetType() };
        if kind != D3D12_COMMAND_LIST_TYPE_DIRECT {
            unity.wrong.push("ExecuteCommandList is called with a list that is not direct".to_owned());
        }
        if recorder::is_loaded() && recorder::is_open(list) {
            unity.wrong.push("ExecuteCommandList is called with a list that is not closed".to_owned());
        }
        // It executes at the end of the frame, not now.
        unity.pending.push_back(Job::List(list.cast().expect("a command list")));
        unity.states.extend(after);
        unity.told_value()
    })
}

unsafe extern "system" fn configure_event(event: c_int, config: *const [u32; 3]) {
    with(|unity| {
        unity.called("ConfigureEvent", &[CallContext::Starting]);
        if !(FIRST..FIRST + RESERVED).contains(&event) {
            unity.wrong.push("ConfigureEvent is called with an event that is not the plugin's".to_owned());
        }
        // SAFETY: a struct of three words; the last is a byte with padding.
        let [access, flags, binds] = unsafe { config.read() };
        unity.configured.insert(event, [access, flags, binds & 0xff]);
    });
}

unsafe extern "system" fn command_recording_state(state: *mut *mut c_void) -> u8 {
    with(|unity| {
        unity.called("CommandRecordingState", &[CallContext::Recording]);
        if PLACE.get() != CallContext::Recording || unity.has_no_list {
            return 0;
        }
        // SAFETY: a struct for a list.
        unsafe { state.write(unity.list().list().as_raw()) };
        1
    })
}

unsafe extern "system" fn request_resource_state(resource: *mut c_void, state: i32) {
    with(|unity| {
        unity.called("RequestResourceState", &[CallContext::Recording]);
        if let Some(texture) = unity.own(resource, "RequestResourceState") {
            unity.transition(&texture, D3D12_RESOURCE_STATES(state));
        }
    });
}

unsafe extern "system" fn notify_resource_state(resource: *mut c_void, state: i32, _unordered: u8) {
    with(|unity| {
        unity.called("NotifyResourceState", &[CallContext::Recording]);
        if unity.own(resource, "NotifyResourceState").is_some() {
            unity.states.insert(resource.addr(), D3D12_RESOURCE_STATES(state));
        }
    });
}

/// Fills the slots of functions that the plugin does not use.
unsafe extern "system" fn not_used() -> usize {
    with(|unity| unity.wrong.push("a function is called that has another meaning".to_owned()));
    0
}

unsafe extern "system" fn get_renderer() -> c_int {
    18
}

unsafe extern "system" fn register_device_event(event: Option<unsafe extern "system" fn(c_int)>) {
    with(|unity| {
        unity.called("RegisterDeviceEventCallback", &[CallContext::Starting]);
        unity.device_event = event;
    });
}

unsafe extern "system" fn unregister_device_event(_: Option<unsafe extern "system" fn(c_int)>) {
    with(|unity| {
        unity.called("UnregisterDeviceEventCallback", &[CallContext::Starting]);
        unity.device_event = None;
    });
}

unsafe extern "system" fn reserve_events(count: c_int) -> c_int {
    with(|unity| unity.called("ReserveEventIDRange", &[CallContext::Starting]));
    assert_eq!(count, RESERVED, "events");
    FIRST
}

/// A slot of a table of functions, in Unity's order.
#[derive(Clone, Copy)]
#[allow(dead_code, reason = "the plugin reads it")]
struct Slot(*const c_void);

// SAFETY: addresses of functions.
unsafe impl Sync for Slot {}

macro_rules! table {
    ($($function:expr),* $(,)?) => { [$(Slot($function as *const c_void)),*] };
}

static GRAPHICS: [Slot; 4] = table![get_renderer, register_device_event, unregister_device_event, reserve_events];
/// The first functions of a table, in memory of their own, so that nothing follows them.
const fn first<const FEW: usize, const ALL: usize>(table: &[Slot; ALL]) -> [Slot; FEW] {
    let mut few = [table[0]; FEW];
    let mut place = 0;
    while place < FEW {
        few[place] = table[place];
        place += 1;
    }
    few
}

// There are two orders: the second one inserts three swap-chain functions at the front. Within each order a later version only appends.
static V5: [Slot; 7] = first(&V6);
static V6: [Slot; 10] = table![
    get_device,
    get_frame_fence,
    get_next_frame_fence_value,
    execute_command_list,
    not_used,
    get_command_queue,
    not_used,
    not_used,
    configure_event,
    command_recording_state,
];
static V7: [Slot; 13] = first(&V8);
static V8: [Slot; 15] = table![
    get_device,
    not_used,
    not_used,
    not_used,
    get_frame_fence,
    get_next_frame_fence_value,
    execute_command_list,
    not_used,
    get_command_queue,
    not_used,
    not_used,
    configure_event,
    command_recording_state,
    request_resource_state,
    notify_resource_state,
];
static REGISTRY: [Slot; 4] = table![not_used, not_used, get_interface, not_used];

unsafe extern "system" fn get_interface(high: u64, low: u64) -> *const c_void {
    let version = with(|unity| unity.version);
    // A Unity that has a version also has the earlier ones.
    let has = |least: u32, table: &'static [Slot]| if version >= least { table.as_ptr().cast() } else { null() };
    match (high, low) {
        (0x7cba0a9ca4ddb544, 0x8c5ad4926eb17b11) => GRAPHICS.as_ptr().cast(),
        (0xf5c8d8a37d37bc42, 0xb02dfe93b5064a27) => has(5, &V5),
        (0xa396dce58cac4d78, 0xafdd9b281f20b840) => has(6, &V6),
        (0x4624b0da41b64aac, 0x915aabcb9bc3f0d3) => has(7, &V7),
        (0x9d303045d00d4cfd, 0x8febb42968b423b6) => has(8, &V8),
        _ => null(),
    }
}

/// A table of the registry, as the plugin reads it.
///
/// # Safety
/// `T` is the type of the table with that GUID.
pub(crate) unsafe fn table<T: Copy>(guid: Guid) -> T {
    // SAFETY: GUIDs are looked up.
    let found = unsafe { get_interface(guid.high, guid.low) };
    assert!(!found.is_null(), "a version that this Unity has");
    // SAFETY: the caller's promise.
    unsafe { found.cast::<T>().read() }
}

/// Handle of the running Unity.
pub(crate) struct UnityHandle {
    _one: std::sync::MutexGuard<'static, ()>,
}

impl UnityHandle {
    /// Starts a Unity with one version of the interface, without the plugin.
    pub(crate) fn start(version: u32) -> Self {
        let one = ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner());
        let engine = Engine::create();
        // SAFETY: a live device.
        let fence = unsafe { engine.device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
        *UNITY.lock().unwrap_or_else(|e| e.into_inner()) = Some(Unity {
            engine,
            version,
            fence,
            next: 1,
            submitted: 0,
            open: None,
            pending: VecDeque::new(),
            lags: false,
            delay: 0,
            has_no_list: false,
            early: 0,
            alive: Vec::new(),
            textures: Vec::new(),
            states: BTreeMap::new(),
            configured: BTreeMap::new(),
            device_event: None,
            calls: BTreeMap::new(),
            wrong: Vec::new(),
        });
        Self { _one: one }
    }

    pub(crate) fn load(&self) {
        // SAFETY: the registry lives for ever.
        at(CallContext::Starting, || unsafe { UnityPluginLoad(REGISTRY.as_ptr().cast()) });
    }

    pub(crate) fn unload(&self) {
        // SAFETY: as above.
        at(CallContext::Starting, || unsafe { UnityPluginUnload() });
    }

    /// Sends the plugin a device event.
    pub(crate) fn device_event(&self, kind: c_int) {
        let event = with(|unity| unity.device_event).expect("the plugin has registered");
        // SAFETY: as Unity calls it.
        at(CallContext::Starting, || unsafe { event(kind) });
    }

    /// From now on the submission thread calls the plugin only at the end of a frame, long after the render thread has finished it.
    pub(crate) fn lag(&self) {
        with(|unity| unity.lags = true);
    }

    /// From now on a frame's lists are submitted after `frames` later frames have ended, or by [`Self::wait_ignoring_loss`].
    pub(crate) fn delay(&self, frames: u64) {
        with(|unity| unity.delay = frames);
    }

    /// From now on no list is open in events, or one is.
    pub(crate) fn has_no_list(&self, has_none: bool) {
        with(|unity| unity.has_no_list = has_none);
    }

    /// From now on the plugin gets values of the frame fence that are too low by `frames`, as in players of Unity.
    pub(crate) fn early(&self, frames: u64) {
        with(|unity| unity.early = frames);
    }

    /// Makes the queue wait, after its current work, until the gate is opened.
    pub(crate) fn hold(&self) -> Gate {
        with(|unity| {
            // SAFETY: a live device.
            let fence: ID3D12Fence =
                unsafe { unity.engine.device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
            // SAFETY: a live queue and fence.
            unsafe { unity.engine.direct.Wait(&fence, 1) }.expect("it waits");
            // SAFETY: as above. The queue tells that it no longer needs the fence.
            unsafe { unity.engine.direct.Signal(&fence, 2) }.expect("it takes a signal");
            Gate(fence)
        })
    }

    pub(crate) fn device(&self) -> ID3D12Device {
        with(|unity| unity.engine.device.clone())
    }

    pub(crate) fn queue(&self) -> ID3D12CommandQueue {
        with(|unity| unity.engine.direct.clone())
    }

    /// Registers a texture as Unity's, in the given state.
    pub(crate) fn own(&self, texture: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        with(|unity| {
            unity.textures.push(texture.clone());
            unity.states.insert(texture.as_raw().addr(), state);
        });
    }

    pub(crate) fn state_of(&self, texture: &ID3D12Resource) -> D3D12_RESOURCE_STATES {
        with(|unity| unity.state_of(texture))
    }

    /// Transitions a texture into a state, for example for a shader to read it.
    pub(crate) fn transition(&self, texture: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        with(|unity| unity.transition(texture, state));
    }

    /// Calls the plugin for an event that was issued, on the thread that its configuration names.
    pub(crate) fn event(&self, number: c_int, data: *mut c_void) {
        let data = data.addr();
        match with(|unity| unity.configured.get(&number).copied()) {
            Some([1, flags, _]) => {
                assert_eq!(flags & 6, 0, "nothing is flushed and no thread is waited for");
                if with(|unity| unity.lags) {
                    with(Unity::close);
                    with(|unity| unity.pending.push_back(Job::Event(number, data)));
                } else {
                    on_thread(CallContext::Submitting, || run(number, data));
                }
            }
            Some(_) => on_thread(CallContext::Recording, || run(number, data)),
            None => on_thread(CallContext::Unconfigured, || run(number, data)),
        }
    }

    /// Runs `work` where Unity would call the plugin.
    pub(crate) fn act(&self, place: CallContext, work: impl FnOnce() + Send) {
        on_thread(place, work);
    }

    /// Ends a frame: submits the lists that are due, then signals the frame fence.
    pub(crate) fn end_frame(&self) {
        let delay = with(|unity| {
            unity.close();
            unity.pending.push_back(Job::Signal(unity.next));
            unity.next += 1;
            unity.delay
        });
        submit(delay);
        with(|unity| {
            // While lists wait for submission, the assumed states are ahead of the queue's, so they are not compared.
            let is_known = recorder::is_loaded() && unity.pending.is_empty();
            let textures = if is_known { unity.textures.as_slice() } else { &[] };
            for texture in textures {
                let (assumed, known) = (unity.state_of(texture), recorder::state_of(texture));
                if let Some(state) = known.filter(|state| *state != assumed) {
                    unity.wrong.push(format!("what Unity was told: a texture is in {state:?}, not {assumed:?}"));
                }
            }
        });
    }

    /// Submits everything, waits for the queue and releases the lists.
    pub(crate) fn wait_ignoring_loss(&self) {
        submit(0);
        textures::wait(&self.device(), &self.queue());
        with(|unity| unity.alive.clear());
    }

    /// Number of calls of a function.
    pub(crate) fn calls(&self, name: &str) -> u32 {
        with(|unity| unity.calls.get(name).copied().unwrap_or(0))
    }

    /// Configuration of an event: queue access, flags, whether the render texture is bound first.
    pub(crate) fn configured(&self, event: c_int) -> Option<[u32; 3]> {
        with(|unity| unity.configured.get(&event).copied())
    }

    /// Takes the violations found since the last call.
    pub(crate) fn take_violations(&self) -> Vec<String> {
        with(|unity| std::mem::take(&mut unity.wrong))
    }
}

/// Blocks a queue until it is opened.
pub(crate) struct Gate(ID3D12Fence);

impl Drop for Gate {
    fn drop(&mut self) {
        // SAFETY: a live fence.
        unsafe { self.0.Signal(1) }.expect("it takes a signal");
        // SAFETY: a live fence.
        while unsafe { self.0.GetCompletedValue() } < 2 {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }
}

impl Drop for UnityHandle {
    fn drop(&mut self) {
        submit(0);
        self.unload();
        let unity = UNITY.lock().unwrap_or_else(|e| e.into_inner()).take();
        if let Some(unity) = unity {
            textures::wait(&unity.engine.device, &unity.engine.direct);
        }
    }
}
