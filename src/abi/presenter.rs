//! Presenters: which frame is due when, and its picture.

use std::time::Duration;

use super::anchor::cairn_anchor;
use super::boundary::call;
use super::d3d12::behind::{self, HAS_SHADERS};
use super::d3d12::{DeviceStatistics, Recorded, To, cairn_d3d12_preparation};
use super::guidance::{cairn_guidance, motion_source};
use super::handles::{Handle, Kind, Object, destroy, enter, enter_alone, insert};
use super::images::{Target, cairn_target};
use super::preferences::{choose, colours};
use super::results::{
    CAIRN_ERROR_UNSUPPORTED, CAIRN_NOT_READY, CAIRN_OK, CAIRN_QUEUE_FULL, Failure, Outcome, cairn_result,
};
use super::structs::{Out, check_out, describe, read_or_default, slice};
use crate::Colours;
use crate::framegen::Phases;
use crate::present::Selection;
use crate::present::pacing::Interval;
use crate::present::presenter::{FrameInfo, FrameSource, Presenter, PresenterOptions};
use crate::runtime::Device;

/// The generator is used where it can be.
pub const CAIRN_PREFER_AUTO: u32 = 0;
/// The generator is used, or the presenter is not made.
pub const CAIRN_PREFER_REQUIRE: u32 = 1;
/// The generator is not used.
pub const CAIRN_PREFER_NEVER: u32 = 2;

/// A flag of cairn_presenter_options: where an anchor is late the last one is held; its motion is not extrapolated.
pub const CAIRN_PRESENTER_HOLD_LATE: u32 = 1;
/// A flag of cairn_presenter_options: after a late anchor frames are shown sooner, by a quarter of a frame for each anchor,
/// until anchors are due delay_ns after they come again. For hosts that make anchors at a steady pace, and not as fast as
/// they can.
pub const CAIRN_PRESENTER_CATCH_UP: u32 = 2;
/// A flag of cairn_presenter_options: frames are generated also where the anchor brings as many decoded pictures as there
/// are frames to an anchor.
pub const CAIRN_PRESENTER_NO_DECODED: u32 = 4;
/// A flag of cairn_presenter_options: frames of another aspect ratio than the anchors' keep the anchors' ratio, centred, with black bars.
/// Without it they are stretched.
pub const CAIRN_PRESENTER_LETTERBOX: u32 = 8;

/// Display-referred sRGB, as pictures are.
pub const CAIRN_COLOUR_SRGB: u32 = 0;
/// Linear, sRGB primaries, 1 is white; for CAIRN_FORMAT_RGBA16F, and textures of R11G11B10_FLOAT, only.
pub const CAIRN_COLOUR_LINEAR: u32 = 1;
/// scRGB: linear, sRGB primaries, 1 is 80 nits; for CAIRN_FORMAT_RGBA16F only.
pub const CAIRN_COLOUR_SCRGB: u32 = 2;
/// HDR10: PQ transfer function, BT.2020 primaries; for CAIRN_FORMAT_RGB10A2 only.
pub const CAIRN_COLOUR_HDR10: u32 = 3;

/// A frame is an anchor.
pub const CAIRN_FRAME_ANCHOR: u32 = 1;
/// A frame is a decoded picture that came with the later anchor.
pub const CAIRN_FRAME_DECODED: u32 = 2;
/// A frame is interpolated between two anchors.
pub const CAIRN_FRAME_GENERATED: u32 = 3;
/// A frame is extrapolated beyond the last anchor, because the next one is late.
pub const CAIRN_FRAME_EXTRAPOLATED: u32 = 4;
/// A frame is a held picture, because nothing can be generated: between two anchors the nearer, else the last.
pub const CAIRN_FRAME_HELD: u32 = 5;

/// A flag of cairn_frame: it was not generated because of a cut.
pub const CAIRN_FRAME_CUT: u32 = 1;
/// A flag of cairn_frame: it is identical to the one drawn before.
pub const CAIRN_FRAME_REPEATED: u32 = 2;
/// A flag of cairn_frame: an anchor is shown in its place, as cairn_presenter_prepare_d3d12 was not called for it.
pub const CAIRN_FRAME_UNPREPARED: u32 = 4;

