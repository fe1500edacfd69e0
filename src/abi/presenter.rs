//! Presenters: which frame is due when, and its picture.

use std::ffi::c_char;

use std::time::Duration;

use parking_lot::Mutex;

use super::anchor::cairn_anchor;
use super::boundary::call;
use super::d3d12::behind::{HAS_SHADERS, Recording};
use super::d3d12::{Guard, To};
use super::guidance::{cairn_guidance, motion_source};
use super::handles::{Handle, Kind, Object, destroy, enter, enter_alone, insert};
use super::images::{Target, cairn_target};
use super::results::{
    CAIRN_ERROR_UNSUPPORTED, CAIRN_NOT_READY, CAIRN_OK, CAIRN_QUEUE_FULL, Failure, Outcome, cairn_result,
};
use super::structs::{Out, check_out, describe, read_or_default};
use super::text::fixed_text;
use crate::framegen::cpu::CpuGenerator;
use crate::framegen::{FrameGenerator, Phases};
use crate::present::pacing::Interval;
use crate::present::presenter::{Presenter, PresenterOptions, Shown, ShownSource};
use crate::runtime::Device;

/// The generator is used where it can be.
pub const CAIRN_PREFER_AUTO: u32 = 0;
/// The generator is used, or the presenter is not made.
pub const CAIRN_PREFER_REQUIRE: u32 = 1;
/// The generator is not used.
pub const CAIRN_PREFER_NEVER: u32 = 2;

/// A flag of cairn_presenter_options: where an anchor is late the last one stands; its motion does not go on.
pub const CAIRN_PRESENTER_HOLD_LATE: u32 = 1;
/// A flag of cairn_presenter_options: after a late anchor frames are shown sooner, by a quarter of a frame for each anchor,
/// until anchors are due delay_ns after they come again. For hosts that make anchors at a steady pace, and not as fast as
/// they can.
pub const CAIRN_PRESENTER_CATCH_UP: u32 = 2;
/// A flag of cairn_presenter_options: frames are generated also where the anchor brings as many decoded pictures as there
/// are frames to an anchor.
pub const CAIRN_PRESENTER_NO_DECODED: u32 = 4;

/// Display-referred sRGB, as pictures are.
pub const CAIRN_COLOUR_SRGB: u32 = 0;
/// Linear light of the same primaries, 1 being white; for CAIRN_FORMAT_RGBA16F only.
pub const CAIRN_COLOUR_LINEAR: u32 = 1;

/// A frame is an anchor.
pub const CAIRN_FRAME_ANCHOR: u32 = 1;
/// A frame is a picture that the later anchor brought with it.
pub const CAIRN_FRAME_DECODED: u32 = 2;
/// A frame is generated between two anchors.
pub const CAIRN_FRAME_GENERATED: u32 = 3;
/// A frame is generated beyond the last anchor, as the next one is late.
pub const CAIRN_FRAME_EXTRAPOLATED: u32 = 4;
/// A frame is a picture that stands, as nothing can be generated: between two anchors the nearer, else the last.
pub const CAIRN_FRAME_HELD: u32 = 5;

/// A flag of cairn_frame: a cut keeps it from being generated.
pub const CAIRN_FRAME_CUT: u32 = 1;
/// A flag of cairn_frame: it is the very picture that was drawn before.
pub const CAIRN_FRAME_REPEATED: u32 = 2;

/// Shows a stream of anchors at a steady rate: it is given anchors as they come, knows which frame is due when, generates it
/// and writes it into the host's memory. It reads no clock: every time is the host's, in nanoseconds from wherever it likes.
///
/// Anchor i is due at origin + i * interval, where origin is when the first came, plus the delay. Between two anchors that
/// are there, frames are generated; while the next one is late the motion of the last goes on for at most an interval, and
/// then the picture stands. An anchor that comes after it was due is due when it comes, and those after it are later by as
/// much: a world that is too slow is shown slowly, and whole.
pub struct cairn_presenter(());

/// What lies behind a handle of a presenter.
pub(super) struct Presenting {
    presenter: Presenter,
    linear: bool,
    /// How the generator of shaders is preferred.
    shader: u32,
    /// The generator on the processor; empty where it is not used.
    generator: &'static str,
    /// Why a preference was not met.
    preference: String,
    /// What frames for Direct3D 12 are recorded with.
    recording: Mutex<Recording>,
}

impl Handle for cairn_presenter {
    const KIND: Kind = Kind::Presenter;
    const NAME: &'static str = "cairn_presenter";
    type Object = Presenting;
}

