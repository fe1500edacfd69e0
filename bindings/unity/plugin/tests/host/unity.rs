//! A Unity of our own over a real device: the registry, one version of the interface of Direct3D 12, and a frame loop that is as
//! strict as the interface allows. What the plugin does against the rules is kept, and a test looks at it.

use std::collections::BTreeMap;
use std::ffi::{c_int, c_void};
use std::ptr::null;
use std::sync::Mutex;

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use cairn_unity::{UnityPluginLoad, UnityPluginUnload};

use super::engine::{self, Engine};
use super::textures::Recording;

/// The first number of the plugin's events.
const FIRST: c_int = 4711;

/// There is one Unity in a process, whose functions have no object.
static UNITY: Mutex<Option<Unity>> = Mutex::new(None);
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

struct Unity {
    engine: Engine,
    version: u32,
    fence: ID3D12Fence,
    /// What the fence gets at the end of the frame.
    next: u64,
    /// What is recorded at the moment.
    open: Option<Recording>,
    /// Closed lists that the queue has not been given.
    pending: Vec<ID3D12CommandList>,
    /// What lists that are under way need.
    alive: Vec<Recording>,
    states: BTreeMap<usize, D3D12_RESOURCE_STATES>,
    configured: BTreeMap<c_int, [u32; 3]>,
    /// The queue access of the event that runs; none outside of events, and for those that nobody configured.
    access: Option<u32>,
    in_event: bool,
    device_event: Option<unsafe extern "system" fn(c_int)>,
    calls: BTreeMap<&'static str, u32>,
    wrong: Vec<String>,
}

/// Calls `work` with the Unity that runs.
fn with<T>(work: impl FnOnce(&mut Unity) -> T) -> T {
    work(UNITY.lock().unwrap_or_else(|e| e.into_inner()).as_mut().expect("a Unity"))
}

impl Unity {
    fn called(&mut self, name: &'static str) {
        *self.calls.entry(name).or_default() += 1;
    }

    fn state_of(&self, resource: &ID3D12Resource) -> D3D12_RESOURCE_STATES {
        *self.states.get(&resource.as_raw().addr()).expect("a texture of Unity's")
    }

    /// Brings a texture of ours into a state, in the list that is open.
    fn bring(&mut self, resource: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        let before = self.state_of(resource);
        let list = self.open.get_or_insert_with(|| Recording::on(&self.engine.device, &self.engine.direct));
        list.barrier(resource, before, state);
        self.states.insert(resource.as_raw().addr(), state);
    }

    /// Puts the open list behind those that wait.
    fn close(&mut self) {
        let Some(open) = self.open.take() else { return };
        // SAFETY: an open list.
        unsafe { open.list().Close() }.expect("a list that can be closed");
        self.pending.push(open.list().cast().expect("a command list"));
        self.alive.push(open);
    }

    /// Gives the queue everything that waits for it.
    fn flush(&mut self) {
        self.close();
        for list in self.pending.drain(..) {
            // SAFETY: a closed list, which is kept until it has run.
            unsafe { self.engine.direct.ExecuteCommandLists(&[Some(list)]) };
        }
    }
}

unsafe extern "system" fn get_device() -> *mut c_void {
    with(|unity| {
        unity.called("GetDevice");
        unity.engine.device.as_raw()
    })
}

unsafe extern "system" fn get_frame_fence() -> *mut c_void {
    with(|unity| {
        unity.called("GetFrameFence");
        unity.fence.as_raw()
    })
}

unsafe extern "system" fn get_next_frame_fence_value() -> u64 {
    with(|unity| {
        unity.called("GetNextFrameFenceValue");
        unity.next
    })
}

unsafe extern "system" fn get_command_queue() -> *mut c_void {
    with(|unity| {
        unity.called("GetCommandQueue");
        if unity.in_event && unity.access == Some(0) {
            unity.wrong.push("the queue is asked for where it is to be left alone".to_owned());
        }
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
        unity.called("ExecuteCommandList");
        for place in 0..count {
            // SAFETY: as many as is said.
            let told = unsafe { &*states.add(place as usize) };
            // SAFETY: a live texture.
            let texture = unsafe { ID3D12Resource::from_raw_borrowed(&told.resource) }.expect("a texture").clone();
            unity.bring(&texture, D3D12_RESOURCE_STATES(told.expected));
            unity.states.insert(texture.as_raw().addr(), D3D12_RESOURCE_STATES(told.current));
        }
        unity.close();
        // SAFETY: a live list.
        let list = unsafe { ID3D12GraphicsCommandList::from_raw_borrowed(&list) }.expect("a list");
        // SAFETY: as above.
        let kind = unsafe { list.GetType() };
        if kind != D3D12_COMMAND_LIST_TYPE_DIRECT {
            unity.wrong.push("a list that is not direct".to_owned());
        }
        // It runs when the frame ends, and not now.
        unity.pending.push(list.cast().expect("a command list"));
        unity.next
    })
}

