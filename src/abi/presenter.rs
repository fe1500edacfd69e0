//! Presenters: decide which frame is due, and make it.

use std::time::Duration;

use super::anchor::cairn_anchor;
use super::boundary::call;
use super::d3d12::backend::{self, HAS_SHADERS};
use super::d3d12::types::FrameStatistics;
use super::guidance::{cairn_guidance, motion_source};
use super::handles::{Handle, Kind, Object, destroy, enter, enter_serialized, insert_to};
use super::images::{Target, cairn_target};
use super::results::{
    AbiResult, CAIRN_ERROR_UNSUPPORTED, CAIRN_NOT_READY, CAIRN_OK, CAIRN_QUEUE_FULL, Failure, cairn_result,
};
use super::structs::{Out, check_flags, check_out, check_zero, describe, read_or_default, slice};
use crate::Colours;
use crate::allocate;
use crate::framegen::Phases;
use crate::present::Selection;
use crate::present::pacing::Interval;
use crate::present::presenter::{FrameInfo, FrameSource, Presenter, PresenterOptions};
use preferences::{colours, cpu_generator, renderer_options};

mod preferences;

/// Uses the generator if possible.
pub const CAIRN_PREFER_AUTO: u32 = 0;
/// Requires the generator: creating the presenter, or preparing its frames for Direct3D 12, fails if it cannot be used.
pub const CAIRN_PREFER_REQUIRE: u32 = 1;
/// Never uses the generator.
pub const CAIRN_PREFER_NEVER: u32 = 2;

/// A flag of cairn_presenter_options: holds the last anchor while the next one is late, instead of extrapolating its motion.
pub const CAIRN_PRESENTER_HOLD_LATE: u32 = 1;
/// A flag of cairn_presenter_options: after a late anchor, frames are shown earlier by a quarter of a frame's duration per anchor, until
/// anchors are due delay_ns after their arrival again. For hosts that make anchors at a steady pace instead of as fast as possible.
pub const CAIRN_PRESENTER_CATCH_UP: u32 = 2;
/// A flag of cairn_presenter_options: generates frames even if an anchor has as many decoded pictures as frames are shown per anchor.
/// Without it those pictures are shown instead.
pub const CAIRN_PRESENTER_NO_DECODED: u32 = 4;
/// A flag of cairn_presenter_options: anchors keep their aspect ratio in frames of another ratio, centred between black bars. Without it
/// they are stretched.
pub const CAIRN_PRESENTER_LETTERBOX: u32 = 8;

/// Display-referred sRGB, like pictures in memory.
pub const CAIRN_COLOUR_SRGB: u32 = 0;
/// Linear, sRGB primaries, 1 is white; only for CAIRN_FORMAT_RGBA16F and for textures of R11G11B10_FLOAT.
pub const CAIRN_COLOUR_LINEAR: u32 = 1;
/// scRGB: linear, sRGB primaries, 1 is 80 nits; only for CAIRN_FORMAT_RGBA16F.
pub const CAIRN_COLOUR_SCRGB: u32 = 2;
/// HDR10: PQ transfer function, BT.2020 primaries; only for CAIRN_FORMAT_RGB10A2.
pub const CAIRN_COLOUR_HDR10: u32 = 3;

/// The frame is an anchor.
pub const CAIRN_FRAME_ANCHOR: u32 = 1;
/// The frame is a decoded picture that came with the later anchor.
pub const CAIRN_FRAME_DECODED: u32 = 2;
/// The frame is interpolated between two anchors.
pub const CAIRN_FRAME_GENERATED: u32 = 3;
/// The frame is extrapolated from the last anchor, because the next one is late.
pub const CAIRN_FRAME_EXTRAPOLATED: u32 = 4;
/// The frame holds a picture, because nothing can be generated: between two anchors the nearer one, after an interval of extrapolation the
/// last anchor extrapolated by that interval, else the last anchor.
pub const CAIRN_FRAME_HELD: u32 = 5;

/// A flag of cairn_frame: the frame was not generated because of a cut.
pub const CAIRN_FRAME_CUT: u32 = 1;
/// A flag of cairn_frame: the frame is identical to the one drawn before.
pub const CAIRN_FRAME_REPEATED: u32 = 2;
/// A flag of cairn_frame: an anchor replaces the frame, because cairn_presenter_prepare_d3d12 was not called for it.
pub const CAIRN_FRAME_UNPREPARED: u32 = 4;

