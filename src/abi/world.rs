//! Worlds: bundles loaded on a device.

use std::cell::Cell;
use std::ffi::{c_char, c_void};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::boundary::call;
use super::device::{cairn_device, precision, precision_number};
use super::handles::{Handle, Kind, Object, destroy, enter, insert_to};
use super::results::{AbiResult, CAIRN_OK, cairn_result};
use super::structs::{Out, check_flags, check_out, check_zero, describe, read};
use super::text::{copy_text, fixed_text, optional_text};
use crate::bundle::{Bundle, OpenOptions};
use crate::runtime::Device;
use crate::world::{OperatingPoint, Preset, World, WorldOptions};
use crate::{Error, ErrorKind};

/// A stage of loading: reads and checks files; done and total count bytes.
pub const CAIRN_LOAD_READING: u32 = 1;
/// A stage of loading: ONNX Runtime prepares the graphs; done and total count graphs.
pub const CAIRN_LOAD_PREPARING: u32 = 2;

/// Progress of loading.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_load_progress {
    /// sizeof(cairn_load_progress) in this library.
    pub struct_size: u32,
    /// CAIRN_LOAD_READING, then CAIRN_LOAD_PREPARING
    pub stage: u32,
    /// Units of the stage that are done.
    pub done: u64,
    /// Units of the stage in total.
    pub total: u64,
}
describe!(cairn_load_progress, [], { struct_size, stage, done, total });

/// Gets the progress of a load, on the thread that called cairn_world_load, after every mebibyte and every graph, without any lock
/// held. progress is valid during the call only; user is the pointer in the options. If the callback does not return 0, the load ends
/// with CAIRN_ERROR_CANCELLED before anything more is read or run. It may call Cairn, except to destroy the device, and must not throw.
pub type cairn_load_callback =
    Option<unsafe extern "C" fn(progress: *const cairn_load_progress, user: *mut c_void) -> u32>;

/// A loaded world. It may have any number of rollouts, which share its weights.
pub struct cairn_world(());

/// The object of a world's handle.
pub(super) struct LoadedWorld {
    pub(super) world: Arc<World>,
    /// Default operating point of its rollouts.
    pub(super) point: OperatingPoint,
    licence: Option<String>,
}

impl Handle for cairn_world {
    const KIND: Kind = Kind::World;
    const NAME: &'static str = "cairn_world";
    type Object = LoadedWorld;
}

impl Object for LoadedWorld {}

/// A flag of cairn_world_options: if the global window needs more memory than memory_limit or than the adapter has free, the widest
/// window that fits is used instead, and cairn_rollout_info names it. Without the flag the load fails.
pub const CAIRN_WORLD_FIT_WINDOW: u32 = 1;
/// A flag of cairn_world_options, for graphs in CAIRN_PRECISION_F16: makes one latent with the bundle's f32 graphs as well and compares
/// the two. The load fails with CAIRN_ERROR_UNSUPPORTED if a value passes float16's largest number, 65504, or the latent's relative
/// error is more than 3 %; the message names the tensor or layer, and the remedy. The f32 graphs of the transformer are loaded first and
/// dropped then; they need about twice the memory of the f16 graphs' weights. The result depends only on the bundle and the device: one
/// load of both needs it, for example after an installation or a driver's update.
pub const CAIRN_WORLD_CHECK_PRECISION: u32 = 2;

