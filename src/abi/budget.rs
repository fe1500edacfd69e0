//! One budget for a rollout and the frames between its anchors.

use std::ffi::c_char;
use std::sync::Arc;
use std::time::Duration;

use super::boundary::call;
use super::handles::{enter, enter_alone};
use super::presenter::cairn_presenter;
use super::results::{CAIRN_OK, Failure, Outcome, cairn_result};
use super::rollout::{cairn_rollout, read_schedules};
use super::structs::{describe, read};
use super::text::optional_text;
use super::world::cairn_world;
use crate::world::{Budget, World};

/// The most worlds of a budget.
pub const CAIRN_MAX_BUDGET_WORLDS: u32 = 8;

/// Budget of a rollout and its frames: time, memory or both.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_budget {
    /// sizeof(cairn_budget)
    pub struct_size: u32,
    /// Frames that are shown for each anchor, at most 64, the presenter's own where there is one; 0 for that, and for 1 without.
    pub multiplier: u32,
    /// Nanoseconds of the device's time for each frame that is shown, the passes of anchors and all; 0 for as long as it takes.
    pub frame_ns: u64,
    /// MiB that the world in use and its rollout may need, as cairn_world_get_memory says; 0 for as many as there are.
    pub memory_mib: u64,
    /// Schedules as in operating points, a space between them, each with fewer passes than the one before, at most 8: "stock
    /// explicit:1:0.5:0"; null for the rollout's own alone.
    pub schedules: *const c_char,
    /// Further worlds of the same bundle that the rollout may go on in, loaded with other global windows; may be null: the window then stays,
    /// as no world is loaded for it.
    pub worlds: *const *const cairn_world,
    /// How many, at most CAIRN_MAX_BUDGET_WORLDS.
    pub world_count: u32,
    /// 0
    pub reserved: u32,
    /// The presenter whose frames are held to it too; may be null.
    pub presenter: *const cairn_presenter,
}
describe!(cairn_budget, [], {
    struct_size, multiplier, frame_ns, memory_mib, schedules, worlds, world_count, reserved, presenter,
});

/// Holds a rollout, and the frames of a presenter, to a budget. From measured times, by the device's own clock where it has one, else by wall
/// time, it chooses the number of passes per latent, the global window and the number of frames generated between anchors. Passes are reduced
/// first, then frames, the window last; each is raised again when there is time. The window is also narrowed when the device's memory runs
/// short. The same controls may then give other pictures the next time. A change of window happens before a step, goes through the host's
/// memory and takes a while. No world is loaded for it, as that takes seconds to minutes and the weights' memory once more: load worlds for the
/// windows you allow beforehand, on a thread of your own. Changes are logged, and cairn_rollout_statistics has them.
///
/// It takes the place of cairn_rollout_set_budget, which ends it, as a restored state does and the rollout's end, and of
/// cairn_presenter_set_budget, which takes the presenter out of it.
///
/// budget: null ends it, and leaves things as they are.
///
/// Ownership: the budget is read during the call; on success its worlds are kept alive until it ends, its presenter is not; on failure
/// nothing has changed.
/// Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_OUT_OF_MEMORY, with figures and the window to go below, where even the narrowest of the worlds needs too much.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_govern(
    rollout: *mut cairn_rollout,
    budget: *const cairn_budget,
) -> cairn_result {
    call("cairn_rollout_govern", || {
        let running = enter_alone(rollout)?;
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
        let shown = presenter.as_ref().map_or(1, |presenting| presenting.presenter.multiplier());
        let asked = Budget {
            frame: (budget.frame_ns > 0).then(|| Duration::from_nanos(budget.frame_ns)),
            memory: (budget.memory_mib > 0).then(|| budget.memory_mib.saturating_mul(1 << 20)),
            multiplier: if budget.multiplier == 0 { shown } else { budget.multiplier },
            schedules: read_schedules(text.unwrap_or_default())?,
        };
        if presenter.is_some() && asked.multiplier != shown {
            let cause = format!("{} frames to an anchor where the presenter shows {shown}", asked.multiplier);
            return Err(Failure::argument("budget.multiplier", cause));
        }
        let governor = running.govern(&asked, &worlds)?;
        if let Some(presenting) = presenter {
            presenting.presenter.follow(Some(&governor))?;
        }
        Ok(CAIRN_OK)
    })
}

/// The worlds of a budget.
///
/// # Safety
/// Where it has worlds, `worlds` points to so many handles.
unsafe fn worlds(budget: &cairn_budget) -> Outcome<Vec<Arc<World>>> {
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