/// Shows a stream of anchors at a steady rate: takes anchors as they arrive, decides which frame is due, generates it and writes it into
/// the host's memory or into a texture. No clock decides what is shown: every time is the host's, in nanoseconds from any origin.
///
/// Anchor i is due at origin + i * interval; origin is the arrival of the first anchor plus the delay. Between two anchors that have
/// arrived, frames are generated. While the next anchor is late, the motion of the last one is extrapolated for at most an interval; then
/// the picture is held. An anchor that arrives after it was due is due on arrival, and all later ones are delayed by as much: a world
/// that is too slow is shown slowly, and no frame is skipped.
pub struct cairn_presenter(());

/// The object of a presenter's handle.
pub(super) struct PresenterObject {
    pub(super) presenter: Presenter,
    colours: Colours,
    /// The first of fsr, shader and upscaler that is required.
    required: Option<&'static str>,
    /// Name of the generator on the CPU; empty if it is not used.
    generator: &'static str,
    /// Why a preferred generator makes no frames in memory; empty if there is none.
    unused_reason: String,
    /// Makes frames for Direct3D 12.
    pub(super) renderer: backend::Renderer,
}

impl Handle for cairn_presenter {
    const KIND: Kind = Kind::Presenter;
    const NAME: &'static str = "cairn_presenter";
    type Object = PresenterObject;
}

impl Object for PresenterObject {}

impl PresenterObject {
    /// Statistics of frames for Direct3D 12; `None` if the call is nested in one that records.
    pub(super) fn frame_statistics(&self, is_nested: bool) -> Option<FrameStatistics> {
        backend::statistics(&self.renderer, &self.presenter, is_nested)
    }

    /// The upscaler of the last frame, and why AMD's was not used.
    pub(super) fn upscaler(&self, statistics: &FrameStatistics) -> Selection {
        statistics.upscaler.clone().unwrap_or_else(|| {
            let sizes = self.presenter.size().zip(self.presenter.anchor_size());
            let scales = sizes.is_some_and(|(size, anchor_size)| size != anchor_size);
            Selection { name: if scales { "spatial" } else { "" }.to_owned(), reason: String::new() }
        })
    }

    /// The generator of the last frame, and why a preferred one was not used.
    pub(super) fn generator(&self, statistics: &FrameStatistics) -> Selection {
        let used = statistics.generator.clone();
        let used = used.unwrap_or_else(|| Selection { name: String::new(), reason: self.unused_reason.clone() });
        if used.name.is_empty() { Selection { name: self.generator.to_owned(), ..used } } else { used }
    }
}

