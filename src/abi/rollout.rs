//! Rollouts: running instances of a world.

use std::ffi::c_char;
use std::time::Duration;

use super::anchor::cairn_anchor;
use super::boundary::call;
use super::controls::{cairn_controls, read_controls};
use super::handles::{Handle, Kind, Object, destroy, enter, enter_serialized, insert_to};
use super::images::{cairn_picture, read_picture};
use super::results::{AbiResult, CAIRN_OK, Failure, cairn_result};
use super::structs::{Out, check_out, describe, read_or_default};
use super::text::{fixed_text, optional_text, required_text};
use super::world::cairn_world;
use crate::Picture;
use crate::world::{Job, OperatingPoint, Rollout, Schedule, StageTotals, StepInfo, Worker};

/// The largest capacity of a rollout's queue, in steps.
pub const CAIRN_MAX_QUEUE: u32 = 64;

/// A flag of cairn_step_info: keys and values of the latent were copied into the ring; with joined passes, those of the latent before.
pub const CAIRN_STEP_COMMITTED: u32 = 1;

/// One running instance of a world: its memory of the past (a ring of keys and values), its clocks and its noise.
pub struct cairn_rollout(());

impl Handle for cairn_rollout {
    const KIND: Kind = Kind::Rollout;
    const NAME: &'static str = "cairn_rollout";
    type Object = Worker;
}

impl Object for Worker {
    fn close(&self) {
        Worker::close(self);
    }

    fn is_on_own_thread(&self) -> bool {
        Worker::is_on_own_thread(self)
    }
}

/// Options of a rollout. All zero: the world's operating point, and seed 0.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_rollout_options {
    /// sizeof(cairn_rollout_options)
    pub struct_size: u32,
    /// Largest number of steps that are waiting, running, or done with a result not yet fetched, 1 to CAIRN_MAX_QUEUE; 0 for 4.
    pub queue_capacity: u32,
    /// Seed of all noise: the same seed, world, device and controls give the same pictures, bit for bit.
    pub seed: u64,
    /// As in cairn_world_options, with the world's global window; null for the world's operating point.
    pub operating_point: *const c_char,
}
describe!(cairn_rollout_options, [], { struct_size, queue_capacity, seed, operating_point });

/// Properties and progress of a rollout.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_rollout_info {
    /// sizeof(cairn_rollout_info)
    pub struct_size: u32,
    /// Pictures of each anchor.
    pub pictures_per_latent: u32,
    /// Latents made so far.
    pub latents: u64,
    /// Seed of its noise.
    pub seed: u64,
    /// Latents per second of world time; each step's controls are summed over one latent.
    pub latents_per_second: u32,
    /// Presentation rate of the operating point, in pictures per second.
    pub presented_rate: u32,
    /// The operating point, UTF-8; cut off if it is longer than 191 bytes, as one with many explicit noise levels is.
    pub operating_point: [c_char; 192],
}
describe!(cairn_rollout_info, [], {
    struct_size, pictures_per_latent, latents, seed, latents_per_second, presented_rate, operating_point,
});

/// Report on one step. Times are nanoseconds of wall time.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_step_info {
    /// sizeof(cairn_step_info)
    pub struct_size: u32,
    /// CAIRN_STEP_COMMITTED, or 0
    pub flags: u32,
    /// Number of the latent made, from 0.
    pub latent: u64,
    /// Denoise passes.
    pub denoise_passes: u32,
    /// Cache passes, which compute keys and values for the ring.
    pub cache_passes: u32,
    /// Encoding a picture into a latent.
    pub encode_ns: u64,
    /// All denoise passes.
    pub denoise_ns: u64,
    /// All cache passes.
    pub cache_ns: u64,
    /// Checking results and copying them into the ring.
    pub commit_ns: u64,
    /// Decoding the latent.
    pub decode_ns: u64,
    /// Bytes copied into the ring.
    pub ring_bytes: u64,
}
describe!(cairn_step_info, [], {
    struct_size, flags, latent, denoise_passes, cache_passes, encode_ns, denoise_ns, cache_ns, commit_ns, decode_ns,
    ring_bytes,
});