impl Object for Presenting {}

impl Presenting {
    /// Records the frame that is due at `now`; where no list is given also what guards the target.
    ///
    /// # Safety
    /// What `to` points to are objects of COM and live during the call.
    pub(super) unsafe fn record(&self, device: &Device, now: u64, to: &To) -> Outcome<Option<(Shown, Option<Guard>)>> {
        if !device.is_gpu() {
            return Err(Failure::no_d3d12());
        }
        let asked = Asked { presenter: &self.presenter, linear: self.linear, shader: self.shader };
        // SAFETY: the caller's promise.
        unsafe { self.recording.lock().record(&asked, device, now, to) }
    }

    /// Waits until all frames have run, and lets go of their targets.
    pub(super) fn release(&self) -> Outcome<()> {
        self.recording.lock().release()
    }

    /// The generator of the frame that was made last, and why no other is used.
    fn used(&self) -> (&'static str, String) {
        match self.recording.lock().used(&self.presenter) {
            None => (self.generator, self.preference.clone()),
            Some((true, why)) => ("shader", why),
            Some((false, why)) => (self.generator, why),
        }
    }
}

/// What frames for Direct3D 12 are recorded of, and how.
#[cfg_attr(not(windows), expect(dead_code, reason = "what stands behind the door reads it"))]
pub(super) struct Asked<'a> {
    pub(super) presenter: &'a Presenter,
    pub(super) linear: bool,
    pub(super) shader: u32,
}

/// How anchors are shown. All zero: two frames to an anchor, one interval after they come.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_presenter_options {
    /// sizeof(cairn_presenter_options)
    pub struct_size: u32,
    /// Frames to an anchor: 1, 2, 3, 4 or 6; 0 for 2.
    pub multiplier: u32,
    /// Size of the frames in pixels, 1 to 16384 each way; 0 both ways for the anchors'.
    pub width: u32,
    /// See width.
    pub height: u32,
    /// Nanoseconds from one anchor to the next, at most 60 seconds; 0 for what the first anchor's latents_per_second says.
    pub interval_ns: u64,
    /// Nanoseconds from when an anchor comes until it is due, at most 60 seconds; 0 for an interval. Frames between need the
    /// anchor after, so that less than (multiplier - 1) / multiplier of an interval makes frames late.
    pub delay_ns: u64,
    /// CAIRN_PRESENTER_HOLD_LATE, CAIRN_PRESENTER_CATCH_UP, CAIRN_PRESENTER_NO_DECODED
    pub flags: u32,
    /// Anchors that may wait for their time, 1 to CAIRN_MAX_QUEUE; 0 for 4.
    pub capacity: u32,
    /// Where motion comes from when an anchor comes without guidance: CAIRN_MOTION_AUTO and so on.
    pub motion: u32,
    /// CAIRN_COLOUR_SRGB or CAIRN_COLOUR_LINEAR
    pub colour_space: u32,
    /// AMD FidelityFX frame generation, for Direct3D 12: CAIRN_PREFER_AUTO and so on.
    pub fsr: u32,
    /// The library's own shaders, for Direct3D 12.
    pub shader: u32,
    /// The library's own generator on the processor.
    pub cpu: u32,
    /// 0
    pub reserved: u32,
}
describe!(cairn_presenter_options, [], {
    struct_size, multiplier, width, height, interval_ns, delay_ns, flags, capacity, motion, colour_space, fsr, shader, cpu,
    reserved,
});

/// A frame of a presenter.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_frame {
    /// sizeof(cairn_frame)
    pub struct_size: u32,
    /// CAIRN_FRAME_ANCHOR to CAIRN_FRAME_HELD
    pub source: u32,
    /// Place in the stream: anchor i, counted from 0 as they came, has place i * multiplier. When a late anchor comes it may
    /// step back.
    pub position: u64,
    /// When it is due. For the first anchor this may be yet to come: it is shown from its arrival on.
    pub since_ns: u64,
    /// When the next one is due, if no anchor is late.
    pub until_ns: u64,
    /// Number of the anchor that it shows or starts from.
    pub previous: u64,
    /// Number of the anchor that it leads to; the same where it leads to none.
    pub current: u64,
    /// Intervals from the previous anchor, 0 to 1.
    pub t: f32,
    /// CAIRN_FRAME_CUT, CAIRN_FRAME_REPEATED
    pub flags: u32,
}
describe!(cairn_frame, [], { struct_size, source, position, since_ns, until_ns, previous, current, t, flags });

