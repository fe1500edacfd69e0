//! Records live input as a control script.

use super::boundary::call;
use super::controls::{cairn_controls, read_controls};
use super::handles::{Handle, Kind, Object, destroy, enter_serialized, insert_to};
use super::results::{CAIRN_OK, Failure, cairn_result};
use super::script::{cairn_script, span};
use super::structs::check_out;
use crate::locks::Mutex;
use crate::world::{Key, ScriptRecorder, WorldTime};

/// Records a player's input and makes a script of it. The input is single events as they happen, or the controls of whole latent steps.
pub struct cairn_recorder(());

/// The object of a recorder's handle.
pub(super) struct Recorder(Mutex<ScriptRecorder>);

impl Handle for cairn_recorder {
    const KIND: Kind = Kind::Recorder;
    const NAME: &'static str = "cairn_recorder";
    type Object = Recorder;
}

impl Object for Recorder {}

/// Creates a recorder with an empty recording.
///
/// Ownership: on success *recorder is the caller's, for cairn_recorder_destroy; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_recorder_create(recorder: *mut *mut cairn_recorder) -> cairn_result {
    call("cairn_recorder_create", || {
        check_out(recorder, "recorder")?;
        let made = Recorder(Mutex::new(ScriptRecorder::new()));
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_recorder>(made, recorder) }
    })
}

/// Records that a key or mouse button went down or up. An event that does not change its state, such as a keyboard's auto-repeat, is
/// ignored.
///
/// microseconds: world time; events must come in order of time.
/// key: a Windows virtual-key code, 0 to 255.
/// down: 1 or 0.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for a time that no script has, and when
/// the recording is full; CAIRN_ERROR_BUSY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_recorder_key(
    recorder: *mut cairn_recorder,
    microseconds: u64,
    key: u32,
    down: u32,
) -> cairn_result {
    call("cairn_recorder_key", || {
        let recorder = enter_serialized(recorder)?;
        let key = u8::try_from(key).map_err(|_| Failure::argument("key", format!("{key} is no virtual-key code")))?;
        if down > 1 {
            return Err(Failure::argument("down", format!("{down} is neither up nor down")).remedy("Use 1 or 0"));
        }
        recorder.0.lock().key(WorldTime::from_micros(microseconds), Key(key), down == 1)?;
        Ok(CAIRN_OK)
    })
}

/// Records that the mouse moved by dx (right positive) and dy (down positive) counts.
///
/// microseconds: world time; events must come in order of time.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT for what no script may hold, such as a number that is not
/// finite, and when the recording is full; CAIRN_ERROR_BUSY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_recorder_mouse(
    recorder: *mut cairn_recorder,
    microseconds: u64,
    dx: f32,
    dy: f32,
) -> cairn_result {
    call("cairn_recorder_mouse", || {
        enter_serialized(recorder)?.0.lock().mouse(WorldTime::from_micros(microseconds), [dx, dy])?;
        Ok(CAIRN_OK)
    })
}

/// Records that the wheel turned by this many notches, up positive.
///
/// microseconds: world time; events must come in order of time.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT for what no script may hold, and when the
/// recording is full; CAIRN_ERROR_BUSY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_recorder_scroll(
    recorder: *mut cairn_recorder,
    microseconds: u64,
    notches: i32,
) -> cairn_result {
    call("cairn_recorder_scroll", || {
        enter_serialized(recorder)?.0.lock().scroll(WorldTime::from_micros(microseconds), notches)?;
        Ok(CAIRN_OK)
    })
}

/// Records the controls of a latent step. If every step is recorded, in order and without a gap, cairn_script_get_controls gives them
/// back bit for bit.
///
/// latent: number of the step's latent, from 1.
/// latents_per_second: the rollout's, 1 to 240.
///
/// Ownership: controls are read during the call; nothing is handed over, on success or on failure.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for a time that no script has, and when
/// the recording is full; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_recorder_step(
    recorder: *mut cairn_recorder,
    latent: u64,
    latents_per_second: u32,
    controls: *const cairn_controls,
) -> cairn_result {
    call("cairn_recorder_step", || {
        let recorder = enter_serialized(recorder)?;
        // SAFETY: the host's promise about `controls`.
        let controls = unsafe { read_controls(controls, "controls") }?;
        let (start, end) = span(latent, latents_per_second)?;
        recorder.0.lock().step(start, end, &controls)?;
        Ok(CAIRN_OK)
    })
}

/// Makes a script of the recording so far. It ends at microseconds of world time; keys that are still held are released there. The
/// recording continues.
///
/// Ownership: on success *script is the caller's, for cairn_script_destroy; on failure it is not written.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the recording has input after that time;
/// CAIRN_ERROR_BUSY; CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_recorder_make_script(
    recorder: *mut cairn_recorder,
    microseconds: u64,
    script: *mut *mut cairn_script,
) -> cairn_result {
    call("cairn_recorder_make_script", || {
        let recorder = enter_serialized(recorder)?;
        check_out(script, "script")?;
        let recorded = recorder.0.lock().clone();
        let made = recorded.finish(WorldTime::from_micros(microseconds))?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_script>(made, script) }
    })
}

/// Destroys the handle of a recorder; null is allowed. Scripts that were made of it remain.
///
/// Ownership: on success recorder is no longer a handle; on failure it is unchanged.
/// Threads: any thread; waits for calls in flight on the recorder.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_recorder_destroy(recorder: *mut cairn_recorder) -> cairn_result {
    call("cairn_recorder_destroy", || destroy(recorder))
}