/// Options of a presenter. All zero: two frames per anchor, and anchors are due one interval after their arrival.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_presenter_options {
    /// sizeof(cairn_presenter_options)
    pub struct_size: u32,
    /// Frames per anchor: 1, 2, 3, 4 or 6; 0 for 2.
    pub multiplier: u32,
    /// Width of the frames in pixels, 1 to 16384; 0 in width and height for the anchors' size.
    pub width: u32,
    /// Height of the frames in pixels, 1 to 16384.
    pub height: u32,
    /// Nanoseconds from one anchor to the next, at most 60 seconds; 0 for the interval of the first anchor's latents_per_second.
    pub interval_ns: u64,
    /// Nanoseconds from an anchor's arrival until it is due, at most 60 seconds; 0 for one interval. Frames between two anchors need the
    /// later one: with a delay below (multiplier - 1) / multiplier of an interval some of them are
    /// extrapolated or held instead.
    pub delay_ns: u64,
    /// CAIRN_PRESENTER_HOLD_LATE, CAIRN_PRESENTER_CATCH_UP, CAIRN_PRESENTER_NO_DECODED and CAIRN_PRESENTER_LETTERBOX, or 0.
    pub flags: u32,
    /// Largest number of anchors that wait to become due, 1 to CAIRN_MAX_QUEUE; 0 for 4.
    pub capacity: u32,
    /// Source of motion for anchors that are pushed without guidance: CAIRN_MOTION_AUTO and so on.
    pub motion: u32,
    /// CAIRN_COLOUR_SRGB to CAIRN_COLOUR_HDR10
    pub colour_space: u32,
    /// AMD FidelityFX frame generation, for frames half way between two anchors that are made for Direct3D 12: CAIRN_PREFER_AUTO and
    /// so on. Needs the library's own shaders, which make all other frames.
    pub fsr: u32,
    /// The library's own shaders, for frames made for Direct3D 12: CAIRN_PREFER_AUTO and so on.
    pub shader: u32,
    /// The library's own generator on the processor: CAIRN_PREFER_AUTO and so on.
    pub cpu: u32,
    /// 0
    pub reserved: u32,
    /// Brightness of the pictures' white in CAIRN_COLOUR_SCRGB and CAIRN_COLOUR_HDR10, 1 to 10000 nits; 0 for 203. Must be 0 for the
    /// other colour spaces.
    pub white_nits: u32,
    /// 0
    pub reserved_too: u32,
    /// AMD FidelityFX upscaling, for frames for Direct3D 12 that are larger than anchors: CAIRN_PREFER_AUTO and so on. It upscales anchors
    /// before frames are generated between them. Without it each frame is resized by a spatial filter. Needs the library's own shaders.
    pub upscaler: u32,
    /// 0
    pub reserved_also: u32,
}
describe!(cairn_presenter_options, [64, 72], {
    struct_size, multiplier, width, height, interval_ns, delay_ns, flags, capacity, motion, colour_space, fsr, shader, cpu,
    reserved, white_nits, reserved_too, upscaler, reserved_also,
});

/// Information about a frame of a presenter.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_frame {
    /// sizeof(cairn_frame)
    pub struct_size: u32,
    /// How it is made: CAIRN_FRAME_ANCHOR to CAIRN_FRAME_HELD.
    pub source: u32,
    /// Position in the stream: anchor i, counted from 0 in order of arrival, is at i * multiplier. It may step back when a late anchor
    /// arrives.
    pub position: u64,
    /// When it is due. For the first anchor this may be in the future: it is shown from its arrival on.
    pub since_ns: u64,
    /// When the next frame is due, if no anchor is late.
    pub until_ns: u64,
    /// Number of the anchor that it shows or starts from.
    pub previous: u64,
    /// Number of the anchor that it leads to; the same as previous if it leads to none.
    pub current: u64,
    /// Time since the previous anchor in intervals, 0 to 1.
    pub t: f32,
    /// CAIRN_FRAME_CUT, CAIRN_FRAME_REPEATED and CAIRN_FRAME_UNPREPARED, or 0.
    pub flags: u32,
}
describe!(cairn_frame, [], { struct_size, source, position, since_ns, until_ns, previous, current, t, flags });

/// Creates a presenter.
///
/// options: may be null for the defaults.
///
/// Ownership: on success *presenter is the caller's, for cairn_presenter_destroy; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED for a required generator
/// that this build or system does not have; CAIRN_ERROR_OUT_OF_MEMORY.
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
        let made = create(&options)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_presenter>(made, presenter) }
    })
}

/// Pushes the next anchor. If its number is not one above the last, or it has CAIRN_ANCHOR_CUT, there is a cut before it: nothing is
/// generated between it and the anchor before. An anchor that a Direct3D 12 device still works on arrives once its fence is signalled.
/// The fence is checked whenever a frame is requested, and no queue waits for it; until then the anchor counts as late.
///
/// guidance: motion from this anchor back to the one before; null to have the presenter extract it.
/// now_ns: time of arrival on the host's clock.
///
/// Ownership: anchor and guidance stay the caller's; on success the presenter keeps a reference to their contents, on failure none.
/// Threads: any thread, at any time, also while a frame is drawn. A time before the latest one that was passed counts as the latest.
/// Results: CAIRN_OK; CAIRN_QUEUE_FULL if capacity anchors wait already; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for
/// another size than the first anchor's, and if neither the options nor the first anchor have an interval.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_push(
    presenter: *const cairn_presenter,
    anchor: *const cairn_anchor,
    guidance: *const cairn_guidance,
    now_ns: u64,
) -> cairn_result {
    call("cairn_presenter_push", || {
        let object = enter(presenter)?;
        let anchor = enter(anchor)?.share();
        let guidance = if guidance.is_null() { None } else { Some(enter(guidance)?.share()) };
        let is_accepted = object.presenter.push(anchor, guidance, now_ns)?;
        Ok(if is_accepted { CAIRN_OK } else { CAIRN_QUEUE_FULL })
    })
}