/// What a presenter has done since it was made.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_presenter_statistics {
    /// sizeof(cairn_presenter_statistics)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Anchors that came.
    pub anchors: u64,
    /// Those that came after they were due.
    pub late_anchors: u64,
    /// Nanoseconds that time stood still for late ones.
    pub slipped_ns: u64,
    /// Frames drawn that were anchors. A frame drawn again counts again, here and below.
    pub shown_anchors: u64,
    /// Frames drawn that anchors brought with them.
    pub shown_decoded: u64,
    /// Frames drawn that were generated between anchors.
    pub shown_generated: u64,
    /// Frames drawn that were generated beyond the last anchor.
    pub shown_extrapolated: u64,
    /// Frames drawn that stood.
    pub shown_held: u64,
    /// Those of all of them that were the same as the one drawn before.
    pub repeated: u64,
    /// Those that a cut kept from being generated.
    pub cuts: u64,
    /// Nanoseconds of finding motion and depth.
    pub guidance_ns: u64,
    /// Nanoseconds of generating.
    pub generate_ns: u64,
    /// Nanoseconds of resizing.
    pub resize_ns: u64,
    /// The generator that is used, such as "cpu"; empty where there is none.
    pub generator: [c_char; 32],
    /// Why a generator that might be better is not used, for people; UTF-8.
    pub preference: [c_char; 160],
}
describe!(cairn_presenter_statistics, [], {
    struct_size, reserved, anchors, late_anchors, slipped_ns, shown_anchors, shown_decoded, shown_generated,
    shown_extrapolated, shown_held, repeated, cuts, guidance_ns, generate_ns, resize_ns, generator, preference,
});

/// Makes a presenter.
///
/// options: may be null for the defaults.
///
/// Ownership: on success *presenter is the caller's, for cairn_presenter_destroy; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED for a required generator
/// that is not there; CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_create(
    options: *const cairn_presenter_options,
    presenter: *mut *mut cairn_presenter,
) -> cairn_result {
    call("cairn_presenter_create", || {
        check_out(presenter, "presenter")?;
        // SAFETY: the host's promise about `options`.
        let options = unsafe { read_or_default(options, "options") }?;
        let handle = insert::<cairn_presenter>(make(&options)?)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { presenter.write(handle) };
        Ok(CAIRN_OK)
    })
}

/// Gives a presenter the next anchor. What comes without a number one above the last, or with CAIRN_ANCHOR_CUT, is a cut:
/// nothing is generated between it and the one before.
///
/// guidance: of the anchor before and this one; null to have the presenter find it.
/// now_ns: when it came, on the host's clock.
///
/// Ownership: anchor and guidance stay the caller's; on success the presenter keeps what it needs of them, on failure nothing.
/// Threads: any thread, at any time, also while a frame is drawn. A time before one that was heard of counts as that one.
/// Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT for another size than the first
/// anchor's, and for a first one without a rate where the options have no interval.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_push(
    presenter: *const cairn_presenter,
    anchor: *const cairn_anchor,
    guidance: *const cairn_guidance,
    now_ns: u64,
) -> cairn_result {
    call("cairn_presenter_push", || {
        let presenting = enter(presenter)?;
        let anchor = enter(anchor)?.share();
        let guidance = if guidance.is_null() { None } else { Some(enter(guidance)?.share()) };
        let taken = presenting.presenter.push(anchor, guidance, now_ns)?;
        Ok(if taken { CAIRN_OK } else { CAIRN_QUEUE_FULL })
    })
}

/// Says which frame is due. Takes less than a microsecond.
///
/// now_ns: when it will be shown, on the host's clock.
///
/// Ownership: frame stays the caller's and is filled on success; on failure, and when there is none, it is not written.
/// Threads: any thread, at any time, also while a frame is drawn.
/// Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor came; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT;
/// CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_query(
    presenter: *const cairn_presenter,
    now_ns: u64,
    frame: *mut cairn_frame,
) -> cairn_result {
    call("cairn_presenter_query", || {
        let presenting = enter(presenter)?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::new(frame, "frame") }?;
        let Some(shown) = presenting.presenter.query(now_ns) else { return Ok(CAIRN_NOT_READY) };
        frame.write(&to_header(&shown));
        Ok(CAIRN_OK)
    })
}

