//! The two events that Unity calls on its threads. An event with an unknown number, or with data that names no view, does nothing.

use std::ffi::{c_int, c_void};

use super::plugin::{self, Event};
use super::{guarded, views};

/// The function that Unity calls for each event that was issued.
pub(crate) unsafe extern "system" fn on_event(number: c_int, data: *mut c_void) {
    guarded((), || {
        let Some((drawing, event)) = plugin::event(number) else { return };
        let Some(view) = views::find(data.addr()) else { return };
        view.set_result(match event {
            Event::Make => drawing.make(&view),
            Event::Show => drawing.show(&view),
        });
    });
}