/// Options of loading a world.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_world_options {
    /// sizeof(cairn_world_options)
    pub struct_size: u32,
    /// CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16; 0 for the device's default.
    pub precision: u32,
    /// Path of the bundle, a directory or an archive, UTF-8. Null for the world embedded in this library, if there is one.
    pub path: *const c_char,
    /// Operating point of its rollouts, UTF-8: a preset ("coherence", "baseline-128", "baseline-112", "baseline-doubled", "decoded-60",
    /// "heavy", "stock"), with changes after commas: "stock,g64,native". Null for "stock" with the bundle's own global window. The global
    /// window is fixed for the world; the rest may differ from rollout to rollout, but "joined" needs a world that was loaded with it.
    pub operating_point: *const c_char,
    /// Limit in bytes on the memory of the world with one rollout; 0 for what the system has available.
    pub memory_limit: u64,
    /// Gets the progress and can cancel the load; null for none.
    pub progress: cairn_load_callback,
    /// Passed to the callback.
    pub user: *mut c_void,
    /// CAIRN_WORLD_FIT_WINDOW, CAIRN_WORLD_CHECK_PRECISION
    pub flags: u32,
    /// 0
    pub reserved: u32,
    /// Number of slices of the transformer, 1 to the number of its layers: graphs of consecutive layers that run one after the other. Between
    /// two slices of a pass an engine's frame gets its turn on the device, and cairn_rollout_cancel ends the step. On the processor every
    /// number of slices gives the same bits in CAIRN_PRECISION_F32. More slices need more memory. 0 for 1, or with longest_submission_us for as
    /// many as the limit needs.
    pub slices: u32,
    /// Limit on the time of a slice in microseconds; 0 for none. With slices 0, passes are measured at load, by the device's own clock if
    /// it has one, and the transformer gets the fewest slices of which the longest is within the limit; if none is, as many as there are
    /// layers, or as fit in memory. cairn_world_info has the number and the time. Such a load takes several times as long. On Direct3D 12,
    /// rollouts of this world also wait before they submit more work than this, as with cairn_d3d12_options.longest_submission_us.
    pub longest_submission_us: u32,
}
describe!(cairn_world_options, [48, 56], {
    struct_size, precision, path, operating_point, memory_limit, progress, user, flags, reserved, slices, longest_submission_us,
});

/// Properties of a world.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_world_info {
    /// sizeof(cairn_world_info)
    pub struct_size: u32,
    /// Precision of the graphs: CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16
    pub precision: u32,
    /// Size of an anchor's pictures, in square pixels.
    pub render_width: u32,
    /// See render_width.
    pub render_height: u32,
    /// Size of the autoencoder's decoded pictures, whose pixels may not be square.
    pub decoded_width: u32,
    /// See decoded_width.
    pub decoded_height: u32,
    /// Shape of a latent: [channels, height, width].
    pub latent_channels: u32,
    /// See latent_channels.
    pub latent_height: u32,
    /// See latent_channels.
    pub latent_width: u32,
    /// Tokens of a latent.
    pub tokens: u32,
    /// Layers of the transformer.
    pub layers: u32,
    /// Pictures decoded from one latent.
    pub pictures_per_latent: u32,
    /// Context window of a local layer, in latents.
    pub local_window: u32,
    /// g: context window of a global layer, in latents, as loaded.
    pub global_window: u32,
    /// The largest g that the bundle allows.
    pub max_global_window: u32,
    /// g is a multiple of this.
    pub global_dilation: u32,
    /// Latents per second of world time for which the model was made.
    pub latents_per_second: u32,
    /// Number of keys that the model knows: virtual-key codes from 0 to this minus 1.
    pub keys: u32,
    /// The world's name, for people; UTF-8.
    pub name: [c_char; 128],
    /// The licence as an SPDX expression; cairn_world_get_licence has its text.
    pub licence: [c_char; 64],
    /// The bundle's identity: SHA-256 of its manifest, in hexadecimal.
    pub digest: [c_char; 72],
    /// Slices of the transformer.
    pub slices: u32,
    /// Time of the longest slice in microseconds, as measured at load; 0 if the number of slices was not chosen by
    /// cairn_world_options.longest_submission_us.
    pub longest_slice_us: u32,
}
describe!(cairn_world_info, [336], {
    struct_size, precision, render_width, render_height, decoded_width, decoded_height, latent_channels, latent_height,
    latent_width, tokens, layers, pictures_per_latent, local_window, global_window, max_global_window, global_dilation,
    latents_per_second, keys, name, licence, digest, slices, longest_slice_us,
});

/// Bytes that a world and one rollout need.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_world_memory {
    /// sizeof(cairn_world_memory)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// The bundle's files, while they are loaded.
    pub bundle: u64,
    /// Weights as ONNX Runtime holds them, and those that the world keeps in the host's memory for noise levels that it has not seen yet.
    pub weights: u64,
    /// Keys and values of one rollout's ring. Each further rollout needs this, the slabs, and a part of the intermediate values.
    pub ring: u64,
    /// Keys and values of the current latent.
    pub slabs: u64,
    /// Intermediate values of a pass, and the largest matrix that a pass unpacks from 8 or 4 bits.
    pub intermediates: u64,
    /// Intermediate values, pictures and state of encoder and decoder.
    pub autoencoder: u64,
    /// Overhead of ONNX Runtime's allocator.
    pub arena: u64,
    /// The sum.
    pub total: u64,
}
describe!(cairn_world_memory, [], {
    struct_size, reserved, bundle, weights, ring, slabs, intermediates, autoencoder, arena, total,
});