/// Makes the frame that is due and writes it. One that is due already when it is drawn again is not made again. A generator
/// may find a cut that cairn_presenter_query could not know of; frame says what was drawn.
///
/// now_ns: when it will be shown, on the host's clock.
/// target: of the frames' size.
/// frame: may be null.
///
/// Ownership: the pixels are copied and frame is filled, on success; on failure, and when there is none, neither is written.
/// Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor came; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also
/// when CAIRN_MOTION_PAPER meets an anchor without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_draw(
    presenter: *mut cairn_presenter,
    now_ns: u64,
    target: *const cairn_target,
    frame: *mut cairn_frame,
) -> cairn_result {
    call("cairn_presenter_draw", || {
        let presenting = enter_alone(presenter)?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::optional(frame, "frame") }?;
        if presenting.shader == CAIRN_PREFER_REQUIRE {
            let why = "the shader generator, which options.shader requires, makes no frames in memory";
            return Err(Failure::new(CAIRN_ERROR_UNSUPPORTED, why)
                .remedy("Record frames for Direct3D 12, or do not require it"));
        }
        let Some(size) = presenting.presenter.size() else { return Ok(CAIRN_NOT_READY) };
        // SAFETY: the host's promise about `target`.
        let target = unsafe { Target::new(target, size, "target") }?.in_linear_light(presenting.linear)?;
        let shown = presenting.presenter.draw(now_ns, size, |picture| target.write(picture))?;
        let Some(shown) = shown else { return Ok(CAIRN_NOT_READY) };
        frame.into_iter().for_each(|frame| frame.write(&to_header(&shown)));
        Ok(CAIRN_OK)
    })
}

/// Forgets all anchors and when they came: the next one is a first again, of any size.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_reset(presenter: *const cairn_presenter) -> cairn_result {
    call("cairn_presenter_reset", || {
        enter(presenter)?.presenter.reset();
        Ok(CAIRN_OK)
    })
}

/// Says what a presenter has done, and with what.
///
/// Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_get_statistics(
    presenter: *const cairn_presenter,
    statistics: *mut cairn_presenter_statistics,
) -> cairn_result {
    call("cairn_presenter_get_statistics", || {
        let presenting = enter(presenter)?;
        // SAFETY: the host's promise about `statistics`.
        let statistics = unsafe { Out::new(statistics, "statistics") }?;
        // First, as it may find out more.
        let (generator, preference) = presenting.used();
        let done = presenting.presenter.statistics();
        statistics.write(&cairn_presenter_statistics {
            struct_size: 0,
            reserved: 0,
            anchors: done.anchors,
            late_anchors: done.late,
            slipped_ns: done.slipped_ns,
            shown_anchors: done.shown_anchors,
            shown_decoded: done.decoded,
            shown_generated: done.generated,
            shown_extrapolated: done.extrapolated,
            shown_held: done.held,
            repeated: done.repeated,
            cuts: done.cuts,
            guidance_ns: nanoseconds(done.guidance),
            generate_ns: nanoseconds(done.generate),
            resize_ns: nanoseconds(done.resize),
            generator: fixed_text(generator),
            preference: fixed_text(&preference),
        });
        Ok(CAIRN_OK)
    })
}

/// Destroys the handle of a presenter; null is allowed.
///
/// Ownership: on success presenter is no handle any more; on failure it is as it was.
/// Threads: any thread; waits for calls in flight on the presenter.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_destroy(presenter: *mut cairn_presenter) -> cairn_result {
    call("cairn_presenter_destroy", || destroy(presenter))
}