/// Shows a stream of anchors at a steady rate: it is given anchors as they come, knows which frame is due when, generates it
/// and writes it into the host's memory. It reads no clock: every time is the host's, in nanoseconds from wherever it likes.
///
/// Anchor i is due at origin + i * interval, where origin is when the first came, plus the delay. Between two anchors that
/// are there, frames are generated; while the next one is late the motion of the last goes on for at most an interval, and
/// then the picture stands. An anchor that comes after it was due is due when it comes, and those after it are later by as
/// much: a world that is too slow is shown slowly, and whole.
pub struct cairn_presenter(());

/// The object of a presenter's handle.
pub(super) struct Presenting {
    pub(super) presenter: Presenter,
    colours: Colours,
    /// The first of fsr, shader and upscaler that is required.
    required: Option<&'static str>,
    /// The generator on the processor; empty where it is not used.
    generator: &'static str,
    /// Why a preference was not met.
    preference: String,
    /// Makes frames for Direct3D 12.
    renderer: behind::Renderer,
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
    pub(super) unsafe fn record(&self, device: &Device, now: u64, to: &To) -> Outcome<Recorded> {
        if !device.is_gpu() {
            return Err(Failure::no_d3d12());
        }
        // SAFETY: the caller's promise.
        unsafe { behind::record(&self.renderer, &self.presenter, device, now, to) }
    }

    /// Makes all that frames need, and uses it from then on; false where it is not known how large anchors are. Frames are recorded meanwhile.
    pub(super) fn prepare(&self, device: &Device, wanted: &cairn_d3d12_preparation) -> Outcome<bool> {
        if !device.is_gpu() {
            return Err(Failure::no_d3d12());
        }
        behind::prepare(&self.renderer, &self.presenter, device, wanted)
    }

    /// Waits until all frames have run, and releases their targets.
    pub(super) fn release(&self) -> Outcome<()> {
        behind::release(&self.renderer)
    }

    /// What frames for Direct3D 12 have taken and who made them; none where the call is nested in one that records.
    pub(super) fn device_statistics(&self, is_nested: bool) -> Option<DeviceStatistics> {
        behind::statistics(&self.renderer, &self.presenter, is_nested)
    }

    /// The upscaler of the last frame, and why AMD's was not used.
    pub(super) fn upscaler(&self, done: &DeviceStatistics) -> Selection {
        done.upscaler.clone().unwrap_or_else(|| {
            let scales = self.presenter.size().zip(self.presenter.anchor_size()).is_some_and(|(size, of)| size != of);
            Selection { name: if scales { "spatial" } else { "" }.to_owned(), reason: String::new() }
        })
    }

    /// The generator of the last frame, and why a preferred one was not used.
    pub(super) fn generator(&self, done: &DeviceStatistics) -> Selection {
        let used = done.generator.clone();
        let used = used.unwrap_or_else(|| Selection { name: String::new(), reason: self.preference.clone() });
        if used.name.is_empty() { Selection { name: self.generator.to_owned(), ..used } } else { used }
    }
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
    /// Nanoseconds from an anchor's arrival until it is due, at most 60 seconds; 0 for an interval. Frames between two anchors need the
    /// later one, so a delay below (multiplier - 1) / multiplier of an interval makes frames late.
    pub delay_ns: u64,
    /// CAIRN_PRESENTER_HOLD_LATE, CAIRN_PRESENTER_CATCH_UP, CAIRN_PRESENTER_NO_DECODED, CAIRN_PRESENTER_LETTERBOX
    pub flags: u32,
    /// Anchors that may wait for their time, 1 to CAIRN_MAX_QUEUE; 0 for 4.
    pub capacity: u32,
    /// Where motion comes from when an anchor comes without guidance: CAIRN_MOTION_AUTO and so on.
    pub motion: u32,
    /// CAIRN_COLOUR_SRGB to CAIRN_COLOUR_HDR10
    pub colour_space: u32,
    /// AMD FidelityFX frame generation, for frames half way between two anchors that are recorded for Direct3D 12:
    /// CAIRN_PREFER_AUTO and so on. Needs the library's own shaders, which make all others.
    pub fsr: u32,
    /// The library's own shaders, for Direct3D 12.
    pub shader: u32,
    /// The library's own generator on the processor.
    pub cpu: u32,
    /// 0
    pub reserved: u32,
    /// Brightness of the pictures' white in CAIRN_COLOUR_SCRGB and CAIRN_COLOUR_HDR10, 1 to 10000 nits; 0 for 203. 0 for the others.
    pub white_nits: u32,
    /// 0
    pub reserved_too: u32,
    /// AMD FidelityFX upscaling, for frames for Direct3D 12 that are larger than anchors: CAIRN_PREFER_AUTO and so on. It makes anchors
    /// larger before frames are generated between them. Without it each frame is resized in space. Needs the library's own shaders.
    pub upscaler: u32,
    /// 0
    pub reserved_also: u32,
}
describe!(cairn_presenter_options, [64, 72], {
    struct_size, multiplier, width, height, interval_ns, delay_ns, flags, capacity, motion, colour_space, fsr, shader, cpu,
    reserved, white_nits, reserved_too, upscaler, reserved_also,
});

