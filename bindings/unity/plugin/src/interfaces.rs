//! The part of Unity's native plugin interface that is used here, declared anew.
//!
//! An interface is a table of functions without an object: the registry returns a pointer to the first function, and no function takes the
//! table as an argument. All use the system's calling convention (on x86-64 there is only one). The Direct3D 12 tables do not grow at the
//! end: each version has its own GUID and its own order.

use std::ffi::{c_int, c_void};

/// GUID by which the registry finds an interface.
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

/// A function of a table that is never called; it keeps its slot.
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

/// Called when the graphics device appears or disappears, with one of the constants `DEVICE_*`.
pub type DeviceEvent = unsafe extern "system" fn(c_int);

/// Called on Unity's render or submission thread, with the event's number and its data.
pub type RenderEvent = unsafe extern "system" fn(c_int, *mut c_void);

pub const DEVICE_INITIALISE: c_int = 0;
pub const DEVICE_SHUTDOWN: c_int = 1;
pub const DEVICE_BEFORE_RESET: c_int = 2;
pub const DEVICE_AFTER_RESET: c_int = 3;

/// Renderers that exist on a desktop.
pub const RENDERER_D3D11: c_int = 2;
pub const RENDERER_NULL: c_int = 4;
pub const RENDERER_OPENGL_ES: c_int = 11;
pub const RENDERER_METAL: c_int = 16;
pub const RENDERER_OPENGL: c_int = 17;
pub const RENDERER_D3D12: c_int = 18;
pub const RENDERER_VULKAN: c_int = 21;

/// Interface for any renderer.
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

/// The command list that Unity is recording.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct RecordingState {
    pub list: *mut c_void,
}

/// The event runs on the render thread, where Unity records. It must not use the queue.
pub const QUEUE_LEFT_ALONE: c_int = 0;
/// The event runs on the submission thread. It may use the queue, but not Unity's list.
pub const QUEUE_ALLOWED: c_int = 1;

/// Unity submits its pending lists first.
pub const FLUSH_COMMAND_BUFFERS: u32 = 1 << 1;
/// Unity waits for its worker threads first.
pub const SYNC_WORKER_THREADS: u32 = 1 << 2;
/// The event changes bindings in Unity's list.
pub const MODIFIES_COMMAND_BUFFERS: u32 = 1 << 3;

/// Configuration of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct EventConfig {
    pub queue_access: c_int,
    pub flags: u32,
    /// Not zero: Unity binds the current render target first.
    pub binds_render_texture: u8,
}

pub type GetObject = unsafe extern "system" fn() -> *mut c_void;
pub type GetValue = unsafe extern "system" fn() -> u64;
pub type Execute = unsafe extern "system" fn(*mut c_void, c_int, *mut ResourceState) -> u64;
pub type Configure = unsafe extern "system" fn(c_int, *const EventConfig);
/// Returns one byte, 0 if no list is being recorded.
pub type Recording = unsafe extern "system" fn(*mut RecordingState) -> u8;
pub type Request = unsafe extern "system" fn(*mut c_void, c_int);
pub type Notify = unsafe extern "system" fn(*mut c_void, c_int, u8);

/// Number and GUID of a version in the registry.
pub trait Version {
    const NUMBER: u32;
    const GUID: Guid;
}

/// Functions that are used, of the newest version that Unity has; `None` for a function that this version lacks.
#[derive(Debug, Clone, Copy, Default)]
#[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
pub(crate) struct Direct3d12 {
    pub(crate) version: u32,
    pub(crate) get_device: Option<GetObject>,
    pub(crate) get_frame_fence: Option<GetObject>,
    pub(crate) get_next_frame_fence_value: Option<GetValue>,
    pub(crate) execute_command_list: Option<Execute>,
    pub(crate) get_command_queue: Option<GetObject>,
    pub(crate) configure_event: Option<Configure>,
    pub(crate) command_recording_state: Option<Recording>,
    pub(crate) request_resource_state: Option<Request>,
    pub(crate) notify_resource_state: Option<Notify>,
}

/// Type of a table entry: the function's type if it is used, else the placeholder.
macro_rules! function {
    () => {
        Unused
    };
    ($used:ident) => {
        Option<$used>
    };
}

