//! Views: what is shown where. C# makes them and tells them what is next; Unity's events carry their numbers.
//!
//! An event runs frames later than it was asked for, when what it was asked for may be gone. So it carries a number that is looked
//! up, and never an address; and a view holds references to what it is told to show into.

use std::collections::BTreeMap;
use std::sync::Arc;

use cairn::abi::presenter::cairn_frame;
use cairn::abi::results::{CAIRN_NOT_READY, cairn_result};
use parking_lot::Mutex;

use super::drawing::{Target, TargetRing};

/// What a presenter of Cairn's shows in a texture of Unity's.
#[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
pub(crate) struct View {
    /// Handles of Cairn's, as numbers: whoever uses them is told when they are gone.
    pub(crate) device: usize,
    pub(crate) presenter: usize,
    wanted: Mutex<Wanted>,
    told: Mutex<Told>,
    /// Held by the one event at a time that draws.
    pub(crate) ring: Mutex<TargetRing>,
}

/// What is to be shown next.
#[derive(Default, Clone)]
struct Wanted {
    now: u64,
    target: Option<Target>,
}

/// What has been shown.
#[derive(Clone, Copy)]
pub(crate) struct Shown {
    /// Frames that were copied into Unity's texture.
    pub(crate) frames: u64,
    /// The last one that was made.
    pub(crate) frame: cairn_frame,
}

struct Told {
    shown: Shown,
    /// How the last event ended, and with which message.
    result: cairn_result,
    message: String,
}

static VIEWS: Mutex<Views> = Mutex::new(Views { last: 0, live: BTreeMap::new() });

struct Views {
    /// No number is used again.
    last: usize,
    live: BTreeMap<usize, Arc<View>>,
}

/// The part of a view's number that says that it is one.
const MARK: usize = 0x5600_0000_0000_0000;

/// A new view; its number.
pub(crate) fn add(device: usize, presenter: usize) -> usize {
    let shown = Shown { frames: 0, frame: no_frame() };
    let view = View {
        device,
        presenter,
        wanted: Mutex::default(),
        told: Mutex::new(Told { shown, result: CAIRN_NOT_READY, message: String::new() }),
        ring: Mutex::default(),
    };
    let mut views = VIEWS.lock();
    views.last += 1;
    let number = MARK | views.last;
    views.live.insert(number, Arc::new(view));
    number
}

/// The view of a number.
pub(crate) fn find(number: usize) -> Option<Arc<View>> {
    VIEWS.lock().live.get(&number).cloned()
}

/// Takes a view out; events that still name it find nothing.
pub(crate) fn remove(number: usize) -> Option<Arc<View>> {
    VIEWS.lock().live.remove(&number)
}

/// Has all views let go of what they hold of a device that goes.
pub(crate) fn let_go() {
    let all: Vec<_> = VIEWS.lock().live.values().cloned().collect();
    for view in all {
        view.let_go();
    }
}

impl View {
    /// Says what is shown next.
    pub(crate) fn want(&self, now: u64, target: Option<Target>) {
        // A texture may go with the last reference to it, which takes long enough to hold no lock.
        let _before = std::mem::replace(&mut *self.wanted.lock(), Wanted { now, target });
    }

    /// When the next frame is shown, and where.
    #[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
    pub(crate) fn wanted(&self) -> Option<(u64, Target)> {
        let Wanted { now, target } = self.wanted.lock().clone();
        Some((now, target?))
    }

    /// Keeps how an event ended.
    pub(crate) fn tell(&self, ended: Ended) {
        let mut told = self.told.lock();
        match ended {
            Ended::Made(frame) => (told.shown.frame, told.result) = (frame, 0),
            Ended::Shown => told.shown.frames += 1,
            Ended::Nothing => {}
            Ended::Failed(result, message) => (told.result, told.message) = (result, message),
        }
        if told.result >= 0 {
            told.message.clear();
        }
    }

    /// What has been shown, how the last event that did something ended, and with which message.
    pub(crate) fn told(&self) -> (Shown, cairn_result, String) {
        let told = self.told.lock();
        (told.shown, told.result, told.message.clone())
    }

    /// Lets go of what it holds of a device. It may be told to show again.
    pub(crate) fn let_go(&self) {
        self.want(0, None);
        self.ring.lock().let_go();
    }
}

/// How an event ended.
#[cfg_attr(not(windows), expect(dead_code, reason = "nothing is drawn there"))]
pub(crate) enum Ended {
    Made(cairn_frame),
    Shown,
    /// There was nothing to do.
    Nothing,
    Failed(cairn_result, String),
}

/// A frame that says nothing.
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
