//! Cairn as a native plugin of Unity: one library with all of `include/cairn.h` and the functions that Unity calls.
//!
//! It is a separate library so that no other host contains Unity's entry points. It contains all of Cairn, so that a process never has two
//! copies that do not know each other's handles.
//!
//! | file | what |
//! |---|---|
//! | `interfaces` | Unity's native plugin interface, declared anew |
//! | `plugin` | loading, unloading, the graphics device that appears and disappears, and the reason when there is none |
//! | `views` | which presenter is shown in which texture; the numbers that Unity's events carry |
//! | `events` | the two events that run on Unity's threads |
//! | `drawing` | implementation of the events: Direct3D 12 on Windows, nothing on other platforms |
//! | `pipeline_cache` | compiled pipelines in a file of the game |
//! | `entry_points` | the functions that C# calls |
//!
//! A frame needs two events, because Unity uses its queue and its command lists on different threads. `make` runs on the submission thread,
//! where the queue may be used: the presenter writes the frame into a texture of the view's ring. `show` runs where Unity records: it copies
//! the newest frame of the ring into Unity's texture. The list with that copy may execute frames later: a texture of the ring is written
//! again once Unity's frame fence says that the list has executed.

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

/// Runs `work`. A panic, which the panic hook has reported, is caught here and gives `otherwise`.
fn guarded<T>(otherwise: T, work: impl FnOnce() -> T) -> T {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        // Dropping the payload may panic again.
        std::mem::forget(payload);
        otherwise
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_panic_is_caught_in_an_entry_point() {
        assert_eq!(super::guarded(7, || panic!("a fault")), 7);
        assert_eq!(super::guarded(7, || 8), 8);
    }
}
