//! The plugin's life cycle: Unity loads it, its graphics device appears and disappears, Unity unloads it.
//!
//! No lock is held during calls into Unity, because Unity may call back.

use std::ffi::{c_int, c_void};
use std::sync::Arc;

use cairn::abi::results::{CAIRN_ERROR_DEVICE, CAIRN_ERROR_UNSUPPORTED, CAIRN_NOT_READY, CAIRN_OK, cairn_result};
use cairn::locks::Mutex;

use super::drawing::Drawing;
use super::interfaces::*;
use super::{guarded, views};

/// The project setting that selects the graphics API.
const SETTING: &str = "In Project Settings > Player > Other Settings turn off Auto Graphics API for Windows, and put Direct3D12 at the \
                       top of Graphics APIs for Windows; the editor then has to be restarted";

/// Number of reserved event numbers: `MAKE` and `SHOW`, counted from the first.
const EVENTS: c_int = 2;

/// Action of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Event {
    /// Makes the frame, where Unity's queue may be used.
    Make,
    /// Copies it into Unity's texture, where Unity records.
    Show,
}

static PLUGIN: Mutex<Plugin> =
    Mutex::new(Plugin { interfaces: None, graphics: None, first_event: None, state: State::NotLoaded });

struct Plugin {
    interfaces: Option<Interfaces>,
    graphics: Option<Graphics>,
    first_event: Option<c_int>,
    state: State,
}

/// Whether frames can be drawn.
#[derive(Clone)]
enum State {
    /// Unity has not loaded the plugin, or has unloaded it.
    NotLoaded,
    /// There is no graphics device yet, or none any more.
    NoDevice,
    /// Frames can never be drawn in this process: the result and the reason.
    Never(cairn_result, String),
    Ready(Arc<Drawing>),
}

/// Unity calls this when it loads the library.
///
/// # Safety
/// The pointer is null, or Unity's registry, which lives until [`UnityPluginUnload`].
#[unsafe(no_mangle)]
pub unsafe extern "system" fn UnityPluginLoad(interfaces: *const c_void) {
    guarded((), || {
        unload();
        let registry = interfaces.cast::<Interfaces>();
        if registry.is_null() || !registry.is_aligned() {
            PLUGIN.lock().state = never("Unity gave the plugin no registry of interfaces");
            return;
        }
        // SAFETY: the caller's promise.
        let registry = unsafe { registry.read() };
        // SAFETY: Unity's registry.
        let Some(graphics) = (unsafe { table::<Graphics>(&registry, Graphics::GUID) }) else {
            PLUGIN.lock().state = never("Unity has no interface IUnityGraphics, which all since Unity 5.2 have");
            return;
        };
        let first_event = graphics.reserve_events.map(|reserve| {
            // SAFETY: a function of Unity's, called while it loads the plugin.
            unsafe { reserve(EVENTS) }
        });
        *PLUGIN.lock() =
            Plugin { interfaces: Some(registry), graphics: Some(graphics), first_event, state: State::NoDevice };
        if let Some(register) = graphics.register_device_event {
            // SAFETY: as above.
            unsafe { register(Some(on_device)) };
        }
        // The device may exist already; Unity then sends no event.
        initialise();
    });
}

/// Unity calls this before it unloads the library.
///
/// # Safety
/// Unity's registry is still alive, if there was one.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn UnityPluginUnload() {
    guarded((), unload);
}

unsafe extern "system" fn on_device(event: c_int) {
    guarded((), || match event {
        DEVICE_INITIALISE | DEVICE_AFTER_RESET => initialise(),
        DEVICE_SHUTDOWN | DEVICE_BEFORE_RESET => shut_down(),
        _ => {}
    });
}

/// Releases everything that belongs to Unity.
fn unload() {
    shut_down();
    let left = std::mem::replace(
        &mut *PLUGIN.lock(),
        Plugin { interfaces: None, graphics: None, first_event: None, state: State::NotLoaded },
    );
    if let Some(unregister) = left.graphics.and_then(|graphics| graphics.unregister_device_event) {
        // SAFETY: a function of Unity's, whose registry lives until this returns.
        unsafe { unregister(Some(on_device)) };
    }
}

/// Releases the device and waits until it has finished the work that was submitted.
fn shut_down() {
    let left = {
        let mut plugin = PLUGIN.lock();
        match plugin.state {
            State::NotLoaded => return,
            _ => std::mem::replace(&mut plugin.state, State::NoDevice),
        }
    };
    if let State::Ready(drawing) = left {
        views::release();
        drawing.finish();
    }
}

