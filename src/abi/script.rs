//! Control scripts: a player's input over world time, as text.

use std::ffi::c_char;

use super::boundary::call;
use super::controls::{cairn_controls, to_header};
use super::handles::{Handle, Kind, Object, destroy, enter, insert_to};
use super::results::{AbiResult, CAIRN_OK, Failure, cairn_result};
use super::structs::{Out, check_out, slice};
use super::text::copy_text;
use crate::world::{ControlScript, WorldTime};

/// A player's input by world time, in the format of docs/control-script.md. Immutable.
pub struct cairn_script(());

impl Handle for cairn_script {
    const KIND: Kind = Kind::Script;
    const NAME: &'static str = "cairn_script";
    type Object = ControlScript;
}

impl Object for ControlScript {}

/// Reads a control script.
///
/// text: length bytes of UTF-8, without a NUL.
///
/// Ownership: on success *script is the caller's, for cairn_script_destroy; on failure it is not written. The text is read during
/// the call.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, with line and column of the error; CAIRN_ERROR_UNSUPPORTED for a newer version
/// of the format.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_script_create(
    text: *const c_char,
    length: usize,
    script: *mut *mut cairn_script,
) -> cairn_result {
    call("cairn_script_create", || {
        check_out(script, "script")?;
        // SAFETY: the host's promise about `text`.
        let text = unsafe { slice(text.cast::<u8>(), length, "text") }?;
        let made = ControlScript::parse_bytes(text)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_script>(made, script) }
    })
}

/// Gives the controls of a latent step: the script's input from (latent - 1) / latents_per_second seconds up to latent /
/// latents_per_second seconds. Consecutive steps miss no input and count none twice. After the script's end nothing moves.
///
/// latent: number of the step's latent, from 1; 0 is the seed's, which has no controls.
/// latents_per_second: the rollout's, 1 to 240.
///
/// Ownership: controls stay the caller's and are filled on success, ready for cairn_rollout_step; on failure they are not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the mouse moves farther in the step than
/// cairn_controls allows; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_script_get_controls(
    script: *const cairn_script,
    latent: u64,
    latents_per_second: u32,
    controls: *mut cairn_controls,
) -> cairn_result {
    call("cairn_script_get_controls", || {
        let script = enter(script)?;
        // SAFETY: the host's promise about `controls`.
        let controls = unsafe { Out::new(controls, "controls") }?;
        let (start, end) = span(latent, latents_per_second)?;
        controls.write(&to_header(&script.span(start, end)?));
        Ok(CAIRN_OK)
    })
}

/// Gives the duration of a script: up to its explicit end, or if it has none, up to the end of its last event or motion.
///
/// microseconds: gets the duration in microseconds of world time.
///
/// Ownership: *microseconds is written on success; on failure it is not.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_script_get_duration(
    script: *const cairn_script,
    microseconds: *mut u64,
) -> cairn_result {
    call("cairn_script_get_duration", || {
        let script = enter(script)?;
        check_out(microseconds, "microseconds")?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { microseconds.write(script.duration().ceil_micros()) };
        Ok(CAIRN_OK)
    })
}

/// Copies the text of a script in the format's canonical form, for a file.
///
/// text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
/// length: gets the length in bytes of the whole text, without the NUL; may be null.
///
/// Ownership: the text is copied; on failure nothing is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_script_get_text(
    script: *const cairn_script,
    text: *mut c_char,
    capacity: usize,
    length: *mut usize,
) -> cairn_result {
    call("cairn_script_get_text", || {
        let script = enter(script)?;
        // SAFETY: the host's promise about the buffer.
        unsafe { copy_text(&script.write(), text, capacity, length) }
    })
}

/// Destroys the handle of a script; null is allowed.
///
/// Ownership: on success script is no longer a handle; on failure it is unchanged.
/// Threads: any thread; waits for calls in flight on the script.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_script_destroy(script: *mut cairn_script) -> cairn_result {
    call("cairn_script_destroy", || destroy(script))
}

/// The span of world time, from start to end, that a latent covers.
pub(super) fn span(latent: u64, latents_per_second: u32) -> AbiResult<(WorldTime, WorldTime)> {
    if latents_per_second == 0 || latents_per_second > crate::world::MAX_LATENT_RATE {
        let failure = Failure::argument("latents_per_second", format!("{latents_per_second} is no rate of latents"));
        return Err(failure.remedy(format!("Use 1 to {}", crate::world::MAX_LATENT_RATE)));
    }
    let at = |number| WorldTime::new(number, latents_per_second);
    Ok((at(latent.saturating_sub(1)), at(latent)))
}