/// Loads a world: reads and checks the bundle, compares the memory it needs with the memory available, and prepares its graphs. Takes
/// seconds to minutes with real weights, so call it off the render thread; the callback reports progress and can cancel the load.
///
/// device: kept alive by the world.
///
/// Ownership: on success *world is the caller's, for cairn_world_destroy; on failure it is not written and nothing is kept. What
/// options point to is read during the call only.
/// Threads: any thread, at any time, also several loads at once.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for an operating point that does not fit the
/// world, for more slices than the transformer can have, and for joined passes in slices or with a limit on submissions; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_IO; CAIRN_ERROR_INVALID_BUNDLE;
/// CAIRN_ERROR_UNSUPPORTED for another version of the format, a precision the bundle does not have or that CAIRN_WORLD_CHECK_PRECISION
/// refuses, joined passes that the bundle does not have, or no embedded world; CAIRN_ERROR_OUT_OF_MEMORY with the numbers;
/// CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_world_load(
    device: *const cairn_device,
    options: *const cairn_world_options,
    world: *mut *mut cairn_world,
) -> cairn_result {
    call("cairn_world_load", || {
        let device = enter(device)?;
        check_out(world, "world")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { read(options, "options") }?;
        // SAFETY: the host's promise about what options point to.
        let path = unsafe { optional_text(options.path, "options.path") }?;
        // SAFETY: as above.
        let point = unsafe { optional_text(options.operating_point, "options.operating_point") }?;
        let loaded = load(&device, path, point, &options)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_world>(loaded, world) }
    })
}

/// Gives the properties of a world.
///
/// Ownership: info stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_world_get_info(world: *const cairn_world, info: *mut cairn_world_info) -> cairn_result {
    call("cairn_world_get_info", || {
        let loaded = enter(world)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::new(info, "info") }?;
        let world = &loaded.world;
        let manifest = world.manifest();
        let geometry = &manifest.geometry;
        let ((render_width, render_height), (decoded_width, decoded_height)) =
            (world.render_size(), world.decoded_size());
        info.write(&cairn_world_info {
            struct_size: 0,
            precision: precision_number(world.precision()),
            render_width,
            render_height,
            decoded_width,
            decoded_height,
            latent_channels: geometry.latent.channels,
            latent_height: geometry.latent.height,
            latent_width: geometry.latent.width,
            tokens: geometry.tokens,
            layers: geometry.layers,
            pictures_per_latent: geometry.autoencoder.temporal,
            local_window: geometry.local.window,
            global_window: world.global_window(),
            max_global_window: geometry.global.max_window,
            global_dilation: geometry.global.dilation,
            latents_per_second: manifest.rates.latents_per_second,
            keys: manifest.controls.buttons,
            name: fixed_text(&manifest.name),
            licence: fixed_text(&manifest.licence.spdx),
            digest: fixed_text(world.digest()),
            slices: world.slices(),
            longest_slice_us: world.longest_slice().map_or(0, microseconds),
        });
        Ok(CAIRN_OK)
    })
}

/// Gives the memory that a world with one rollout needs, as computed before loading.
///
/// Ownership: memory stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_world_get_memory(
    world: *const cairn_world,
    memory: *mut cairn_world_memory,
) -> cairn_result {
    call("cairn_world_get_memory", || {
        let loaded = enter(world)?;
        // SAFETY: the host's promise about `memory`.
        let memory = unsafe { Out::new(memory, "memory") }?;
        let need = loaded.world.memory_need();
        memory.write(&cairn_world_memory {
            struct_size: 0,
            reserved: 0,
            bundle: need.bundle,
            weights: need.weights.saturating_add(need.conditioning),
            ring: need.ring,
            slabs: need.slabs,
            intermediates: need.intermediates.saturating_add(need.unpacked),
            autoencoder: need.autoencoder,
            arena: need.arena,
            total: need.total,
        });
        Ok(CAIRN_OK)
    })
}