/// Returns which frame is due, without making it. Takes less than a microsecond.
///
/// now_ns: when it will be shown, on the host's clock.
///
/// Ownership: frame stays the caller's and is filled on success; on failure, and without a frame, it is not written.
/// Threads: any thread, at any time, also while a frame is drawn.
/// Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor has arrived; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT;
/// CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_query(
    presenter: *const cairn_presenter,
    now_ns: u64,
    frame: *mut cairn_frame,
) -> cairn_result {
    call("cairn_presenter_query", || {
        let object = enter(presenter)?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::new(frame, "frame") }?;
        let Some(info) = object.presenter.query(now_ns) else { return Ok(CAIRN_NOT_READY) };
        frame.write(&to_c_frame(&info));
        Ok(CAIRN_OK)
    })
}

/// Makes the frame that is due and writes it into memory. A frame that is still due at the next call is written again without being made
/// again. The generator may detect a cut that cairn_presenter_query does not know; frame tells what was drawn.
///
/// now_ns: when it will be shown, on the host's clock.
/// target: of the frames' size.
/// frame: may be null.
///
/// Ownership: on success the pixels are copied and frame is filled; on failure, and without a frame, neither is written.
/// Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
/// Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor has arrived; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also
/// if CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS is used with an anchor without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
/// CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_UNSUPPORTED if the options require a generator for Direct3D 12.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_draw(
    presenter: *mut cairn_presenter,
    now_ns: u64,
    target: *const cairn_target,
    frame: *mut cairn_frame,
) -> cairn_result {
    call("cairn_presenter_draw", || {
        let object = enter_serialized(presenter)?;
        // SAFETY: the host's promise about `frame`.
        let frame = unsafe { Out::optional(frame, "frame") }?;
        if let Some(name) = object.required {
            let cause = format!("options.{name} requires a generator on Direct3D 12, which makes no frames in memory");
            return Err(Failure::new(CAIRN_ERROR_UNSUPPORTED, cause)
                .remedy("Record frames for Direct3D 12, or do not require it"));
        }
        let Some(size) = object.presenter.size() else { return Ok(CAIRN_NOT_READY) };
        // SAFETY: the host's promise about `target`.
        let target = unsafe { Target::new(target, size, "target") }?.in_colours(object.colours)?;
        let info = object.presenter.draw(now_ns, size, |picture| target.write(picture))?;
        let Some(info) = info else { return Ok(CAIRN_NOT_READY) };
        frame.into_iter().for_each(|frame| frame.write(&to_c_frame(&info)));
        Ok(CAIRN_OK)
    })
}

/// Changes the size of the frames, for example with a window's. The stream continues; the next frame has the new size.
///
/// width, height: as in cairn_presenter_options; both 0 for the anchors' size.
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
        let object = enter(presenter)?;
        object.presenter.resize(((width, height) != (0, 0)).then_some((width, height)))?;
        Ok(CAIRN_OK)
    })
}

/// Sets the mask of a static overlay, such as a HUD, that covers the anchors and does not move with them, from the next frame on. Without a
/// mask, generators detect static pixels from colours that do not change. All generators use it. cairn_presenter_reset removes it.
///
/// mask: one byte per pixel of an anchor, row by row from the top left, 0 where there is no overlay; null, with all other arguments 0, to
/// remove the mask.
/// size: bytes of mask: width * height.
/// width, height: the anchors' size in pixels.
///
/// Ownership: on success the mask is copied; on failure it is not.
/// Threads: any thread, at any time, also while a frame is drawn.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for another size than that of the anchors that
/// were pushed; CAIRN_ERROR_OUT_OF_MEMORY.
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
        let object = enter(presenter)?;
        if mask.is_null() && (size, width, height) == (0, 0, 0) {
            object.presenter.set_overlay(None)?;
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
        object.presenter.set_overlay(Some(((width, height), allocate::copy_of(mask)?)))?;
        Ok(CAIRN_OK)
    })
}

