//! The queue of a rollout: its own thread runs queued steps, and tickets identify their results.

use std::time::Duration;

use super::anchor::cairn_anchor;
use super::boundary::call;
use super::controls::{cairn_controls, read_controls};
use super::handles::{enter, insert};
use super::images::{cairn_picture, read_picture};
use super::results::{AbiResult, CAIRN_NOT_READY, CAIRN_OK, CAIRN_QUEUE_FULL, cairn_result};
use super::rollout::{cairn_rollout, cairn_step_info, read_pictures, step_info};
use super::structs::{Out, check_out};
use crate::world::{Job, TicketState};

/// A timeout without limit.
pub const CAIRN_FOREVER: u64 = u64::MAX;

/// Queues a step for the rollout's own thread, which runs steps in the order in which they were queued. A step that fails leaves the
/// rollout unchanged and cancels the steps queued after it.
///
/// ticket: gets the number that identifies the result.
///
/// Ownership: controls are read during the call; *ticket is written on success only, not on failure.
/// Threads: any thread, at any time. Returns at once.
/// Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_submit(
    rollout: *const cairn_rollout,
    controls: *const cairn_controls,
    ticket: *mut u64,
) -> cairn_result {
    call("cairn_rollout_submit", || {
        check_out(ticket, "ticket")?;
        // SAFETY: the host's promise about `controls`.
        let controls = unsafe { read_controls(controls, "controls") }?;
        // SAFETY: the host's promise about `ticket`.
        unsafe { submit(rollout, Job::Step(controls), ticket) }
    })
}

/// Queues a picture to be appended as by cairn_rollout_append.
///
/// ticket: gets the number that identifies the result.
///
/// Ownership: the picture is copied; *ticket is written on success only, not on failure.
/// Threads: any thread, at any time. Returns at once.
/// Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_submit_picture(
    rollout: *const cairn_rollout,
    picture: *const cairn_picture,
    ticket: *mut u64,
) -> cairn_result {
    call("cairn_rollout_submit_picture", || {
        check_out(ticket, "ticket")?;
        // SAFETY: the host's promise about `picture`.
        let picture = unsafe { read_picture(picture, "picture") }?;
        // SAFETY: the host's promise about `ticket`.
        unsafe { submit(rollout, Job::Append(vec![picture]), ticket) }
    })
}

/// Queues pictures to be appended as by cairn_rollout_append_pictures.
///
/// pictures, count: as for cairn_rollout_append_pictures. ticket: gets the number that identifies the result.
///
/// Ownership: the pictures are copied; *ticket is written on success only, not on failure.
/// Threads: any thread, at any time. Returns at once.
/// Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
/// CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_submit_pictures(
    rollout: *const cairn_rollout,
    pictures: *const cairn_picture,
    count: u32,
    ticket: *mut u64,
) -> cairn_result {
    call("cairn_rollout_submit_pictures", || {
        check_out(ticket, "ticket")?;
        // SAFETY: the host's promise about `pictures`.
        let pictures = unsafe { read_pictures(pictures, count) }?;
        // SAFETY: the host's promise about `ticket`.
        unsafe { submit(rollout, Job::Append(pictures), ticket) }
    })
}

/// Fetches the result of a queued step, without waiting. A ticket's result can be fetched once, which frees its place in the queue.
/// A failed step's message becomes the last error of the calling thread.
///
/// info, anchor: get the step's report and its anchor; each may be null. An anchor that is not fetched is lost.
///
/// Ownership: on success *anchor is the caller's, for cairn_anchor_destroy, and info is filled; on failure neither is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_NOT_READY while it waits or runs; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for a
/// ticket whose result was fetched; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_CANCELLED; and the results of cairn_rollout_step and
/// cairn_rollout_append.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_poll(
    rollout: *const cairn_rollout,
    ticket: u64,
    info: *mut cairn_step_info,
    anchor: *mut *mut cairn_anchor,
) -> cairn_result {
    // SAFETY: the host's promise is the same.
    call("cairn_rollout_poll", || unsafe { fetch(rollout, ticket, Some(Duration::ZERO), info, anchor) })
}