/// Starts using the current device.
fn initialise() {
    let (interfaces, graphics, first_event) = {
        let plugin = PLUGIN.lock();
        match (plugin.interfaces, plugin.graphics, &plugin.state) {
            (Some(interfaces), Some(graphics), State::NoDevice | State::Never(..)) => {
                (interfaces, graphics, plugin.first_event)
            }
            _ => return,
        }
    };
    let state = match graphics.get_renderer {
        // SAFETY: a function of Unity's, which any thread may call.
        Some(get) => match unsafe { get() } {
            RENDERER_D3D12 => open_direct3d12(&interfaces, first_event),
            // A device may still come. In batch mode without graphics none comes.
            RENDERER_NULL => State::NoDevice,
            other => never(&format!("Unity draws with {}, and Cairn needs Direct3D 12. {SETTING}", name(other))),
        },
        None => never("Unity's IUnityGraphics does not say what it draws with"),
    };
    PLUGIN.lock().state = state;
}

/// Opens Direct3D 12 through the newest interface version.
fn open_direct3d12(interfaces: &Interfaces, first_event: Option<c_int>) -> State {
    // SAFETY: Unity's registry.
    let Some(api) = (unsafe { Direct3d12::find(interfaces) }) else {
        return never(
            "this Unity has none of IUnityGraphicsD3D12v5 to IUnityGraphicsD3D12v8. Use Unity 2021.3 or a later one",
        );
    };
    let Some(first) = first_event else { return never("Unity's IUnityGraphics reserves no events") };
    if let Some(configure) = api.configure_event {
        // `make` submits lists that write to a texture that no list of Unity's reads any more: no flush or wait is needed.
        let make = EventConfig { queue_access: QUEUE_ALLOWED, flags: 0, binds_render_texture: 0 };
        // `show` copies and changes no bindings. A list of the plugin's own is executed after Unity's lists.
        let show = EventConfig { queue_access: QUEUE_LEFT_ALONE, flags: 0, binds_render_texture: 0 };
        for (event, config) in (first..).zip([make, show]) {
            // SAFETY: a function of Unity's, called while the device is initialised; the struct is read during the call.
            unsafe { configure(event, &config) };
        }
    }
    match Drawing::new(api) {
        Ok(drawing) => State::Ready(Arc::new(drawing)),
        Err(why) => State::Never(CAIRN_ERROR_DEVICE, why),
    }
}

fn never(why: &str) -> State {
    State::Never(CAIRN_ERROR_UNSUPPORTED, why.to_owned())
}

/// A renderer's name in Unity's settings.
fn name(renderer: c_int) -> String {
    let known = match renderer {
        RENDERER_D3D11 => "Direct3D11",
        RENDERER_VULKAN => "Vulkan",
        RENDERER_OPENGL => "OpenGLCore",
        RENDERER_OPENGL_ES => "OpenGLES3",
        RENDERER_METAL => "Metal",
        other => return format!("a renderer of number {other}"),
    };
    known.to_owned()
}

/// The device to draw with, if there is one.
pub(crate) fn drawing() -> Option<Arc<Drawing>> {
    match &PLUGIN.lock().state {
        State::Ready(drawing) => Some(drawing.clone()),
        _ => None,
    }
}

/// Action of an event number, and the device to draw with.
pub(crate) fn event(number: c_int) -> Option<(Arc<Drawing>, Event)> {
    let plugin = PLUGIN.lock();
    let State::Ready(drawing) = &plugin.state else { return None };
    match number.checked_sub(plugin.first_event?)? {
        0 => Some((drawing.clone(), Event::Make)),
        1 => Some((drawing.clone(), Event::Show)),
        _ => None,
    }
}

/// Number of an event.
pub(crate) fn number(event: Event) -> Option<c_int> {
    PLUGIN.lock().first_event.map(|first| first + c_int::from(event == Event::Show))
}

/// Whether frames can be drawn, with the interface's name or the reason why not.
pub(crate) fn state() -> (cairn_result, String) {
    match &PLUGIN.lock().state {
        State::NotLoaded => (
            CAIRN_NOT_READY,
            "Unity has not loaded the plugin. In its import settings tick Load on startup, and restart the editor"
                .to_owned(),
        ),
        State::NoDevice => (CAIRN_NOT_READY, "Unity has no graphics device, as with -nographics".to_owned()),
        State::Never(result, why) => (*result, why.clone()),
        State::Ready(drawing) => (CAIRN_OK, format!("IUnityGraphicsD3D12v{}", drawing.version())),
    }
}
