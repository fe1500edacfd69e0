//! What Unity offers to native plugins, as far as it is used here, in our own words.
//!
//! An interface is a table of functions without an object: the pointer that the registry gives points to the first function, and no
//! function takes the table. All are called as the system's functions are (on x86-64 there is one way). The tables of Direct3D 12 do
//! not grow at the end: each version has a number and an order of its own.

use std::ffi::{c_int, c_void};

/// What the registry finds an interface by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Guid {
    pub high: u64,
    pub low: u64,
}

impl Guid {
    const fn new(high: u64, low: u64) -> Self {
        Self { high, low }
    }
}

/// A function of a table that is never called: it keeps the place.
pub type Unused = usize;

/// The registry of interfaces.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Interfaces {
    pub get: Unused,
    pub register: Unused,
    pub get_split: Option<unsafe extern "system" fn(u64, u64) -> *const c_void>,
    pub register_split: Unused,
}

/// Is told that the graphics device comes or goes: one of the constants `DEVICE_*`.
pub type DeviceEvent = unsafe extern "system" fn(c_int);

/// Is called on Unity's render or submission thread, with an event's number and what was given with it.
pub type RenderEvent = unsafe extern "system" fn(c_int, *mut c_void);

pub const DEVICE_INITIALISE: c_int = 0;
pub const DEVICE_SHUTDOWN: c_int = 1;
pub const DEVICE_BEFORE_RESET: c_int = 2;
pub const DEVICE_AFTER_RESET: c_int = 3;

/// Kinds of renderers, of those that a desktop has.
pub const RENDERER_D3D11: c_int = 2;
pub const RENDERER_NULL: c_int = 4;
pub const RENDERER_OPENGL_ES: c_int = 11;
pub const RENDERER_METAL: c_int = 16;
pub const RENDERER_OPENGL: c_int = 17;
pub const RENDERER_D3D12: c_int = 18;
pub const RENDERER_VULKAN: c_int = 21;

/// The renderer, whichever it is.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Graphics {
    pub get_renderer: Option<unsafe extern "system" fn() -> c_int>,
    pub register_device_event: Option<unsafe extern "system" fn(Option<DeviceEvent>)>,
    pub unregister_device_event: Option<unsafe extern "system" fn(Option<DeviceEvent>)>,
    pub reserve_events: Option<unsafe extern "system" fn(c_int) -> c_int>,
}

impl Graphics {
    pub const GUID: Guid = Guid::new(0x7CBA_0A9C_A4DD_B544, 0x8C5A_D492_6EB1_7B11);
}

/// A texture that a list uses, and its states before and after it, as Direct3D numbers them.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct ResourceState {
    pub resource: *mut c_void,
    pub expected: c_int,
    pub current: c_int,
}

/// What Unity records at the moment.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct RecordingState {
    pub list: *mut c_void,
}

/// The event runs on the render thread, where Unity records and its queue is not to be used.
pub const QUEUE_LEFT_ALONE: c_int = 0;
/// The event runs on the submission thread, where the queue may be used and Unity's list may not.
pub const QUEUE_ALLOWED: c_int = 1;

/// Lists that are there already are submitted first.
pub const FLUSH_COMMAND_BUFFERS: u32 = 1 << 1;
/// Unity's worker threads are waited for.
pub const SYNC_WORKER_THREADS: u32 = 1 << 2;
/// The event leaves other bindings in Unity's list.
pub const MODIFIES_COMMAND_BUFFERS: u32 = 1 << 3;

/// How an event is to be called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct EventConfig {
    pub queue_access: c_int,
    pub flags: u32,
    /// Not zero: the texture that is rendered to is bound first.
    pub binds_render_texture: u8,
}

