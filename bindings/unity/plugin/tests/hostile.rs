//! The plugin in a Unity that offers no usable interface, and with wrong calls. On every system.

use std::ffi::{c_int, c_void};
use std::ptr::{null, null_mut, without_provenance_mut};
use std::sync::atomic::{AtomicI32, AtomicU32, AtomicUsize, Ordering};

use cairn::abi::results::{
    CAIRN_ERROR_INVALID_ARGUMENT, CAIRN_ERROR_INVALID_HANDLE, CAIRN_ERROR_STRUCT_SIZE, CAIRN_ERROR_UNSUPPORTED,
    CAIRN_NOT_READY, CAIRN_OK,
};
use cairn_unity::interfaces::*;
use cairn_unity::*;

/// A process has one plugin, so the tests run one at a time.
static ONE_AT_A_TIME: std::sync::Mutex<()> = std::sync::Mutex::new(());
static RENDERER: AtomicI32 = AtomicI32::new(0);
static REGISTERED: AtomicUsize = AtomicUsize::new(0);
static RESERVED: AtomicU32 = AtomicU32::new(0);

/// Whether the registry has Direct3D 12 tables whose functions are all null.
static HAS_EMPTY_TABLES: AtomicU32 = AtomicU32::new(0);

unsafe extern "system" fn renderer() -> c_int {
    RENDERER.load(Ordering::SeqCst)
}

unsafe extern "system" fn register(event: Option<DeviceEvent>) {
    REGISTERED.store(event.map_or(0, |event| event as usize), Ordering::SeqCst);
}

unsafe extern "system" fn unregister(event: Option<DeviceEvent>) {
    assert_eq!(REGISTERED.swap(0, Ordering::SeqCst), event.map_or(0, |event| event as usize));
}

unsafe extern "system" fn reserve(count: c_int) -> c_int {
    RESERVED.fetch_add(count as u32, Ordering::SeqCst);
    100
}

static GRAPHICS: Graphics = Graphics {
    get_renderer: Some(renderer),
    register_device_event: Some(register),
    unregister_device_event: Some(unregister),
    reserve_events: Some(reserve),
};

/// As many null pointers as the longest table has functions.
static EMPTY: [usize; 15] = [0; 15];

unsafe extern "system" fn get(high: u64, low: u64) -> *const c_void {
    match (Guid { high, low }) {
        Graphics::GUID => (&raw const GRAPHICS).cast(),
        _ if HAS_EMPTY_TABLES.load(Ordering::SeqCst) != 0 => EMPTY.as_ptr().cast(),
        _ => null(),
    }
}

unsafe extern "system" fn get_nothing(_: u64, _: u64) -> *const c_void {
    null()
}

fn registry(get: unsafe extern "system" fn(u64, u64) -> *const c_void) -> Interfaces {
    Interfaces { get: 0, register: 0, get_split: Some(get), register_split: 0 }
}

/// State of the plugin and its text.
fn state() -> (i32, String) {
    let (mut text, mut length) = ([0_u8; 512], 0);
    // SAFETY: the buffer has the stated capacity, and `length` can be written.
    let result = unsafe { cairn_unity_state(text.as_mut_ptr().cast(), text.len(), &mut length) };
    (result, String::from_utf8_lossy(&text[..length]).into_owned())
}

fn load(registry: *const Interfaces) {
    // SAFETY: null or a registry that lives.
    unsafe { UnityPluginLoad(registry.cast()) };
}

fn unload() {
    // SAFETY: the registry lives.
    unsafe { UnityPluginUnload() };
}

#[test]
fn missing_interfaces_are_reported_with_a_remedy() {
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner());
    unload();
    let reserved = RESERVED.load(Ordering::SeqCst);
    assert_eq!(state().0, CAIRN_NOT_READY);
    assert!(state().1.contains("Load on startup"), "{:?}", state());
    load(null());
    assert_eq!(state().0, CAIRN_ERROR_UNSUPPORTED);
    assert!(state().1.contains("registry"), "{:?}", state());
    load(without_provenance_mut(1));
    assert!(state().1.contains("registry"), "misaligned: {:?}", state());
    let empty = registry(get_nothing);
    load(&empty);
    assert!(state().0 == CAIRN_ERROR_UNSUPPORTED && state().1.contains("IUnityGraphics"), "{:?}", state());
    let none = Interfaces { get_split: None, ..empty };
    load(&none);
    assert!(state().1.contains("IUnityGraphics"), "{:?}", state());
    assert_eq!(RESERVED.load(Ordering::SeqCst), reserved);

    let unity = registry(get);
    for (renderer, name) in [(2, "Direct3D11"), (21, "Vulkan"), (17, "OpenGLCore"), (11, "OpenGLES3"), (77, "77")] {
        RENDERER.store(renderer, Ordering::SeqCst);
        load(&unity);
        let (result, why) = state();
        assert_eq!(result, CAIRN_ERROR_UNSUPPORTED);
        for part in [name, "Direct3D 12", "Project Settings > Player", "Graphics APIs"] {
            assert!(why.contains(part), "{part}: {why}");
        }
        let mut device = null_mut();
        // SAFETY: the handle's variable can be written.
        assert_eq!(unsafe { cairn_unity_create_device(&mut device) }, CAIRN_ERROR_UNSUPPORTED);
        assert!(device.is_null());
    }
    // Without graphics, then with Direct3D 12 in a Unity that is too old, or whose tables have no functions.
    RENDERER.store(4, Ordering::SeqCst);
    load(&unity);
    assert!(state().0 == CAIRN_NOT_READY && state().1.contains("-nographics"), "{:?}", state());
    RENDERER.store(18, Ordering::SeqCst);
    // Each load registered the callback again, and each unload removed it.
    let event = REGISTERED.load(Ordering::SeqCst);
    assert_ne!(event, 0);
    // SAFETY: the plugin's own function.
    let event: DeviceEvent = unsafe { std::mem::transmute(event) };
    for tables in [0, 1] {
        HAS_EMPTY_TABLES.store(tables, Ordering::SeqCst);
        for kind in [DEVICE_SHUTDOWN, DEVICE_INITIALISE, 4, -1, DEVICE_INITIALISE] {
            // SAFETY: as Unity calls it.
            unsafe { event(kind) };
        }
        let (result, why) = state();
        assert!(result == CAIRN_ERROR_UNSUPPORTED && why.contains("IUnityGraphicsD3D12v8"), "{why}");
    }
    unload();
    unload();
    assert_eq!((REGISTERED.load(Ordering::SeqCst), state().0), (0, CAIRN_NOT_READY));
}