/// Creates a rollout without latents. Append a seed picture before the first step.
///
/// world: kept alive by the rollout. options: may be null for the defaults.
///
/// Ownership: on success *rollout is the caller's, for cairn_rollout_destroy; on failure it is not written. What options point to
/// is read during the call only.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_OUT_OF_MEMORY with the numbers; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_create(
    world: *const cairn_world,
    options: *const cairn_rollout_options,
    rollout: *mut *mut cairn_rollout,
) -> cairn_result {
    call("cairn_rollout_create", || {
        let world = enter(world)?;
        check_out(rollout, "rollout")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { read_or_default(options, "options") }?;
        // SAFETY: the host's promise about what options point to.
        let point = unsafe { optional_text(options.operating_point, "options.operating_point") }?;
        let point = point.map(str::parse::<OperatingPoint>).transpose()?.unwrap_or_else(|| world.point.clone());
        let capacity = match options.queue_capacity {
            0 => 4,
            capacity @ 1..=CAIRN_MAX_QUEUE => capacity,
            other => {
                let failure = Failure::argument("options.queue_capacity", format!("{other} steps cannot wait"));
                return Err(failure.remedy(format!("Use 1 to {CAIRN_MAX_QUEUE}, or 0")));
            }
        };
        let created = Rollout::new(&world.world, &point, options.seed)?;
        let made = Worker::new(created, capacity as usize);
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_rollout>(made, rollout) }
    })
}

/// Destroys the handle of a rollout; null is allowed. Queued steps are dropped, and the step in progress ends before its next pass or slice.
///
/// Ownership: on success rollout is no longer a handle; on failure it is unchanged. Anchors that were taken from it remain.
/// Threads: any thread; waits for calls in flight on the rollout, and for its worker.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_destroy(rollout: *mut cairn_rollout) -> cairn_result {
    call("cairn_rollout_destroy", || destroy(rollout))
}

/// Gives the properties and progress of a rollout.
///
/// Ownership: info stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY while a
/// step is running.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_get_info(
    rollout: *const cairn_rollout,
    info: *mut cairn_rollout_info,
) -> cairn_result {
    call("cairn_rollout_get_info", || {
        let worker = enter(rollout)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::new(info, "info") }?;
        let core = worker.lock_between_steps(worker.is_nested())?;
        let (point, planner) = (core.rollout.operating_point(), core.rollout.planner());
        info.write(&cairn_rollout_info {
            struct_size: 0,
            pictures_per_latent: point.pictures_per_latent,
            latents: planner.latents(),
            seed: planner.seed(),
            latents_per_second: point.latents_per_second,
            presented_rate: point.presented_rate(),
            operating_point: fixed_text(&point.to_string()),
        });
        Ok(CAIRN_OK)
    })
}

/// Appends a picture of any size: the seed, or later an edit of the scene. It becomes a latent of its own, with a cache pass that puts
/// it into the rollout's memory. Runs on the calling thread.
///
/// info: may be null.
///
/// Ownership: the picture is copied; info stays the caller's and is filled on success; on failure it is not written and the
/// rollout is as it was.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED when a clock has run out.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_append(
    rollout: *mut cairn_rollout,
    picture: *const cairn_picture,
    info: *mut cairn_step_info,
) -> cairn_result {
    call("cairn_rollout_append", || {
        let worker = enter_serialized(rollout)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::optional(info, "info") }?;
        // SAFETY: the host's promise about `picture`.
        let picture = unsafe { read_picture(picture, "picture") }?;
        let report = worker.run(&Job::Append(vec![picture]))?;
        info.into_iter().for_each(|info| info.write(&step_info(&report)));
        Ok(CAIRN_OK)
    })
}