/// Copies the text of the world's licence; empty if the bundle has none.
///
/// text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
/// length: gets the length in bytes of the whole text, without the NUL; may be null.
///
/// Ownership: the text is copied; on failure nothing is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_world_get_licence(
    world: *const cairn_world,
    text: *mut c_char,
    capacity: usize,
    length: *mut usize,
) -> cairn_result {
    call("cairn_world_get_licence", || {
        let world = enter(world)?;
        // SAFETY: the host's promise about the buffer.
        unsafe { copy_text(world.licence.as_deref().unwrap_or_default(), text, capacity, length) }
    })
}

/// Destroys the handle of a world; null is allowed. Its rollouts keep it alive.
///
/// Ownership: on success world is no longer a handle; on failure it is unchanged.
/// Threads: any thread; waits for calls in flight on the world.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_world_destroy(world: *mut cairn_world) -> cairn_result {
    call("cairn_world_destroy", || destroy(world))
}

fn load(
    device: &Device,
    path: Option<&str>,
    point: Option<&str>,
    options: &cairn_world_options,
) -> AbiResult<LoadedWorld> {
    check_flags(options.flags, CAIRN_WORLD_FIT_WINDOW | CAIRN_WORLD_CHECK_PRECISION, "options.flags")?;
    check_zero(options.reserved, "options.reserved")?;
    let point = point.map(str::parse::<OperatingPoint>).transpose()?;
    let precision = precision(options.precision, "options.precision")?;
    let reporter =
        ProgressReporter { callback: options.progress, user: options.user, cancelled: AtomicBool::new(false) };
    let read =
        |progress: crate::bundle::OpenProgress| reporter.report(CAIRN_LOAD_READING, progress.done, progress.total);
    let open = OpenOptions { progress: Some(&read), cancel: Some(&reporter.cancelled), max_bytes: None };
    let bundle = match path {
        Some(path) => Bundle::open_with(Path::new(path), &open)?,
        None => Bundle::embedded(&open).map_err(|error| error.field("options.path"))?,
    };
    let point = point.unwrap_or_else(|| OperatingPoint {
        global_window: bundle.geometry().global.window,
        ..Preset::Stock.operating_point()
    });
    point.check_for(bundle.geometry())?;
    let world_options = WorldOptions {
        precision,
        memory_limit: Some(options.memory_limit).filter(|limit| *limit > 0),
        fit_window: options.flags & CAIRN_WORLD_FIT_WINDOW != 0,
        check_precision: options.flags & CAIRN_WORLD_CHECK_PRECISION != 0,
        slices: Some(options.slices).filter(|slices| *slices > 0),
        longest_submission: Some(options.longest_submission_us)
            .filter(|limit| *limit > 0)
            .map(|microseconds| Duration::from_micros(microseconds.into())),
        ..WorldOptions::for_point(&point)
    };
    let prepared = Cell::new(0);
    let world = World::load_with(device, &bundle, world_options, &|total| {
        reporter.report(CAIRN_LOAD_PREPARING, prepared.replace(prepared.get() + 1), total);
        reporter.check_cancelled()
    })
    .map_err(|error| match error.offending_field() {
        Some("joined") => error.field("options.operating_point"),
        _ => error,
    })?;
    let point = OperatingPoint { global_window: world.global_window(), ..point };
    Ok(LoadedWorld { licence: bundle.licence_text().map(str::to_owned), world, point })
}

/// Whole microseconds, at least 1, since 0 has a meaning of its own.
fn microseconds(time: Duration) -> u32 {
    u32::try_from(time.as_micros()).unwrap_or(u32::MAX).max(1)
}

/// Calls the host's progress callback, and records whether it cancelled the load.
struct ProgressReporter {
    callback: cairn_load_callback,
    user: *mut c_void,
    cancelled: AtomicBool,
}

impl ProgressReporter {
    fn report(&self, stage: u32, done: u64, total: u64) {
        let Some(callback) = self.callback else { return };
        let progress = cairn_load_progress { struct_size: size_of::<cairn_load_progress>() as u32, stage, done, total };
        // SAFETY: the struct lives through the call; the rest is the host's promise.
        if unsafe { callback(&progress, self.user) } != 0 {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }

    fn check_cancelled(&self) -> crate::Result<()> {
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(Error::new(ErrorKind::Cancelled, "loading was cancelled"));
        }
        Ok(())
    }
}