/// A frame of a presenter.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_frame {
    /// sizeof(cairn_frame)
    pub struct_size: u32,
    /// CAIRN_FRAME_ANCHOR to CAIRN_FRAME_HELD
    pub source: u32,
    /// Position in the stream: anchor i, counted from 0 in order of arrival, is at i * multiplier. It may step back when a late anchor
    /// arrives.
    pub position: u64,
    /// When it is due. For the first anchor this may be yet to come: it is shown from its arrival on.
    pub since_ns: u64,
    /// When the next one is due, if no anchor is late.
    pub until_ns: u64,
    /// Number of the anchor that it shows or starts from.
    pub previous: u64,
    /// Number of the anchor that it leads to; the same as from where there is none.
    pub current: u64,
    /// Intervals from the previous anchor, 0 to 1.
    pub t: f32,
    /// CAIRN_FRAME_CUT, CAIRN_FRAME_REPEATED, CAIRN_FRAME_UNPREPARED
    pub flags: u32,
}
describe!(cairn_frame, [], { struct_size, source, position, since_ns, until_ns, previous, current, t, flags });

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
/// nothing is generated between it and the one before. An anchor that a Direct3D 12 device still works on has come once its fence
/// says so, which is looked at whenever a frame is asked for and no queue waits for; until then it is late.
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
/// when CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS meets an anchor without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
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
        if let Some(name) = presenting.required {
            let why = format!("what options.{name} requires makes no frames in memory");
            return Err(Failure::new(CAIRN_ERROR_UNSUPPORTED, why)
                .remedy("Record frames for Direct3D 12, or do not require it"));
        }
        let Some(size) = presenting.presenter.size() else { return Ok(CAIRN_NOT_READY) };
        // SAFETY: the host's promise about `target`.
        let target = unsafe { Target::new(target, size, "target") }?.in_colours(presenting.colours)?;
        let shown = presenting.presenter.draw(now_ns, size, |picture| target.write(picture))?;
        let Some(shown) = shown else { return Ok(CAIRN_NOT_READY) };
        frame.into_iter().for_each(|frame| frame.write(&to_header(&shown)));
        Ok(CAIRN_OK)
    })
}

/// Changes the size of the frames, as a window's changes. The stream goes on, and what is drawn next has the new size.
///
/// width, height: as in cairn_presenter_options; 0 both ways for the anchors'.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time, also while a frame is drawn.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_resize(
    presenter: *const cairn_presenter,
    width: u32,
    height: u32,
) -> cairn_result {
    call("cairn_presenter_resize", || {
        let presenting = enter(presenter)?;
        presenting.presenter.resize(((width, height) != (0, 0)).then_some((width, height)))?;
        Ok(CAIRN_OK)
    })
}

/// Sets the static overlay, like a HUD, that covers the anchors from the next frame on and does not move with them. Without a mask it is
/// detected from colours that do not change. All generators use it. cairn_presenter_reset removes it.
///
/// mask: a byte to a pixel of an anchor, row by row from the top left, 0 where nothing lies over it; null, with 0 for all the rest, for
/// nothing known.
/// size: bytes of mask: width * height.
/// width, height: the anchors' size.
///
/// Ownership: the mask is copied, on success; on failure nothing is.
/// Threads: any thread, at any time, also while a frame is drawn.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for another size than that of the anchors that
/// have come; CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_set_overlay(
    presenter: *const cairn_presenter,
    mask: *const u8,
    size: usize,
    width: u32,
    height: u32,
) -> cairn_result {
    call("cairn_presenter_set_overlay", || {
        let presenting = enter(presenter)?;
        if mask.is_null() && (size, width, height) == (0, 0, 0) {
            presenting.presenter.set_overlay(None)?;
            return Ok(CAIRN_OK);
        }
        let sides = 1..=crate::MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(Failure::argument("width", format!("{width} x {height} pixels")));
        }
        let needed = u64::from(width) * u64::from(height);
        if size as u64 != needed {
            return Err(Failure::argument("size", format!("{size} bytes where {needed} are due")));
        }
        // SAFETY: so many bytes may be read there by the host's promise.
        let mask = unsafe { slice(mask, size, "mask") }?;
        let mut copied = Vec::new();
        copied.try_reserve_exact(size).map_err(|_| {
            let why = format!("a mask of {size} bytes cannot be kept");
            crate::Error::new(crate::ErrorKind::OutOfMemory, why)
        })?;
        copied.extend_from_slice(mask);
        presenting.presenter.set_overlay(Some(((width, height), copied)))?;
        Ok(CAIRN_OK)
    })
}