/// Declares versions of the interface by their functions in Unity's order: used functions with their types, and placeholders.
macro_rules! versions {
    ($($table:ident: $number:literal, $high:literal, $low:literal { $($function:ident $(: $used:ident)?),* $(,)? })*) => {$(
        #[derive(Debug, Clone, Copy)]
        #[repr(C)]
        pub struct $table {
            $(pub $function: function!($($used)?),)*
        }

        impl Version for $table {
            const NUMBER: u32 = $number;
            const GUID: Guid = Guid::new($high, $low);
        }

        impl From<$table> for Direct3d12 {
            fn from(table: $table) -> Self {
                let mut found = Self { version: $table::NUMBER, ..Self::default() };
                $($(found.$function = { let used: Option<$used> = table.$function; used };)?)*
                found
            }
        }
    )*};
}

versions! {
    Direct3d12V5: 5, 0xF5C8_D8A3_7D37_BC42, 0xB02D_FE93_B506_4A27 {
        get_device: GetObject,
        get_frame_fence: GetObject,
        get_next_frame_fence_value: GetValue,
        execute_command_list: Execute,
        set_physical_video_memory_control_values,
        get_command_queue: GetObject,
        texture_from_render_buffer,
    }
    Direct3d12V6: 6, 0xA396_DCE5_8CAC_4D78, 0xAFDD_9B28_1F20_B840 {
        get_device: GetObject,
        get_frame_fence: GetObject,
        get_next_frame_fence_value: GetValue,
        execute_command_list: Execute,
        set_physical_video_memory_control_values,
        get_command_queue: GetObject,
        texture_from_render_buffer,
        texture_from_native_texture,
        configure_event: Configure,
        command_recording_state: Recording,
    }
    Direct3d12V7: 7, 0x4624_B0DA_41B6_4AAC, 0x915A_ABCB_9BC3_F0D3 {
        get_device: GetObject,
        get_swap_chain,
        get_sync_interval,
        get_present_flags,
        get_frame_fence: GetObject,
        get_next_frame_fence_value: GetValue,
        execute_command_list: Execute,
        set_physical_video_memory_control_values,
        get_command_queue: GetObject,
        texture_from_render_buffer,
        texture_from_native_texture,
        configure_event: Configure,
        command_recording_state: Recording,
    }
    Direct3d12V8: 8, 0x9D30_3045_D00D_4CFD, 0x8FEB_B429_68B4_23B6 {
        get_device: GetObject,
        get_swap_chain,
        get_sync_interval,
        get_present_flags,
        get_frame_fence: GetObject,
        get_next_frame_fence_value: GetValue,
        execute_command_list: Execute,
        set_physical_video_memory_control_values,
        get_command_queue: GetObject,
        texture_from_render_buffer,
        texture_from_native_texture,
        configure_event: Configure,
        command_recording_state: Recording,
        request_resource_state: Request,
        notify_resource_state: Notify,
    }
}

impl Direct3d12 {
    /// The newest version in the registry.
    ///
    /// # Safety
    /// The registry is Unity's, whose tables live as long as it does.
    pub(crate) unsafe fn find(registry: &Interfaces) -> Option<Self> {
        // SAFETY: the caller's promise.
        let v8 = unsafe { version::<Direct3d12V8>(registry) };
        // SAFETY: as above.
        let v7 = || unsafe { version::<Direct3d12V7>(registry) };
        // SAFETY: as above.
        let v6 = || unsafe { version::<Direct3d12V6>(registry) };
        // SAFETY: as above.
        let v5 = || unsafe { version::<Direct3d12V5>(registry) };
        v8.or_else(v7).or_else(v6).or_else(v5).filter(Self::is_whole)
    }

    /// Whether it has the functions that every version has.
    fn is_whole(&self) -> bool {
        self.get_device.is_some()
            && self.get_frame_fence.is_some()
            && self.get_next_frame_fence_value.is_some()
            && self.execute_command_list.is_some()
            && self.get_command_queue.is_some()
    }
}

/// The functions that are used of one version, if the registry has it.
///
/// # Safety
/// As for [`Direct3d12::find`].
unsafe fn version<T: Version + Copy + Into<Direct3d12>>(registry: &Interfaces) -> Option<Direct3d12> {
    // SAFETY: the caller's promise; a version's table has its GUID.
    unsafe { table::<T>(registry, T::GUID) }.map(T::into)
}

/// Copy of a table from the registry.
///
/// # Safety
/// The registry is Unity's, and `T` is the table of that GUID.
pub(crate) unsafe fn table<T: Copy>(registry: &Interfaces, guid: Guid) -> Option<T> {
    let get = registry.get_split?;
    // SAFETY: a function of the registry, which takes two numbers.
    let found = unsafe { get(guid.high, guid.low) }.cast::<T>();
    // SAFETY: null or a table of that type, by the caller's promise.
    (!found.is_null() && found.is_aligned()).then(|| unsafe { found.read() })
}