unsafe extern "system" fn configure_event(event: c_int, config: *const [u32; 3]) {
    with(|unity| {
        unity.called("ConfigureEvent");
        if unity.in_event {
            unity.wrong.push("an event is configured within one".to_owned());
        }
        // SAFETY: a struct of three words, the last a byte and what fills it up.
        let [access, flags, binds] = unsafe { config.read() };
        unity.configured.insert(event, [access, flags, binds & 0xff]);
    });
}

unsafe extern "system" fn command_recording_state(state: *mut *mut c_void) -> u8 {
    with(|unity| {
        unity.called("CommandRecordingState");
        if unity.access != Some(0) {
            unity.wrong.push("the list is asked for where it is to be left alone".to_owned());
            return 0;
        }
        let list = unity.open.get_or_insert_with(|| Recording::on(&unity.engine.device, &unity.engine.direct));
        // SAFETY: a place for a list.
        unsafe { state.write(list.list().as_raw()) };
        1
    })
}

unsafe extern "system" fn request_resource_state(resource: *mut c_void, state: i32) {
    with(|unity| {
        unity.called("RequestResourceState");
        // SAFETY: a live texture.
        let texture = unsafe { ID3D12Resource::from_raw_borrowed(&resource) }.expect("a texture").clone();
        unity.bring(&texture, D3D12_RESOURCE_STATES(state));
    });
}

unsafe extern "system" fn notify_resource_state(resource: *mut c_void, state: i32, _unordered: u8) {
    with(|unity| {
        unity.called("NotifyResourceState");
        unity.states.insert(resource.addr(), D3D12_RESOURCE_STATES(state));
    });
}

/// Stands in all places whose functions the plugin has no use for.
unsafe extern "system" fn not_used() -> usize {
    with(|unity| unity.wrong.push("a function is called that has another meaning".to_owned()));
    0
}

unsafe extern "system" fn get_renderer() -> c_int {
    18
}

unsafe extern "system" fn register_device_event(event: Option<unsafe extern "system" fn(c_int)>) {
    with(|unity| {
        unity.called("RegisterDeviceEventCallback");
        unity.device_event = event;
    });
}

unsafe extern "system" fn unregister_device_event(_: Option<unsafe extern "system" fn(c_int)>) {
    with(|unity| {
        unity.called("UnregisterDeviceEventCallback");
        unity.device_event = None;
    });
}

unsafe extern "system" fn reserve_events(count: c_int) -> c_int {
    assert_eq!(count, 2, "events");
    FIRST
}

/// A table: functions in Unity's order, by their places.
#[derive(Clone, Copy)]
#[allow(dead_code, reason = "the plugin reads it")]
struct Place(*const c_void);

// SAFETY: addresses of functions.
unsafe impl Sync for Place {}

macro_rules! table {
    ($($function:expr),* $(,)?) => { [$(Place($function as *const c_void)),*] };
}

