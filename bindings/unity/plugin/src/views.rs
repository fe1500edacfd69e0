//! Views: which presenter is shown in which texture. C# creates and updates them; Unity's events carry their numbers.
//!
//! An event runs frames after it was issued, when its objects may be gone. So it carries a number that is looked up, never an address, and a
//! view holds a reference to its target texture.

use std::collections::BTreeMap;
use std::sync::Arc;

use cairn::abi::presenter::cairn_frame;
use cairn::abi::results::{CAIRN_NOT_READY, cairn_result};
use cairn::locks::Mutex;

use super::drawing::{Target, TargetRing};

/// A presenter of Cairn's, shown in a texture of Unity's.
#[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
pub(crate) struct View {
    /// Handles of Cairn's as numbers: their use fails once they are destroyed.
    pub(crate) device: usize,
    pub(crate) presenter: usize,
    next: Mutex<NextFrame>,
    status: Mutex<Status>,
    /// Locked by an event while it draws; only one draws at a time.
    pub(crate) ring: Mutex<TargetRing>,
}

/// Time and texture of the next frame.
#[derive(Default, Clone)]
struct NextFrame {
    now: u64,
    target: Option<Target>,
}

/// Progress of a view.
#[derive(Clone, Copy)]
pub(crate) struct Progress {
    /// Number of frames that were copied into Unity's texture.
    pub(crate) frames: u64,
    /// The last frame that was made.
    pub(crate) frame: cairn_frame,
}

struct Status {
    progress: Progress,
    /// Result of the last event, with its message.
    result: cairn_result,
    message: String,
}

static VIEWS: Mutex<Views> = Mutex::new(Views { last: 0, live: BTreeMap::new() });

struct Views {
    /// The last number given out; numbers are not reused.
    last: usize,
    live: BTreeMap<usize, Arc<View>>,
}

/// Bits of a view's number that distinguish it from other data.
const TAG: usize = 0x5600_0000_0000_0000;

/// Adds a view and returns its number.
pub(crate) fn add(device: usize, presenter: usize) -> usize {
    let progress = Progress { frames: 0, frame: no_frame() };
    let view = View {
        device,
        presenter,
        next: Mutex::default(),
        status: Mutex::new(Status { progress, result: CAIRN_NOT_READY, message: String::new() }),
        ring: Mutex::default(),
    };
    let mut views = VIEWS.lock();
    views.last += 1;
    let number = TAG | views.last;
    views.live.insert(number, Arc::new(view));
    number
}

/// The view of a number.
pub(crate) fn find(number: usize) -> Option<Arc<View>> {
    VIEWS.lock().live.get(&number).cloned()
}

/// Removes a view; events that still name it do nothing.
pub(crate) fn remove(number: usize) -> Option<Arc<View>> {
    VIEWS.lock().live.remove(&number)
}

/// Releases what all views hold of a device that is about to disappear.
pub(crate) fn release() {
    let all: Vec<_> = VIEWS.lock().live.values().cloned().collect();
    for view in all {
        view.release();
    }
}

impl View {
    /// Sets time and texture of the next frame.
    pub(crate) fn set_next(&self, now: u64, target: Option<Target>) {
        // Dropping the last reference to a texture is slow, so it happens outside the lock.
        let _before = std::mem::replace(&mut *self.next.lock(), NextFrame { now, target });
    }

    /// Time and texture of the next frame.
    #[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
    pub(crate) fn next_frame(&self) -> Option<(u64, Target)> {
        let NextFrame { now, target } = self.next.lock().clone();
        Some((now, target?))
    }

    /// Records the result of an event.
    pub(crate) fn set_result(&self, result: EventResult) {
        let mut status = self.status.lock();
        match result {
            EventResult::Made(frame) => (status.progress.frame, status.result) = (frame, 0),
            EventResult::Shown => status.progress.frames += 1,
            EventResult::Nothing => {}
            EventResult::Failed(result, message) => (status.result, status.message) = (result, message),
        }
        if status.result >= 0 {
            status.message.clear();
        }
    }

    /// Progress, and result and message of the last event that did something.
    pub(crate) fn status(&self) -> (Progress, cairn_result, String) {
        let status = self.status.lock();
        (status.progress, status.result, status.message.clone())
    }

    /// Releases what the view holds of a device. It can be used again afterwards.
    pub(crate) fn release(&self) {
        self.set_next(0, None);
        self.ring.lock().release();
    }
}

/// Result of an event.
#[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
pub(crate) enum EventResult {
    Made(cairn_frame),
    Shown,
    /// There was nothing to do.
    Nothing,
    Failed(cairn_result, String),
}

/// A frame with no content.
pub(crate) fn no_frame() -> cairn_frame {
    cairn_frame {
        struct_size: size_of::<cairn_frame>() as u32,
        source: 0,
        position: 0,
        since_ns: 0,
        until_ns: 0,
        previous: 0,
        current: 0,
        t: 0.0,
        flags: 0,
    }
}
