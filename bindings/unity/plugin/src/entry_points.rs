//! Functions that C# calls. Results are those of `include/cairn.h`; `bindings/unity/Runtime/Plugin.cs` declares the same functions.

use std::ffi::{CStr, c_char, c_int, c_void};

use cairn::abi::d3d12::{
    CAIRN_PREPARE_SUBMIT_ONLY, cairn_d3d12_preparation, cairn_device_create_d3d12, cairn_presenter_prepare_d3d12,
};
use cairn::abi::device::cairn_device;
use cairn::abi::presenter::{cairn_frame, cairn_presenter};
use cairn::abi::results::{
    CAIRN_ERROR_INTERNAL, CAIRN_ERROR_INVALID_ARGUMENT, CAIRN_ERROR_INVALID_HANDLE, CAIRN_ERROR_STRUCT_SIZE,
    CAIRN_ERROR_UNSUPPORTED, CAIRN_OK, cairn_result,
};

use super::drawing::{Target, own_path};
use super::interfaces::RenderEvent;
use super::pipeline_cache::{self, PipelineCache};
use super::plugin::{self, Event};
use super::{events, guarded, text, views};

/// Version of these functions, which C# compares with the one it was written for.
pub const CAIRN_UNITY_VERSION: u32 = 4;

/// Handle of a view: a number, never an address.
pub struct cairn_unity_view(());

/// [`CAIRN_UNITY_VERSION`].
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_version() -> u32 {
    CAIRN_UNITY_VERSION
}

/// Whether frames can be shown. `CAIRN_OK`: yes, and the text names Unity's interface. `CAIRN_NOT_READY`: Unity has not loaded the plugin, or
/// has no device at present. Otherwise an error. In the last two cases the text says why and how to solve it.
///
/// Threads: any.
///
/// # Safety
/// `text` is null or has room for `capacity` bytes; `length` is null or can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_state(text: *mut c_char, capacity: usize, length: *mut usize) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        let (result, description) = plugin::state();
        // SAFETY: the caller's promise.
        unsafe { text::copy(&description, text, capacity, length) };
        result
    })
}

/// Path of the file that this library was loaded from, in UTF-8. `CAIRN_ERROR_UNSUPPORTED` where the system does not tell it.
///
/// Threads: any.
///
/// # Safety
/// As for [`cairn_unity_state`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_path(text: *mut c_char, capacity: usize, length: *mut usize) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        let Some(path) = own_path() else { return CAIRN_ERROR_UNSUPPORTED };
        // SAFETY: the caller's promise.
        unsafe { text::copy(&path, text, capacity, length) };
        CAIRN_OK
    })
}

/// Creates a Cairn device on Unity's device and queue. Destroy it with `cairn_device_destroy`. Duration and results are those of
/// `cairn_device_create_d3d12`. `CAIRN_ERROR_UNSUPPORTED`, without a new message in `cairn_last_error`, where [`cairn_unity_state`]
/// is not `CAIRN_OK`.
///
/// Threads: any.
///
/// # Safety
/// `device` is null or can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_create_device(device: *mut *mut cairn_device) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        let Some(drawing) = plugin::drawing() else { return CAIRN_ERROR_UNSUPPORTED };
        let (d3d12, queue) = drawing.parts();
        // SAFETY: Unity's objects, to which `drawing` holds references; the output pointer was checked.
        unsafe { cairn_device_create_d3d12(d3d12.cast(), queue.cast(), std::ptr::null_mut(), std::ptr::null(), device) }
    })
}

/// Creates everything that a presenter needs for frames of a size, in any format. Results are those of cairn_presenter_prepare_d3d12. Blocks,
/// the first time for seconds, so call it on a loading thread, and again for each other size. Frames of a size that is not prepared show the
/// nearest anchor.
///
/// anchor_width, anchor_height: size of the anchors. Both 0 for that of the anchors that have arrived: CAIRN_NOT_READY, with nothing prepared, if
/// none has, as where the device is still finishing the first one.
///
/// pipelines: path of a file in UTF-8 that keeps compiled pipelines between runs of the game; null for none. The file and its folder are
/// created. A file that is damaged or of another driver is replaced. If it cannot be written, the next run compiles again.
/// `CAIRN_ERROR_INVALID_ARGUMENT` if the path is not UTF-8.
///
/// Threads: any, also during events; a concurrent second call for the same presenter gets `CAIRN_ERROR_BUSY`.
///
/// # Safety
/// `pipelines` is null or ends with a NUL, and lives during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_prepare(
    device: *const cairn_device,
    presenter: *const cairn_presenter,
    width: u32,
    height: u32,
    anchor_width: u32,
    anchor_height: u32,
    pipelines: *const c_char,
) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        // SAFETY: the caller's promise.
        let path = (!pipelines.is_null()).then(|| unsafe { CStr::from_ptr(pipelines) }.to_str());
        let Ok(path) = path.transpose() else { return CAIRN_ERROR_INVALID_ARGUMENT };
        let mut cache = path.map(|path| PipelineCache::new(path.into()));
        let preparation = cairn_d3d12_preparation {
            struct_size: size_of::<cairn_d3d12_preparation>() as u32,
            format: 0,
            width,
            height,
            anchor_width,
            anchor_height,
            anchor_pictures: 0,
            latent_channels: 0,
            latent_height: 0,
            latent_width: 0,
            lists: 0,
            flags: CAIRN_PREPARE_SUBMIT_ONLY,
            load: cache.as_ref().map(|_| pipeline_cache::load as _),
            store: cache.as_ref().map(|_| pipeline_cache::store as _),
            user: cache.as_mut().map_or(std::ptr::null_mut(), |cache| std::ptr::from_mut(cache).cast()),
        };
        // SAFETY: handles are looked up; the options and the cache live during the call, which has exclusive use of the cache.
        unsafe { cairn_presenter_prepare_d3d12(presenter, device, &preparation) }
    })
}