#[test]
fn events_and_entry_points_accept_any_arguments() {
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner());
    unload();
    assert_eq!((cairn_unity_get_make_event(), cairn_unity_get_show_event()), (-1, -1));
    RENDERER.store(2, Ordering::SeqCst);
    let unity = registry(get);
    load(&unity);
    assert_eq!((cairn_unity_get_make_event(), cairn_unity_get_show_event()), (100, 101));
    let event = cairn_unity_get_event_function();
    let foreign: [*mut c_void; 4] = [
        null_mut(),
        without_provenance_mut(1),
        without_provenance_mut(usize::MAX),
        (&raw const EMPTY).cast_mut().cast(),
    ];
    for number in [c_int::MIN, -1, 0, 99, 100, 101, 102, c_int::MAX] {
        for data in foreign {
            // SAFETY: any number and any data are allowed.
            unsafe { event(number, data) };
        }
    }
    let (device, presenter) = (without_provenance_mut(8), without_provenance_mut(8));
    let mut view = null_mut();
    // SAFETY: pointers are null or writable, and handles are looked up.
    unsafe {
        assert_eq!(cairn_unity_prepare(null(), presenter, 1, 1, 0, 0, null()), CAIRN_ERROR_INVALID_HANDLE);
        assert_eq!(cairn_unity_prepare(device, null(), 1, 1, 0, 0, null()), CAIRN_ERROR_INVALID_HANDLE);
        assert_eq!(
            cairn_unity_prepare(device, presenter, 1, 1, 0, 0, c"pipelines".as_ptr()),
            CAIRN_ERROR_INVALID_HANDLE
        );
        assert_eq!(cairn_unity_prepare(device, presenter, 1, 1, 0, 0, c"\xFF".as_ptr()), CAIRN_ERROR_INVALID_ARGUMENT);
        assert_eq!(cairn_unity_view_create(device, presenter, null_mut()), CAIRN_ERROR_INVALID_ARGUMENT);
        assert_eq!(cairn_unity_view_create(null(), presenter, &mut view), CAIRN_ERROR_INVALID_HANDLE);
        assert_eq!(cairn_unity_view_create(device, null_mut(), &mut view), CAIRN_ERROR_INVALID_HANDLE);
        assert!(view.is_null());
        assert_eq!(cairn_unity_view_create(device, presenter, &mut view), CAIRN_OK);
        assert_eq!(cairn_unity_view_set(view, 0, null_mut()), CAIRN_OK);
        let mut frame: cairn::abi::presenter::cairn_frame = std::mem::zeroed();
        let mut shown = 7;
        let get = |frame, shown| cairn_unity_view_get(view, shown, frame, null_mut(), 0, null_mut());
        assert_eq!(get(&raw mut frame, &raw mut shown), CAIRN_ERROR_STRUCT_SIZE);
        frame.struct_size = size_of_val(&frame) as u32;
        assert_eq!(get((&raw mut frame).byte_add(1), &raw mut shown), CAIRN_ERROR_INVALID_ARGUMENT);
        assert_eq!((shown, get(&raw mut frame, &raw mut shown), shown), (7, CAIRN_NOT_READY, 0));
        assert_eq!((get(null_mut(), null_mut()), frame.source), (CAIRN_NOT_READY, 0));
        // With Direct3D 11 nothing is drawn.
        for number in [100, 101] {
            event(number, view.cast());
        }
        assert_eq!(get(null_mut(), null_mut()), CAIRN_NOT_READY);
        for other in [null_mut(), without_provenance_mut(1), view.wrapping_byte_add(1)] {
            assert_eq!(cairn_unity_view_set(other, 0, null_mut()), CAIRN_ERROR_INVALID_HANDLE);
            let told = cairn_unity_view_get(other, null_mut(), null_mut(), null_mut(), 0, null_mut());
            assert_eq!(told, CAIRN_ERROR_INVALID_HANDLE);
            let destroyed = if other.is_null() { CAIRN_OK } else { CAIRN_ERROR_INVALID_HANDLE };
            assert_eq!(cairn_unity_view_destroy(other), destroyed);
        }
        assert_eq!(cairn_unity_view_destroy(view), CAIRN_OK);
        assert_eq!(cairn_unity_view_destroy(view), CAIRN_ERROR_INVALID_HANDLE);
        let path = cairn_unity_path(null_mut(), 0, null_mut());
        assert_eq!(path, if cfg!(windows) { CAIRN_OK } else { CAIRN_ERROR_UNSUPPORTED });
    }
    assert_eq!(cairn_unity_version(), CAIRN_UNITY_VERSION);
    unload();
}