/// Limits the device time of frames for Direct3D 12. If it is too short for all frames, only every second, third or sixth frame of an
/// interval is generated, depending on the multiplier, and the others repeat the previous one; more are generated when there is time again.
/// The choice depends on the device times of completed frames. Changes are logged, and the statistics have them.
///
/// frame_ns: nanoseconds of device time per frame shown, averaged over an interval, including work done once per anchor; 0 for no
/// budget.
///
/// Ownership: nothing is handed over, on success or on failure.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_set_budget(presenter: *const cairn_presenter, frame_ns: u64) -> cairn_result {
    call("cairn_presenter_set_budget", || {
        let budget = (frame_ns > 0).then(|| Duration::from_nanos(frame_ns));
        enter(presenter)?.presenter.set_budget(budget)?;
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
    let known =
        CAIRN_PRESENTER_HOLD_LATE | CAIRN_PRESENTER_CATCH_UP | CAIRN_PRESENTER_NO_DECODED | CAIRN_PRESENTER_LETTERBOX;
    if options.flags & !known != 0 {
        return refuse("flags", format!("{:#x} has an unknown bit", options.flags));
    }
    for (field, value) in [
        ("reserved", options.reserved),
        ("reserved_too", options.reserved_too),
        ("reserved_also", options.reserved_also),
    ] {
        if value != 0 {
            return refuse(field, "it must be 0".into());
        }
    }
    let capacity = match options.capacity {
        0 => 4,
        capacity @ 1..=super::rollout::CAIRN_MAX_QUEUE => capacity,
        other => return refuse("capacity", format!("{other} anchors cannot wait")),
    };
    let colours = colours(options.colour_space, options.white_nits)?;
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
        letterbox: options.flags & CAIRN_PRESENTER_LETTERBOX != 0,
        capacity: capacity as usize,
        motion: motion_source(options.motion, "options.motion")?,
    };
    let name = if generator.is_some() { "cpu" } else { "" };
    let mut presenter = Presenter::new(made, generator)?;
    if HAS_SHADERS && options.shader != CAIRN_PREFER_NEVER {
        presenter = presenter.with_phases(Phases::Any);
    }
    let preferences = [("fsr", options.fsr), ("shader", options.shader), ("upscaler", options.upscaler)];
    let required = preferences.into_iter().find(|(_, preference)| *preference == CAIRN_PREFER_REQUIRE);
    let (required, renderer) = (required.map(|(name, _)| name), behind::renderer(options, colours));
    Ok(Presenting { presenter, colours, required, generator: name, preference, renderer })
}

pub(super) fn to_header(shown: &FrameInfo) -> cairn_frame {
    let source = match shown.source {
        FrameSource::Anchor => CAIRN_FRAME_ANCHOR,
        FrameSource::Decoded => CAIRN_FRAME_DECODED,
        FrameSource::Generated => CAIRN_FRAME_GENERATED,
        FrameSource::Extrapolated => CAIRN_FRAME_EXTRAPOLATED,
        FrameSource::Held => CAIRN_FRAME_HELD,
    };
    let cut = if shown.cut { CAIRN_FRAME_CUT } else { 0 };
    let repeated = if shown.repeated { CAIRN_FRAME_REPEATED } else { 0 };
    let unprepared = if shown.unprepared { CAIRN_FRAME_UNPREPARED } else { 0 };
    cairn_frame {
        struct_size: 0,
        source,
        position: shown.due.position,
        since_ns: shown.due.since_ns,
        until_ns: shown.due.until_ns,
        previous: shown.previous,
        current: shown.current,
        t: shown.t,
        flags: cut | repeated | unprepared,
    }
}