static GRAPHICS: [Place; 4] = table![get_renderer, register_device_event, unregister_device_event, reserve_events];
static V5: [Place; 7] = table![
    get_device,
    get_frame_fence,
    get_next_frame_fence_value,
    execute_command_list,
    not_used,
    get_command_queue,
    not_used,
];
static V6: [Place; 10] = table![
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
static V7: [Place; 13] = table![
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
];
static V8: [Place; 15] = table![
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
static REGISTRY: [Place; 4] = table![not_used, not_used, get_interface, not_used];

unsafe extern "system" fn get_interface(high: u64, low: u64) -> *const c_void {
    let version = with(|unity| unity.version);
    // A Unity that has a version has those before it.
    let has = |least: u32, table: &'static [Place]| if version >= least { table.as_ptr().cast() } else { null() };
    match (high, low) {
        (0x7cba0a9ca4ddb544, 0x8c5ad4926eb17b11) => GRAPHICS.as_ptr().cast(),
        (0xf5c8d8a37d37bc42, 0xb02dfe93b5064a27) => has(5, &V5),
        (0xa396dce58cac4d78, 0xafdd9b281f20b840) => has(6, &V6),
        (0x4624b0da41b64aac, 0x915aabcb9bc3f0d3) => has(7, &V7),
        (0x9d303045d00d4cfd, 0x8febb42968b423b6) => has(8, &V8),
        _ => null(),
    }
}

/// The Unity that runs, for whoever holds it.
pub(crate) struct Running {
    _one: std::sync::MutexGuard<'static, ()>,
}

impl Running {
    /// Starts one of a version, without the plugin.
    pub(crate) fn start(version: u32) -> Self {
        let one = ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner());
        let engine = engine::engine();
        // SAFETY: a live device.
        let fence = unsafe { engine.device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
        *UNITY.lock().unwrap_or_else(|e| e.into_inner()) = Some(Unity {
            engine,
            version,
            fence,
            next: 1,
            open: None,
            pending: Vec::new(),
            alive: Vec::new(),
            states: BTreeMap::new(),
            configured: BTreeMap::new(),
            access: None,
            in_event: false,
            device_event: None,
            calls: BTreeMap::new(),
            wrong: Vec::new(),
        });
        Self { _one: one }
    }

    pub(crate) fn load(&self) {
        // SAFETY: the registry lives for ever.
        unsafe { UnityPluginLoad(REGISTRY.as_ptr().cast()) };
    }

    pub(crate) fn unload(&self) {
        // SAFETY: as above.
        unsafe { UnityPluginUnload() };
    }

    /// Tells the plugin of the device.
    pub(crate) fn device_event(&self, kind: c_int) {
        let event = with(|unity| unity.device_event).expect("the plugin has registered");
        // SAFETY: as Unity calls it.
        unsafe { event(kind) };
    }

    pub(crate) fn device(&self) -> ID3D12Device {
        with(|unity| unity.engine.device.clone())
    }

    pub(crate) fn queue(&self) -> ID3D12CommandQueue {
        with(|unity| unity.engine.direct.clone())
    }

    /// Has a texture of ours, which is in that state.
    pub(crate) fn own(&self, texture: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        with(|unity| unity.states.insert(texture.as_raw().addr(), state));
    }

    pub(crate) fn state_of(&self, texture: &ID3D12Resource) -> D3D12_RESOURCE_STATES {
        with(|unity| unity.state_of(texture))
    }

    /// Brings a texture into a state, as where a shader reads it.
    pub(crate) fn bring(&self, texture: &ID3D12Resource, state: D3D12_RESOURCE_STATES) {
        with(|unity| unity.bring(texture, state));
    }

    /// Calls the plugin as for an event that was issued.
    pub(crate) fn event(&self, number: c_int, data: *mut c_void) {
        with(|unity| {
            let config = unity.configured.get(&number).copied();
            if let Some([1, flags, _]) = config {
                assert_eq!(flags & 2, 2, "lists that were recorded before come first");
                unity.flush();
            }
            unity.access = config.map(|[access, ..]| access);
            unity.in_event = true;
        });
        let event = cairn_unity::cairn_unity_get_event_function();
        // SAFETY: any number and any data are allowed.
        unsafe { event(number, data) };
        with(|unity| {
            unity.access = None;
            unity.in_event = false;
        });
    }

    /// Ends a frame: the queue gets what is left, and then the value of the fence.
    pub(crate) fn end_frame(&self) {
        with(|unity| {
            unity.flush();
            // SAFETY: a live queue and fence.
            unsafe { unity.engine.direct.Signal(&unity.fence, unity.next) }.expect("it takes a signal");
            unity.next += 1;
        });
    }

    /// Waits for the queue, and lets go of the lists that it had.
    pub(crate) fn settle(&self) {
        super::textures::wait(&self.device(), &self.queue());
        with(|unity| unity.alive.clear());
    }

    /// How often a function was called.
    pub(crate) fn calls(&self, name: &str) -> u32 {
        with(|unity| unity.calls.get(name).copied().unwrap_or(0))
    }

    /// How an event was configured: queue access, flags, whether a texture is bound first.
    pub(crate) fn configured(&self, event: c_int) -> Option<[u32; 3]> {
        with(|unity| unity.configured.get(&event).copied())
    }

    /// What was done against the rules.
    pub(crate) fn wrong(&self) -> Vec<String> {
        with(|unity| unity.wrong.clone())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.unload();
        let unity = UNITY.lock().unwrap_or_else(|e| e.into_inner()).take();
        if let Some(unity) = unity {
            super::textures::wait(&unity.engine.device, &unity.engine.direct);
        }
    }
}
