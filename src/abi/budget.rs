//! One budget for a rollout and for the frames between its anchors.

use std::ffi::c_char;
use std::sync::Arc;
use std::time::Duration;

use super::boundary::call;
use super::handles::{enter, enter_serialized};
use super::presenter::cairn_presenter;
use super::results::{AbiResult, CAIRN_OK, Failure, cairn_result};
use super::rollout::{cairn_rollout, read_schedules};
use super::structs::{describe, read};
use super::text::optional_text;
use super::world::cairn_world;
use crate::world::{Budget, World};

/// Largest number of worlds of a budget.
pub const CAIRN_MAX_BUDGET_WORLDS: u32 = 8;

/// Budget of a rollout and its frames: time, memory or both.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_budget {
    /// sizeof(cairn_budget)
    pub struct_size: u32,
    /// Frames shown per anchor, at most 64; with a presenter its multiplier. 0 for the presenter's multiplier, or 1 without a presenter.
    pub multiplier: u32,
    /// Limit of device time per shown frame, in nanoseconds, including the passes that make anchors; 0 for no limit.
    pub frame_ns: u64,
    /// Limit of the memory that the world in use and its rollout need according to cairn_world_get_memory, in MiB; 0 for no limit.
    pub memory_mib: u64,
    /// Schedules as in operating points, separated by spaces, at most 8, each with fewer passes than the one before: "stock
    /// explicit:1:0.5:0"; null for the rollout's own only.
    pub schedules: *const c_char,
    /// Further worlds of the same bundle, loaded with other global windows, to which the rollout may move. A window with a slice that was longer than
    /// longest_submission_us when its world was loaded is used only if no window that fits the memory keeps to it. May be null: the window then does
    /// not change.
    pub worlds: *const *const cairn_world,
    /// Number of worlds, at most CAIRN_MAX_BUDGET_WORLDS.
    pub world_count: u32,
    /// 0
    pub reserved: u32,
    /// A presenter whose frames the budget includes; may be null.
    pub presenter: *const cairn_presenter,
}
describe!(cairn_budget, [], {
    struct_size, multiplier, frame_ns, memory_mib, schedules, worlds, world_count, reserved, presenter,
});

/// Keeps a rollout, and the frames of a presenter, within a budget. From measured times (by the device's clock if it has one, else wall time)
/// it chooses the number of passes per latent, the global window and the number of frames generated between anchors. It reduces passes first,
/// then frames, and the window last; it raises each again when there is time. It also narrows the window when the device's memory runs short.
/// The same controls may therefore give other pictures the next time. A change of window happens before a step, goes through the host's memory
/// and takes a while. No world is loaded for it, because that takes seconds to minutes and the memory of the weights once more: load worlds
/// for the windows that you allow beforehand, on a thread of your own. Changes are logged and counted in cairn_rollout_statistics.
///
/// Replaces cairn_rollout_set_budget and cairn_presenter_set_budget. The budget ends with cairn_rollout_set_budget, with a restored state and
/// with the rollout; cairn_presenter_set_budget removes the presenter from it.
///
/// budget: null ends the budget and keeps the present settings.
///
/// Ownership: the budget is read during the call; on success its worlds are kept alive until it ends, its presenter is not; on failure
/// nothing changes.
/// Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_OUT_OF_MEMORY, with the numbers and the window to stay below, if even the narrowest of the worlds needs too much.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_govern(
    rollout: *mut cairn_rollout,
    budget: *const cairn_budget,
) -> cairn_result {
    call("cairn_rollout_govern", || {
        let running = enter_serialized(rollout)?;
        if budget.is_null() {
            running.ungovern()?;
            return Ok(CAIRN_OK);
        }
        // SAFETY: the host's promise about `budget`.
        let budget = unsafe { read(budget, "budget") }?;
        if budget.reserved != 0 {
            return Err(Failure::argument("budget.reserved", "it is not 0"));
        }
        // SAFETY: the host's promise about what the budget points to.
        let text = unsafe { optional_text(budget.schedules, "budget.schedules") }?;
        // SAFETY: as above.
        let worlds = unsafe { worlds(&budget) }?;
        let presenter = (!budget.presenter.is_null()).then(|| enter(budget.presenter)).transpose()?;
        let multiplier = presenter.as_ref().map_or(1, |object| object.presenter.multiplier());
        let limits = Budget {
            frame: (budget.frame_ns > 0).then(|| Duration::from_nanos(budget.frame_ns)),
            memory: (budget.memory_mib > 0).then(|| budget.memory_mib.saturating_mul(1 << 20)),
            multiplier: if budget.multiplier == 0 { multiplier } else { budget.multiplier },
            schedules: read_schedules(text.unwrap_or_default())?,
        };
        if presenter.is_some() && limits.multiplier != multiplier {
            let cause = format!("{} frames to an anchor where the presenter shows {multiplier}", limits.multiplier);
            return Err(Failure::argument("budget.multiplier", cause));
        }
        let governor = running.govern(&limits, &worlds)?;
        if let Some(object) = presenter {
            object.presenter.follow(Some(&governor))?;
        }
        Ok(CAIRN_OK)
    })
}

/// Reads the worlds of a budget.
///
/// # Safety
/// If `world_count` is not 0 and `worlds` is not null, it points to that many handles.
unsafe fn worlds(budget: &cairn_budget) -> AbiResult<Vec<Arc<World>>> {
    let refuse = |cause: String| Err(Failure::argument("budget.worlds", cause));
    match budget.world_count {
        0 => return Ok(Vec::new()),
        count if count > CAIRN_MAX_BUDGET_WORLDS => return refuse(format!("{count} are too many")),
        _ if budget.worlds.is_null() => return refuse("it is null".to_owned()),
        _ if !budget.worlds.is_aligned() => return refuse("it is not aligned".to_owned()),
        _ => {}
    }
    // SAFETY: not null and aligned, and the caller's promise.
    let handles = unsafe { std::slice::from_raw_parts(budget.worlds, budget.world_count as usize) };
    handles.iter().map(|handle| Ok(enter(*handle)?.world.clone())).collect()
}
