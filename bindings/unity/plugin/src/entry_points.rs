//! What C# calls. Results are those of `include/cairn.h`; `bindings/unity/Runtime/Plugin.cs` declares the same.

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

/// The version of these doors, which C# compares with its own.
pub const CAIRN_UNITY_VERSION: u32 = 3;

/// A view: its number, never an address.
pub struct cairn_unity_view(());

/// [`CAIRN_UNITY_VERSION`].
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_version() -> u32 {
    CAIRN_UNITY_VERSION
}

/// Whether frames can be shown: `CAIRN_OK`, and the text names Unity's interface; `CAIRN_NOT_READY` where Unity has not loaded the
/// plugin or has no device at the moment; else an error. The text then says why and what can be done.
///
/// Threads: any.
///
/// # Safety
/// `text` is null or has room for `capacity` bytes; `length` is null or can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_state(text: *mut c_char, capacity: usize, length: *mut usize) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        let (result, said) = plugin::state();
        // SAFETY: the caller's promise.
        unsafe { text::copy(&said, text, capacity, length) };
        result
    })
}

/// The file that this library was loaded from, in UTF-8. `CAIRN_ERROR_UNSUPPORTED` where the system does not say.
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

/// Makes a device of Cairn's on Unity's device and queue, for `cairn_device_destroy`. Takes as long as `cairn_device_create_d3d12`,
/// and says the same; `CAIRN_ERROR_UNSUPPORTED`, with nothing new in `cairn_last_error`, where [`cairn_unity_state`] is not
/// `CAIRN_OK`.
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
        // SAFETY: objects of Unity's, to which `drawing` holds references; the place is checked.
        unsafe { cairn_device_create_d3d12(d3d12.cast(), queue.cast(), std::ptr::null_mut(), std::ptr::null(), device) }
    })
}

/// Makes all that a presenter's frames of a size need, in any format, as cairn_presenter_prepare_d3d12 does, and says the same. Blocks, the
/// first time for seconds: to be called on a thread that loads, once the presenter was given an anchor, and again for another size. Frames
/// of a size that is not prepared show the nearest anchor.
///
/// pipelines: a file's path in UTF-8, in which compiled pipelines are kept from one run of the game to the next; null keeps none. The file and
/// its folder are made. One that is damaged, or of another driver, is made anew; one that cannot be written costs the next run its time.
/// `CAIRN_ERROR_INVALID_ARGUMENT` for other than UTF-8.
///
/// Threads: any, beside events too; a second call for the same presenter beside it gets `CAIRN_ERROR_BUSY`.
///
/// # Safety
/// `pipelines` is null or ends with a NUL, and lives during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_prepare(
    device: *const cairn_device,
    presenter: *const cairn_presenter,
    width: u32,
    height: u32,
    pipelines: *const c_char,
) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        // SAFETY: the caller's promise.
        let path = (!pipelines.is_null()).then(|| unsafe { CStr::from_ptr(pipelines) }.to_str());
        let Ok(path) = path.transpose() else { return CAIRN_ERROR_INVALID_ARGUMENT };
        let mut cache = path.map(|path| PipelineCache::new(path.into()));
        let wanted = cairn_d3d12_preparation {
            struct_size: size_of::<cairn_d3d12_preparation>() as u32,
            format: 0,
            width,
            height,
            anchor_width: 0,
            anchor_height: 0,
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
        // SAFETY: handles are looked up; the preparation and the cache live during the call, which alone uses it.
        unsafe { cairn_presenter_prepare_d3d12(presenter, device, &wanted) }
    })
}

/// Makes a view of a presenter, for [`cairn_unity_view_destroy`]. Both handles stay the caller's: once one is destroyed the view's
/// events fail with `CAIRN_ERROR_INVALID_HANDLE`.
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

/// Says what the next events show: the frame that is due at `now_ns`, in `texture`, an `ID3D12Resource` of Unity's as
/// `Texture.GetNativeTexturePtr` gives it. The view holds a reference to it until it is told another; null for none.
/// `CAIRN_ERROR_INVALID_ARGUMENT` for an object of another kind.
///
/// Threads: any.
///
/// # Safety
/// `texture` is null or an object of COM, which lives during the call.
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
        view.want(now_ns, target);
        CAIRN_OK
    })
}

/// Says how the view's last event ended: `CAIRN_OK` and the frame that was made; `CAIRN_NOT_READY` before the first; else an error,
/// and `text` has its message. What is null is not asked for.
///
/// shown: gets the frames that were copied into Unity's textures.
/// frame: its struct_size must be set.
///
/// Threads: any.
///
/// # Safety
/// What is not null can be written; `text` has room for `capacity` bytes.
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
        let (has, result, message) = view.told();
        if !frame.is_null() {
            // SAFETY: checked above; readable by the caller's promise.
            if unsafe { (*frame).struct_size } as usize != size_of::<cairn_frame>() {
                return CAIRN_ERROR_STRUCT_SIZE;
            }
            // SAFETY: as large as it says.
            unsafe { frame.write(has.frame) };
        }
        if !shown.is_null() {
            // SAFETY: checked above; writable by the caller's promise.
            unsafe { shown.write(has.frames) };
        }
        // SAFETY: the caller's promise.
        unsafe { text::copy(&message, text, capacity, length) };
        result
    })
}

/// Ends a view; null is allowed. Events that still name it do nothing, and one that runs is waited for. Nothing is drawn into its
/// texture, which keeps the last frame. What Unity's queue still uses, the texture among it, is let go of when a later view is shown
/// or ended, and with the device.
///
/// Threads: any.
///
/// # Safety
/// Nothing is asked for.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_unity_view_destroy(view: *mut cairn_unity_view) -> cairn_result {
    guarded(CAIRN_ERROR_INTERNAL, || {
        if view.is_null() {
            return CAIRN_OK;
        }
        let Some(view) = views::remove(view.addr()) else { return CAIRN_ERROR_INVALID_HANDLE };
        view.let_go();
        plugin::drawing().into_iter().for_each(|drawing| drawing.tidy());
        CAIRN_OK
    })
}

/// The function for `CommandBuffer.IssuePluginEventAndData`, whose data is a view.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_get_event_function() -> RenderEvent {
    events::on_event
}

/// The number of the event that makes a view's frame; -1 where Unity has not loaded the plugin.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_get_make_event() -> c_int {
    guarded(-1, || plugin::number(Event::Make).unwrap_or(-1))
}

/// The number of the event that copies it into Unity's texture, to be issued behind the other one.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_unity_get_show_event() -> c_int {
    guarded(-1, || plugin::number(Event::Show).unwrap_or(-1))
}