/// Creates a view of a presenter. Destroy it with [`cairn_unity_view_destroy`]. The caller keeps both handles: once one of them is destroyed,
/// the view's events fail with `CAIRN_ERROR_INVALID_HANDLE`.
///
/// Threads: any.
///
/// # Safety
/// `view` is null or can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_view_create(
    device: *const cairn_device,
    presenter: *mut cairn_presenter,
    view: *mut *mut cairn_unity_view,
) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        if view.is_null() || !view.is_aligned() {
            return CAIRN_ERROR_INVALID_ARGUMENT;
        }
        if device.is_null() || presenter.is_null() {
            return CAIRN_ERROR_INVALID_HANDLE;
        }
        let number = views::add(device.addr(), presenter.addr());
        // SAFETY: checked above; writable by the caller's promise.
        unsafe { view.write(std::ptr::without_provenance_mut(number)) };
        CAIRN_OK
    })
}

/// Sets what the next events show: the frame that is due at `now_ns`, in `texture`, an `ID3D12Resource` of Unity's from
/// `Texture.GetNativeTexturePtr`. The view holds a reference to it until another texture is set; null for none.
/// `CAIRN_ERROR_INVALID_ARGUMENT` for an object of another kind.
///
/// Threads: any.
///
/// # Safety
/// `texture` is null or a COM object that lives during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_view_set(
    view: *mut cairn_unity_view,
    now_ns: u64,
    texture: *mut c_void,
) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        let Some(view) = views::find(view.addr()) else { return CAIRN_ERROR_INVALID_HANDLE };
        // SAFETY: the caller's promise.
        let target = unsafe { Target::of_unity(texture) };
        if target.is_none() && !texture.is_null() {
            return CAIRN_ERROR_INVALID_ARGUMENT;
        }
        view.set_next(now_ns, target);
        CAIRN_OK
    })
}

/// Result of the view's last event: `CAIRN_OK` and the frame that was made; `CAIRN_NOT_READY` before the first event; otherwise an error, and
/// `text` gets its message. Any pointer may be null.
///
/// shown: gets the number of frames that were copied into Unity's textures.
/// frame: its struct_size must be set.
///
/// Threads: any.
///
/// # Safety
/// Each pointer is null or can be written; `text` has room for `capacity` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_view_get(
    view: *const cairn_unity_view,
    shown: *mut u64,
    frame: *mut cairn_frame,
    text: *mut c_char,
    capacity: usize,
    length: *mut usize,
) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        let Some(view) = views::find(view.addr()) else { return CAIRN_ERROR_INVALID_HANDLE };
        if !shown.is_aligned() || !frame.is_aligned() {
            return CAIRN_ERROR_INVALID_ARGUMENT;
        }
        let (progress, result, message) = view.status();
        if !frame.is_null() {
            // SAFETY: checked above; readable by the caller's promise.
            if unsafe { (*frame).struct_size } as usize != size_of::<cairn_frame>() {
                return CAIRN_ERROR_STRUCT_SIZE;
            }
            // SAFETY: as large as it says.
            unsafe { frame.write(progress.frame) };
        }
        if !shown.is_null() {
            // SAFETY: checked above; writable by the caller's promise.
            unsafe { shown.write(progress.frames) };
        }
        // SAFETY: the caller's promise.
        unsafe { text::copy(&message, text, capacity, length) };
        result
    })
}

/// Destroys a view; null is allowed. Waits for an event of the view that is running; later events do nothing. The texture keeps its last
/// frame. Resources that Unity's queue still uses, the texture included, are released when a later view is shown or destroyed, or
/// with the device.
///
/// Threads: any.
///
/// # Safety
/// None: the handle is looked up.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_view_destroy(view: *mut cairn_unity_view) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        if view.is_null() {
            return CAIRN_OK;
        }
        let Some(view) = views::remove(view.addr()) else { return CAIRN_ERROR_INVALID_HANDLE };
        view.release();
        plugin::drawing().into_iter().for_each(|drawing| drawing.release_finished());
        CAIRN_OK
    })
}

/// The function for `CommandBuffer.IssuePluginEventAndData`. Its data is a view.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_get_event_function() -> RenderEvent {
    events::on_event
}

/// Number of the event that makes a view's frame; -1 if Unity has not loaded the plugin.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_get_make_event() -> c_int {
    guarded(-1, || plugin::number(Event::Make).unwrap_or(-1))
}

/// Number of the event that copies the frame into Unity's texture. Issue it after the other one.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_get_show_event() -> c_int {
    guarded(-1, || plugin::number(Event::Show).unwrap_or(-1))
}