pub type GetObject = Option<unsafe extern "system" fn() -> *mut c_void>;
pub type GetValue = Option<unsafe extern "system" fn() -> u64>;
pub type Execute = Option<unsafe extern "system" fn(*mut c_void, c_int, *mut ResourceState) -> u64>;
pub type Configure = Option<unsafe extern "system" fn(c_int, *const EventConfig)>;
/// Gives one byte, 0 where nothing is recorded.
pub type Recording = Option<unsafe extern "system" fn(*mut RecordingState) -> u8>;
pub type Request = Option<unsafe extern "system" fn(*mut c_void, c_int)>;
pub type Notify = Option<unsafe extern "system" fn(*mut c_void, c_int, u8)>;

#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Direct3d12V5 {
    pub get_device: GetObject,
    pub get_frame_fence: GetObject,
    pub get_next_frame_fence_value: GetValue,
    pub execute_command_list: Execute,
    pub set_physical_video_memory_control_values: Unused,
    pub get_command_queue: GetObject,
    pub texture_from_render_buffer: Unused,
}

#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Direct3d12V6 {
    pub get_device: GetObject,
    pub get_frame_fence: GetObject,
    pub get_next_frame_fence_value: GetValue,
    pub execute_command_list: Execute,
    pub set_physical_video_memory_control_values: Unused,
    pub get_command_queue: GetObject,
    pub texture_from_render_buffer: Unused,
    pub texture_from_native_texture: Unused,
    pub configure_event: Configure,
    pub command_recording_state: Recording,
}

#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Direct3d12V7 {
    pub get_device: GetObject,
    pub get_swap_chain: Unused,
    pub get_sync_interval: Unused,
    pub get_present_flags: Unused,
    pub get_frame_fence: GetObject,
    pub get_next_frame_fence_value: GetValue,
    pub execute_command_list: Execute,
    pub set_physical_video_memory_control_values: Unused,
    pub get_command_queue: GetObject,
    pub texture_from_render_buffer: Unused,
    pub texture_from_native_texture: Unused,
    pub configure_event: Configure,
    pub command_recording_state: Recording,
}

#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Direct3d12V8 {
    pub get_device: GetObject,
    pub get_swap_chain: Unused,
    pub get_sync_interval: Unused,
    pub get_present_flags: Unused,
    pub get_frame_fence: GetObject,
    pub get_next_frame_fence_value: GetValue,
    pub execute_command_list: Execute,
    pub set_physical_video_memory_control_values: Unused,
    pub get_command_queue: GetObject,
    pub texture_from_render_buffer: Unused,
    pub texture_from_native_texture: Unused,
    pub configure_event: Configure,
    pub command_recording_state: Recording,
    pub request_resource_state: Request,
    pub notify_resource_state: Notify,
}

/// A version's place in the registry.
pub trait Version {
    const NUMBER: u32;
    const GUID: Guid;
}

impl Version for Direct3d12V5 {
    const NUMBER: u32 = 5;
    const GUID: Guid = Guid::new(0xF5C8_D8A3_7D37_BC42, 0xB02D_FE93_B506_4A27);
}

impl Version for Direct3d12V6 {
    const NUMBER: u32 = 6;
    const GUID: Guid = Guid::new(0xA396_DCE5_8CAC_4D78, 0xAFDD_9B28_1F20_B840);
}

impl Version for Direct3d12V7 {
    const NUMBER: u32 = 7;
    const GUID: Guid = Guid::new(0x4624_B0DA_41B6_4AAC, 0x915A_ABCB_9BC3_F0D3);
}

impl Version for Direct3d12V8 {
    const NUMBER: u32 = 8;
    const GUID: Guid = Guid::new(0x9D30_3045_D00D_4CFD, 0x8FEB_B429_68B4_23B6);
}

/// What is used of the best version that Unity has; `None` for what that version lacks.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
pub(crate) struct Direct3d12 {
    pub(crate) version: u32,
    pub(crate) get_device: GetObject,
    pub(crate) get_frame_fence: GetObject,
    pub(crate) get_next_frame_fence_value: GetValue,
    pub(crate) execute_command_list: Execute,
    pub(crate) get_command_queue: GetObject,
    pub(crate) configure_event: Configure,
    pub(crate) command_recording_state: Recording,
    pub(crate) request_resource_state: Request,
    pub(crate) notify_resource_state: Notify,
}