/// Appends consecutive pictures of any sizes as one latent, so that a moving scene keeps moving. cairn_rollout_append does so with one
/// picture, as a still. Runs on the calling thread.
///
/// pictures: an array, the oldest first, with the same struct_size in each. count: 4, the pictures of a latent; or 1, for a still.
/// info: may be null.
///
/// Ownership: the pictures are copied; info stays the caller's and is filled on success; on failure it is not written and the
/// rollout is as it was.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED when a clock has run out.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_append_pictures(
    rollout: *mut cairn_rollout,
    pictures: *const cairn_picture,
    count: u32,
    info: *mut cairn_step_info,
) -> cairn_result {
    call("cairn_rollout_append_pictures", || {
        let worker = enter_serialized(rollout)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::optional(info, "info") }?;
        // SAFETY: the host's promise about `pictures`.
        let pictures = unsafe { read_pictures(pictures, count) }?;
        let report = worker.run(&Job::Append(pictures))?;
        info.into_iter().for_each(|info| info.write(&step_info(&report)));
        Ok(CAIRN_OK)
    })
}

/// Sets whether the encoder keeps its state from one appended picture to the next, as in the released engine, or starts anew with each (the
/// default). Its state is empty after this call, and after cairn_rollout_reset. It is part of a saved state, which can be restored only into
/// a rollout with the same setting.
///
/// keep: 1 to keep the encoder's state, 0 to start anew with each picture.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED if the
/// bundle's encoder does not take its state as an input; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_keep_encoder_stream(rollout: *mut cairn_rollout, keep: u32) -> cairn_result {
    call("cairn_rollout_keep_encoder_stream", || {
        let worker = enter_serialized(rollout)?;
        if keep > 1 {
            return Err(Failure::argument("keep", format!("{keep} is neither 0 nor 1")));
        }
        worker.lock_idle()?.rollout.keep_encoder_stream(keep == 1)?;
        Ok(CAIRN_OK)
    })
}

/// Makes the next latent with these controls, which cover 1 / latents_per_second seconds of world time. Runs on the calling thread.
///
/// info: may be null.
///
/// Ownership: controls are read during the call; info stays the caller's and is filled on success; on failure it is not
/// written and the rollout is as it was.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED for a key that the world does
/// not know, and when a clock has run out.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_step(
    rollout: *mut cairn_rollout,
    controls: *const cairn_controls,
    info: *mut cairn_step_info,
) -> cairn_result {
    call("cairn_rollout_step", || {
        let worker = enter_serialized(rollout)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::optional(info, "info") }?;
        // SAFETY: the host's promise about `controls`.
        let controls = unsafe { read_controls(controls, "controls") }?;
        let report = worker.run(&Job::Step(controls))?;
        info.into_iter().for_each(|info| info.write(&step_info(&report)));
        Ok(CAIRN_OK)
    })
}

/// Resets a rollout to its start with the same seed: no latents, empty memory.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_reset(rollout: *mut cairn_rollout) -> cairn_result {
    call("cairn_rollout_reset", || {
        let worker = enter_serialized(rollout)?;
        let mut core = worker.lock_idle()?;
        core.rollout.reset()?;
        core.next_is_cut = true;
        Ok(CAIRN_OK)
    })
}

/// Frees the device memory of a rollout that makes no latents for a while: waits for its work, then evicts its rings, latents and pictures
/// with their contents. The next call that needs them makes them resident again; the device's queue waits for that, and no thread does if
/// Windows has ID3D12Device3. If there is not enough memory, that call returns CAIRN_ERROR_OUT_OF_MEMORY, changes nothing and may be
/// repeated. The world's weights are evicted once all of its rollouts rest; anchors are not. On a CPU device nothing happens.
/// cairn_rollout_pause also rests a rollout with a queue.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK, also if it rests already; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE;
/// CAIRN_ERROR_DEVICE_REMOVED.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_rest(rollout: *mut cairn_rollout) -> cairn_result {
    call("cairn_rollout_rest", || {
        enter_serialized(rollout)?.lock_idle()?.rollout.rest()?;
        Ok(CAIRN_OK)
    })
}