/// Waits for a queued step to end, and fetches its result as cairn_rollout_poll does.
///
/// timeout_ns: longest wait in nanoseconds; CAIRN_FOREVER for no limit. While the queue is paused, waiting steps do not run.
///
/// Ownership: on success *anchor is the caller's, for cairn_anchor_destroy, and info is filled; on failure neither is written.
/// Threads: any thread, at any time. Destroying the rollout ends the wait with CAIRN_ERROR_CANCELLED.
/// Results: CAIRN_OK; CAIRN_NOT_READY after the timeout; CAIRN_ERROR_BUSY from within a callback of a call or a step of the rollout,
/// which would wait for itself; and all others of cairn_rollout_poll.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_wait(
    rollout: *const cairn_rollout,
    ticket: u64,
    timeout_ns: u64,
    info: *mut cairn_step_info,
    anchor: *mut *mut cairn_anchor,
) -> cairn_result {
    let timeout = (timeout_ns != CAIRN_FOREVER).then(|| Duration::from_nanos(timeout_ns));
    // SAFETY: the host's promise is the same.
    call("cairn_rollout_wait", || unsafe { fetch(rollout, ticket, timeout, info, anchor) })
}

/// Cancels all work of a rollout: queued steps do not run, and a step in progress, queued or on another thread, ends before its next
/// pass. Each gets CAIRN_ERROR_CANCELLED and leaves the rollout unchanged. Steps submitted later are not affected. Does not wait.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_cancel(rollout: *const cairn_rollout) -> cairn_result {
    call("cairn_rollout_cancel", || {
        enter(rollout)?.cancel();
        Ok(CAIRN_OK)
    })
}

/// Pauses the queue: the step in progress completes, and no other begins. Steps may still be queued. A rollout whose queue was used is then
/// rested, as by cairn_rollout_rest, until its memory is needed; meanwhile it is in use, as while a step is running.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_pause(rollout: *const cairn_rollout) -> cairn_result {
    call("cairn_rollout_pause", || {
        enter(rollout)?.pause(true);
        Ok(CAIRN_OK)
    })
}

/// Resumes a paused queue.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK, also when it was not paused; CAIRN_ERROR_INVALID_HANDLE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_resume(rollout: *const cairn_rollout) -> cairn_result {
    call("cairn_rollout_resume", || {
        enter(rollout)?.pause(false);
        Ok(CAIRN_OK)
    })
}

/// Lets exactly one step of a paused queue run.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time. Does not wait for the step.
/// Results: CAIRN_OK; CAIRN_NOT_READY when no step is queued, or all were released already; CAIRN_ERROR_INVALID_HANDLE;
/// CAIRN_ERROR_INVALID_ARGUMENT when the queue is not paused.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_single_step(rollout: *const cairn_rollout) -> cairn_result {
    call("cairn_rollout_single_step", || Ok(if enter(rollout)?.single_step()? { CAIRN_OK } else { CAIRN_NOT_READY }))
}

/// # Safety
/// `ticket` was checked and can be written.
unsafe fn submit(rollout: *const cairn_rollout, job: Job, ticket: *mut u64) -> AbiResult {
    let Some(number) = enter(rollout)?.submit(job)? else { return Ok(CAIRN_QUEUE_FULL) };
    // SAFETY: the caller's promise.
    unsafe { ticket.write(number) };
    Ok(CAIRN_OK)
}

/// Fetches a ticket's result, for which it waits at most `timeout`, or without limit if it is `None`.
///
/// # Safety
/// `info` is null or a struct as the header demands; `anchor` is null or can be written.
unsafe fn fetch(
    rollout: *const cairn_rollout,
    ticket: u64,
    timeout: Option<Duration>,
    info: *mut cairn_step_info,
    anchor: *mut *mut cairn_anchor,
) -> AbiResult {
    let worker = enter(rollout)?;
    // SAFETY: the host's promise about `info`.
    let info = unsafe { Out::optional(info, "info") }?;
    if !anchor.is_null() {
        check_out(anchor, "anchor")?;
    }
    let mut handle = std::ptr::null_mut();
    let state = worker.ticket(ticket, timeout, worker.is_nested(), |done| -> AbiResult<()> {
        if !anchor.is_null() {
            handle = insert::<cairn_anchor>(done.anchor.clone())?;
        }
        Ok(())
    })?;
    match state {
        TicketState::Pending => Ok(CAIRN_NOT_READY),
        TicketState::Finished(done) => {
            let done = done?;
            info.into_iter().for_each(|info| info.write(&step_info(&done.info)));
            if !anchor.is_null() {
                // SAFETY: checked above; writable by the host's promise.
                unsafe { anchor.write(handle) };
            }
            Ok(CAIRN_OK)
        }
    }
}
