//! The two events that Unity calls on its threads. Whatever they are given, nothing goes wrong: an event of another number, and data
//! that names no view, do nothing.

use std::ffi::{c_int, c_void};

use super::plugin::{self, Event};
use super::{guarded, views};

/// What Unity calls for each event that was issued.
pub(crate) unsafe extern "system" fn on_event(number: c_int, data: *mut c_void) {
    guarded((), || {
        let Some((drawing, event)) = plugin::event(number) else { return };
        let Some(view) = views::find(data.addr()) else { return };
        view.tell(match event {
            Event::Make => drawing.make(&view),
            Event::Show => drawing.show(&view),
        });
    });
}