/// Limits the device time of frames for Direct3D 12. If the budget is too small for all frames, only every second, third or sixth frame of
/// an interval is generated, depending on the multiplier, and the others repeat the previous one; if it suffices again, more are generated.
/// The choice depends on the device times of completed frames. Changes are logged and counted in the statistics.
///
/// frame_ns: nanoseconds of device time per shown frame, averaged over an interval and including the work done once per anchor; 0 for no
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

/// Discards all anchors and their times: the next anchor is a first one again and may have any size.
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
/// Ownership: on success presenter is no longer a handle; on failure it is unchanged.
/// Threads: any thread; waits for calls in flight on the presenter.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_destroy(presenter: *mut cairn_presenter) -> cairn_result {
    call("cairn_presenter_destroy", || destroy(presenter))
}

/// Creates a presenter and its renderer.
fn create(options: &cairn_presenter_options) -> AbiResult<PresenterObject> {
    let failure = |field: &str, cause: String| Failure::argument(&format!("options.{field}"), cause);
    let refuse = |field: &str, cause: String| Err(failure(field, cause));
    let multiplier = match options.multiplier {
        0 => 2,
        known @ (1 | 2 | 3 | 4 | 6) => known,
        other => {
            let cause = format!("there cannot be {other} frames to an anchor");
            return Err(failure("multiplier", cause).remedy("Use 1, 2, 3, 4 or 6"));
        }
    };
    let known =
        CAIRN_PRESENTER_HOLD_LATE | CAIRN_PRESENTER_CATCH_UP | CAIRN_PRESENTER_NO_DECODED | CAIRN_PRESENTER_LETTERBOX;
    check_flags(options.flags, known, "options.flags")?;
    check_zero(options.reserved, "options.reserved")?;
    check_zero(options.reserved_too, "options.reserved_too")?;
    check_zero(options.reserved_also, "options.reserved_also")?;
    let capacity = match options.capacity {
        0 => 4,
        capacity @ 1..=super::rollout::CAIRN_MAX_QUEUE => capacity,
        other => return refuse("capacity", format!("{other} anchors cannot wait")),
    };
    let colours = colours(options.colour_space, options.white_nits)?;
    let (generator, unused_reason) = cpu_generator(options)?;
    let interval = match options.interval_ns {
        0 => None,
        ns => Some(Interval::of_ns(ns)?),
    };
    let presenter_options = PresenterOptions {
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
    let mut presenter = Presenter::new(presenter_options, generator)?;
    if HAS_SHADERS && options.shader != CAIRN_PREFER_NEVER {
        presenter = presenter.with_phases(Phases::Any);
    }
    let preferences = [("fsr", options.fsr), ("shader", options.shader), ("upscaler", options.upscaler)];
    let required = preferences.into_iter().find(|(_, preference)| *preference == CAIRN_PREFER_REQUIRE);
    let required = required.map(|(name, _)| name);
    let renderer = backend::renderer(renderer_options(options, colours));
    Ok(PresenterObject { presenter, colours, required, generator: name, unused_reason, renderer })
}

/// A frame's information as the C interface has it.
pub(super) fn to_c_frame(info: &FrameInfo) -> cairn_frame {
    let source = match info.source {
        FrameSource::Anchor => CAIRN_FRAME_ANCHOR,
        FrameSource::Decoded => CAIRN_FRAME_DECODED,
        FrameSource::Generated => CAIRN_FRAME_GENERATED,
        FrameSource::Extrapolated => CAIRN_FRAME_EXTRAPOLATED,
        FrameSource::Held => CAIRN_FRAME_HELD,
    };
    let cut = if info.cut { CAIRN_FRAME_CUT } else { 0 };
    let repeated = if info.repeated { CAIRN_FRAME_REPEATED } else { 0 };
    let unprepared = if info.unprepared { CAIRN_FRAME_UNPREPARED } else { 0 };
    cairn_frame {
        struct_size: 0,
        source,
        position: info.due.position,
        since_ns: info.due.since_ns,
        until_ns: info.due.until_ns,
        previous: info.previous,
        current: info.current,
        t: info.t,
        flags: cut | repeated | unprepared,
    }
}