/// Limits the wall time per latent, decoding included. Latents use the first of the schedules until that takes too long, then one with
/// fewer passes, and again one with more when there is time. The choice depends on the times of previous latents, so the same controls may
/// give other pictures the next time. Changes are logged; cairn_step_info has the number of passes of a latent, and
/// cairn_rollout_info the schedule of the next one. Restoring a state removes the limit.
///
/// latent_ns: limit in nanoseconds per latent.
/// schedules: one to eight as in operating points, separated by spaces, each with fewer passes than the one before:
/// "stock explicit:1:0.5:0 explicit:1:0". An empty text removes the limit and leaves the schedule as it is.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_set_budget(
    rollout: *mut cairn_rollout,
    latent_ns: u64,
    schedules: *const c_char,
) -> cairn_result {
    call("cairn_rollout_set_budget", || {
        let worker = enter_serialized(rollout)?;
        // SAFETY: the host's promise about `schedules`.
        let text = unsafe { required_text(schedules, "schedules") }?;
        let schedules = read_schedules(text)?;
        worker.lock_idle()?.rollout.set_budget(Duration::from_nanos(latent_ns), &schedules)?;
        Ok(CAIRN_OK)
    })
}

/// Copies the last anchor: its pictures and its latent.
///
/// Ownership: on success *anchor is the caller's, for cairn_anchor_destroy; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also before the first latent; CAIRN_ERROR_BUSY
/// while a step is running; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_get_anchor(
    rollout: *const cairn_rollout,
    anchor: *mut *mut cairn_anchor,
) -> cairn_result {
    call("cairn_rollout_get_anchor", || {
        let worker = enter(rollout)?;
        check_out(anchor, "anchor")?;
        let copy = worker.lock_between_steps(worker.is_nested())?.anchor()?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_anchor>(copy, anchor) }
    })
}

/// The largest number of pictures in a latent.
const MAX_PICTURES: u32 = 4;

/// Reads an array of `count` pictures. The first one's struct_size is the stride; all others must have the same.
///
/// # Safety
/// Where it is neither null nor misaligned, `pictures` points to `count` structs, each of which [`read_picture`] may be given.
pub(super) unsafe fn read_pictures(pictures: *const cairn_picture, count: u32) -> AbiResult<Vec<Picture>> {
    if !(1..=MAX_PICTURES).contains(&count) {
        return Err(Failure::argument("count", format!("{count} pictures make no latent")).remedy("Give 1 or 4"));
    }
    // SAFETY: the caller's promise.
    let first = unsafe { read_picture(pictures, "pictures[0]") }?;
    let mut all = vec![first];
    // SAFETY: as above; the first was read, so that this is neither null nor misaligned.
    let size = unsafe { (*pictures).struct_size };
    for i in 1..count as usize {
        // SAFETY: as above.
        let next = unsafe { pictures.byte_add(i * size as usize) };
        if !next.is_aligned() {
            return Err(Failure::argument("pictures[0].struct_size", "the pictures behind it are not aligned"));
        }
        // SAFETY: as above.
        let other = unsafe { (*next).struct_size };
        if other != size {
            let cause = format!("it is {other}, the first picture's is {size}");
            return Err(Failure::argument(&format!("pictures[{i}].struct_size"), cause));
        }
        // SAFETY: as above.
        all.push(unsafe { read_picture(next, &format!("pictures[{i}]")) }?);
    }
    Ok(all)
}

/// Parses schedules that are separated by spaces.
pub(super) fn read_schedules(text: &str) -> AbiResult<Vec<Schedule>> {
    Ok(text.split_whitespace().map(str::parse).collect::<Result<_, _>>()?)
}

/// Converts a step's report to the header's struct.
pub(super) fn step_info(info: &StepInfo) -> cairn_step_info {
    let count = |stage: StageTotals| u32::try_from(stage.count).unwrap_or(u32::MAX);
    cairn_step_info {
        struct_size: 0,
        flags: if info.committed { CAIRN_STEP_COMMITTED } else { 0 },
        latent: info.latent,
        denoise_passes: count(info.stages.denoise),
        cache_passes: count(info.stages.cache),
        encode_ns: nanoseconds(info.stages.encode),
        denoise_ns: nanoseconds(info.stages.denoise),
        cache_ns: nanoseconds(info.stages.cache),
        commit_ns: nanoseconds(info.stages.commit),
        decode_ns: nanoseconds(info.stages.decode),
        ring_bytes: info.ring_bytes,
    }
}

/// Converts a stage's time to the header's type.
pub(super) fn nanoseconds(stage: StageTotals) -> u64 {
    u64::try_from(stage.time.as_nanos()).unwrap_or(u64::MAX)
}
