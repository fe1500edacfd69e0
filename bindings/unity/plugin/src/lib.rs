//! Cairn as a native plugin of Unity: one library that has all of `include/cairn.h` and, beside it, what Unity calls.
//!
//! It is a library of its own so that no other host has Unity's doors in it, and it is whole, so that a process never has two
//! copies of Cairn that do not know each other's handles.
//!
//! | file | what |
//! |---|---|
//! | `interfaces` | what Unity offers, declared in our own words |
//! | `plugin` | loading, unloading, the graphics device that comes and goes, and why there is none |
//! | `views` | what is shown where; numbers that Unity's events carry |
//! | `events` | the two things that are done on Unity's threads |
//! | `drawing` | how they are done: on Windows with Direct3D 12, elsewhere not at all |
//! | `pipeline_cache` | compiled pipelines in a file of the game's |
//! | `entry_points` | the functions that C# calls |
//!
//! A frame crosses in two events, as Unity keeps its queue and its command lists apart. `make` runs on the submission thread, where the
//! queue may be used, and has the presenter write the frame into a texture of the view's ring. `show` runs where Unity records, and copies
//! the newest frame of the ring into Unity's texture. The list with that copy may run frames later: a texture of the ring is written again
//! once Unity's frame fence says that it has.

#[allow(non_camel_case_types, reason = "the name is that of the interface in C")]
mod entry_points;
mod events;
pub mod interfaces;
mod pipeline_cache;
mod plugin;
mod text;
mod views;

#[cfg_attr(windows, path = "drawing/windows.rs")]
#[cfg_attr(not(windows), path = "drawing/unsupported.rs")]
mod drawing;

pub use entry_points::*;
pub use plugin::{UnityPluginLoad, UnityPluginUnload};

use std::panic::{AssertUnwindSafe, catch_unwind};

/// Does `work`; a panic, of which the panic hook has told, ends here and gives `otherwise`.
fn guarded<T>(otherwise: T, work: impl FnOnce() -> T) -> T {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        // What was thrown may panic again where it is dropped.
        std::mem::forget(payload);
        otherwise
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_panic_ends_at_the_door() {
        assert_eq!(super::guarded(7, || panic!("a fault")), 7);
        assert_eq!(super::guarded(7, || 8), 8);
    }
}