impl Direct3d12 {
    /// The functions of a table; those of the list, which later versions have, where they are named.
    fn of_table(table: &Direct3d12V5, version: u32) -> Self {
        Self {
            version,
            get_device: table.get_device,
            get_frame_fence: table.get_frame_fence,
            get_next_frame_fence_value: table.get_next_frame_fence_value,
            execute_command_list: table.execute_command_list,
            get_command_queue: table.get_command_queue,
            configure_event: None,
            command_recording_state: None,
            request_resource_state: None,
            notify_resource_state: None,
        }
    }

    /// The best version in the registry.
    ///
    /// # Safety
    /// The registry is Unity's, whose tables live as long as it does.
    pub(crate) unsafe fn find(registry: &Interfaces) -> Option<Self> {
        // SAFETY: the caller's promise, for each of them.
        let (v8, v7, v6, v5) = unsafe {
            (
                table::<Direct3d12V8>(registry, Direct3d12V8::GUID),
                table::<Direct3d12V7>(registry, Direct3d12V7::GUID),
                table::<Direct3d12V6>(registry, Direct3d12V6::GUID),
                table::<Direct3d12V5>(registry, Direct3d12V5::GUID),
            )
        };
        let found = v8.map(Self::from).or(v7.map(Self::from)).or(v6.map(Self::from)).or(v5.map(Self::from));
        found.filter(Self::is_whole)
    }

    /// Whether it has what every version has.
    fn is_whole(&self) -> bool {
        self.get_device.is_some()
            && self.get_frame_fence.is_some()
            && self.get_next_frame_fence_value.is_some()
            && self.execute_command_list.is_some()
            && self.get_command_queue.is_some()
    }
}

impl From<Direct3d12V5> for Direct3d12 {
    fn from(table: Direct3d12V5) -> Self {
        Self::of_table(&table, Direct3d12V5::NUMBER)
    }
}

/// A later table's functions in the order of the earliest.
macro_rules! earliest {
    ($table:expr) => {
        Direct3d12V5 {
            get_device: $table.get_device,
            get_frame_fence: $table.get_frame_fence,
            get_next_frame_fence_value: $table.get_next_frame_fence_value,
            execute_command_list: $table.execute_command_list,
            set_physical_video_memory_control_values: $table.set_physical_video_memory_control_values,
            get_command_queue: $table.get_command_queue,
            texture_from_render_buffer: $table.texture_from_render_buffer,
        }
    };
}

impl From<Direct3d12V6> for Direct3d12 {
    fn from(table: Direct3d12V6) -> Self {
        Self {
            configure_event: table.configure_event,
            command_recording_state: table.command_recording_state,
            ..Self::of_table(&earliest!(table), Direct3d12V6::NUMBER)
        }
    }
}

impl From<Direct3d12V7> for Direct3d12 {
    fn from(table: Direct3d12V7) -> Self {
        Self {
            configure_event: table.configure_event,
            command_recording_state: table.command_recording_state,
            ..Self::of_table(&earliest!(table), Direct3d12V7::NUMBER)
        }
    }
}

impl From<Direct3d12V8> for Direct3d12 {
    fn from(table: Direct3d12V8) -> Self {
        Self {
            configure_event: table.configure_event,
            command_recording_state: table.command_recording_state,
            request_resource_state: table.request_resource_state,
            notify_resource_state: table.notify_resource_state,
            ..Self::of_table(&earliest!(table), Direct3d12V8::NUMBER)
        }
    }
}

/// A copy of a table of the registry's.
///
/// # Safety
/// The registry is Unity's, and `T` is the table of that number.
pub(crate) unsafe fn table<T: Copy>(registry: &Interfaces, guid: Guid) -> Option<T> {
    let get = registry.get_split?;
    // SAFETY: a function of the registry, which takes two numbers.
    let found = unsafe { get(guid.high, guid.low) }.cast::<T>();
    // SAFETY: what is not null is a table of that kind, by the caller's promise.
    (!found.is_null() && found.is_aligned()).then(|| unsafe { found.read() })
}