fn make(options: &cairn_presenter_options) -> Outcome<Presenting> {
    let wrong = |field: &str, why: String| Failure::argument(&format!("options.{field}"), why);
    let refuse = |field: &str, why: String| Err(wrong(field, why));
    let multiplier = match options.multiplier {
        0 => 2,
        known @ (1 | 2 | 3 | 4 | 6) => known,
        other => {
            let why = format!("there cannot be {other} frames to an anchor");
            return Err(wrong("multiplier", why).remedy("Use 1, 2, 3, 4 or 6"));
        }
    };
    let known = CAIRN_PRESENTER_HOLD_LATE | CAIRN_PRESENTER_CATCH_UP | CAIRN_PRESENTER_NO_DECODED;
    if options.flags & !known != 0 {
        return refuse("flags", format!("{:#x} has an unknown bit", options.flags));
    }
    if options.reserved != 0 {
        return refuse("reserved", "it must be 0".into());
    }
    let capacity = match options.capacity {
        0 => 4,
        capacity @ 1..=super::rollout::CAIRN_MAX_QUEUE => capacity,
        other => return refuse("capacity", format!("{other} anchors cannot wait")),
    };
    let linear = match options.colour_space {
        CAIRN_COLOUR_SRGB => false,
        CAIRN_COLOUR_LINEAR => true,
        other => return refuse("colour_space", format!("{other} is no colour space of this library")),
    };
    let (generator, preference) = choose(options)?;
    let interval = match options.interval_ns {
        0 => None,
        ns => Some(Interval::of_ns(ns)?),
    };
    let made = PresenterOptions {
        interval,
        multiplier,
        delay_ns: (options.delay_ns > 0).then_some(options.delay_ns),
        catch_up: options.flags & CAIRN_PRESENTER_CATCH_UP != 0,
        extrapolate: options.flags & CAIRN_PRESENTER_HOLD_LATE == 0,
        decoded: options.flags & CAIRN_PRESENTER_NO_DECODED == 0,
        size: ((options.width, options.height) != (0, 0)).then_some((options.width, options.height)),
        capacity: capacity as usize,
        motion: motion_source(options.motion, "options.motion")?,
    };
    let name = if generator.is_some() { "cpu" } else { "" };
    let mut presenter = Presenter::new(made, generator)?;
    if HAS_SHADERS && options.shader != CAIRN_PREFER_NEVER {
        presenter = presenter.with_phases(Phases::Any);
    }
    Ok(Presenting {
        presenter,
        linear,
        shader: options.shader,
        generator: name,
        preference,
        recording: Mutex::default(),
    })
}

/// The generator that the preferences lead to, and why others are not used.
fn choose(options: &cairn_presenter_options) -> Outcome<(Option<Box<dyn FrameGenerator>>, String)> {
    let preferences = [("fsr", options.fsr), ("shader", options.shader), ("cpu", options.cpu)];
    for (name, preference) in preferences {
        if preference > CAIRN_PREFER_NEVER {
            let why = format!("{preference} is no preference");
            return Err(Failure::argument(&format!("options.{name}"), why));
        }
    }
    let required = preferences.iter().filter(|(_, preference)| *preference == CAIRN_PREFER_REQUIRE);
    if required.count() > 1 {
        return Err(Failure::argument("options.cpu", "only one generator can be required"));
    }
    let missing = || {
        let failure = if HAS_SHADERS { Failure::new(CAIRN_ERROR_UNSUPPORTED, ELSEWHERE) } else { Failure::no_d3d12() };
        failure.remedy("Use the cpu generator")
    };
    for (name, preference) in &preferences[..if HAS_SHADERS { 1 } else { 2 }] {
        if *preference == CAIRN_PREFER_REQUIRE {
            return Err(missing().field(format!("options.{name}")));
        }
    }
    let wanted: Vec<_> = preferences[..2].iter().filter(|(_, p)| *p == CAIRN_PREFER_AUTO).map(|(n, _)| *n).collect();
    let reason = if wanted.is_empty() || options.cpu == CAIRN_PREFER_REQUIRE {
        String::new()
    } else {
        format!("{}: {}", wanted.join(", "), missing())
    };
    let generator: Option<Box<dyn FrameGenerator>> = match (options.cpu, options.shader) {
        (CAIRN_PREFER_NEVER, _) | (_, CAIRN_PREFER_REQUIRE) => None,
        _ => Some(Box::new(CpuGenerator::new())),
    };
    Ok((generator, reason))
}

/// Why what is in memory is not made by a device.
const ELSEWHERE: &str = "frames are made with it where they are recorded for Direct3D 12";

pub(super) fn to_header(shown: &Shown) -> cairn_frame {
    let source = match shown.source {
        ShownSource::Anchor => CAIRN_FRAME_ANCHOR,
        ShownSource::Decoded => CAIRN_FRAME_DECODED,
        ShownSource::Generated => CAIRN_FRAME_GENERATED,
        ShownSource::Extrapolated => CAIRN_FRAME_EXTRAPOLATED,
        ShownSource::Held => CAIRN_FRAME_HELD,
    };
    let cut = if shown.cut { CAIRN_FRAME_CUT } else { 0 };
    let repeated = if shown.repeated { CAIRN_FRAME_REPEATED } else { 0 };
    cairn_frame {
        struct_size: 0,
        source,
        position: shown.due.position,
        since_ns: shown.due.since_ns,
        until_ns: shown.due.until_ns,
        previous: shown.previous,
        current: shown.current,
        t: shown.t,
        flags: cut | repeated,
    }
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}
