//! What a host says of AMD's swap chain and what it is told: numbers and structs, and their ranges.

use super::super::d3d12::{ID3D12Resource, given};
use super::super::results::{Failure, Outcome};
use super::super::structs::{describe, read, read_or_default};

/// The provider that AMD's libraries and the driver prefer.
pub const CAIRN_FSR_ANY: u32 = 0;
/// The newest by a network, and where there is none the newest by rules.
pub const CAIRN_FSR_PREFER_ML: u32 = 1;
/// The newest by rules, and where there is none the newest by a network.
pub const CAIRN_FSR_PREFER_ANALYTIC: u32 = 2;
/// The newest by a network, or none at all.
pub const CAIRN_FSR_REQUIRE_ML: u32 = 3;
/// The newest by rules, or none at all.
pub const CAIRN_FSR_REQUIRE_ANALYTIC: u32 = 4;

/// A flag of cairn_swapchain_options: frames are generated on a compute queue of the swap chain's own, beside what the engine draws.
pub const CAIRN_SWAPCHAIN_ASYNC: u32 = 1;
/// A flag of cairn_swapchain_options: motion has the size of the buffers, and not the size rendered at.
pub const CAIRN_SWAPCHAIN_SHOWN_MOTION: u32 = 2;
/// A flag of cairn_swapchain_options: motion holds the camera's jitter.
pub const CAIRN_SWAPCHAIN_JITTERED_MOTION: u32 = 4;
/// A flag of cairn_swapchain_options: depth is 1 at the near plane.
pub const CAIRN_SWAPCHAIN_INVERTED_DEPTH: u32 = 8;
/// A flag of cairn_swapchain_options: the far plane is infinitely far away.
pub const CAIRN_SWAPCHAIN_INFINITE_DEPTH: u32 = 16;
/// A flag of cairn_swapchain_options: buffers are of high dynamic range, as SetColorSpace1 and SetHDRMetaData say.
pub const CAIRN_SWAPCHAIN_HDR: u32 = 32;
/// A flag of cairn_swapchain_options: AMD's provider looks at what it is given and logs what it finds.
pub const CAIRN_SWAPCHAIN_CHECKED: u32 = 64;
/// A flag of cairn_swapchain_options: the provider need not show first that it puts a picture of known motion where it belongs.
pub const CAIRN_SWAPCHAIN_UNTRIED: u32 = 128;

/// A flag of cairn_swapchain_frame: there is none before it, as after a cut. Nothing new is shown between it and the one before.
pub const CAIRN_SWAPCHAIN_RESET: u32 = 1;

/// A flag of cairn_swapchain_set_interface: its colours are multiplied by its alpha.
pub const CAIRN_INTERFACE_PREMULTIPLIED: u32 = 1;
/// A flag of cairn_swapchain_set_interface: it is copied within Present, so that the next one may be drawn at once.
pub const CAIRN_INTERFACE_COPIED: u32 = 2;

/// A flag of cairn_swapchain_pacing: waits by sleeping, and by spinning for the last spin_ticks; else by spinning alone.
pub const CAIRN_PACING_HYBRID_SPIN: u32 = 1;
/// A flag of cairn_swapchain_pacing: the system wakes a thread at a fence; else it spins.
pub const CAIRN_PACING_WAIT_ON_FENCE: u32 = 2;

/// How a swap chain of AMD's is made. All zero: by any provider that stands the test, with motion and depth of the buffers' size.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_options {
    /// sizeof(cairn_swapchain_options)
    pub struct_size: u32,
    /// CAIRN_SWAPCHAIN_ASYNC to CAIRN_SWAPCHAIN_UNTRIED
    pub flags: u32,
    /// CAIRN_FSR_ANY to CAIRN_FSR_REQUIRE_ANALYTIC
    pub provider: u32,
    /// A DXGI_FORMAT, of frames without interface; 0 for that of the buffers.
    pub hudless_format: u32,
    /// The largest size in pixels that motion and depth are rendered at; 0 both ways for that of the buffers, whatever it becomes.
    pub max_render_width: u32,
    /// See max_render_width.
    pub max_render_height: u32,
}
describe!(cairn_swapchain_options, [], { struct_size, flags, provider, hudless_format, max_render_width, max_render_height });

/// Motion and depth of a frame that an engine draws. Textures are of two dimensions with one level, slice and sample, each in its state, a
/// D3D12_RESOURCE_STATES, when the list runs, before and after; a null pointer for one that may be missing.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_frame {
    /// sizeof(cairn_swapchain_frame)
    pub struct_size: u32,
    /// CAIRN_SWAPCHAIN_RESET
    pub flags: u32,
    /// Device depth, of the size rendered at.
    pub depth: *mut ID3D12Resource,
    /// From this frame to the one before: halves or floats, of the size rendered at, or of the buffers' with CAIRN_SWAPCHAIN_SHOWN_MOTION.
    pub motion: *mut ID3D12Resource,
    /// The frame without interface, of the buffers' size and options.hudless_format; may be null. It is read within Present and must not be
    /// drawn to before that came back, with CAIRN_SWAPCHAIN_ASYNC not before the next one did.
    pub hudless: *mut ID3D12Resource,
    /// Where a lens puts each pixel less where it was, in parts of the picture, of the buffers' size; may be null, but not in a frame
    /// after one that had it.
    pub distortion: *mut ID3D12Resource,
    /// Of depth.
    pub depth_state: u32,
    /// Of motion.
    pub motion_state: u32,
    /// Of hudless.
    pub hudless_state: u32,
    /// Of distortion.
    pub distortion_state: u32,
    /// The size rendered at in pixels, at most that of the options.
    pub render_width: u32,
    /// See render_width.
    pub render_height: u32,
    /// What of the buffers is the world, in pixels: the rest is shown as it is. No size for all of it.
    pub world_left: u32,
    /// See world_left.
    pub world_top: u32,
    /// See world_left.
    pub world_width: u32,
    /// See world_left.
    pub world_height: u32,
    /// Of the camera, in pixels rendered.
    pub jitter_x: f32,
    /// See jitter_x.
    pub jitter_y: f32,
    /// What makes pixels of motion's own size of what it holds; 0 for 1.
    pub motion_scale_x: f32,
    /// See motion_scale_x.
    pub motion_scale_y: f32,
    /// Milliseconds of the world's time since the frame before, above 0.
    pub frame_time_ms: f32,
    /// Radians from the bottom of the picture to its top, inside (0, pi). 0 for a camera that nobody knows: at the origin, looking along
    /// z with y up, 1 radian, from 0.1 to 100 metres. What follows is not looked at then.
    pub vertical_fov: f32,
    /// Distance of the near plane, above 0.
    pub near_plane: f32,
    /// Distance of the far plane, above 0 and another; not looked at with CAIRN_SWAPCHAIN_INFINITE_DEPTH.
    pub far_plane: f32,
    /// Metres in a unit of the camera's, 0 for 1.
    pub metres: f32,
    /// Where the camera is in the world.
    pub position: [f32; 3],
    /// Up on the screen, in the world; of length 1, as the next two.
    pub up: [f32; 3],
    /// To the right on the screen.
    pub right: [f32; 3],
    /// Into the screen.
    pub forward: [f32; 3],
    /// 0
    pub reserved: u32,
}
describe!(cairn_swapchain_frame, [], {
    struct_size, flags, depth, motion, hudless, distortion, depth_state, motion_state, hudless_state, distortion_state,
    render_width, render_height, world_left, world_top, world_width, world_height, jitter_x, jitter_y, motion_scale_x,
    motion_scale_y, frame_time_ms, vertical_fov, near_plane, far_plane, metres, position, up, right, forward, reserved,
});

/// How presents are spread over time.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_pacing {
    /// sizeof(cairn_swapchain_pacing)
    pub struct_size: u32,
    /// CAIRN_PACING_HYBRID_SPIN, CAIRN_PACING_WAIT_ON_FENCE
    pub flags: u32,
    /// Milliseconds that are taken off the time from one present to the next, 0 or more; AMD's own is 0.1.
    pub safety_margin_ms: f32,
    /// How much of the variance of frame times is taken off besides, from 0 to 1; AMD's own is 0.1.
    pub variance_factor: f32,
    /// Ticks of the system's timer that CAIRN_PACING_HYBRID_SPIN spins for; AMD's own is 2.
    pub spin_ticks: u32,
}
describe!(cairn_swapchain_pacing, [], { struct_size, flags, safety_margin_ms, variance_factor, spin_ticks });

/// What a swap chain of AMD's has done and keeps.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_statistics {
    /// sizeof(cairn_swapchain_statistics)
    pub struct_size: u32,
    /// What AMD's generator answered last within Present where it failed, a code of ffx-api's; 0 where it never has. Where it fails
    /// frames are presented without one between.
    pub failed: u32,
    /// Frames generated.
    pub generated: u64,
    /// Bytes that the generator keeps on the device as it reports them; 0 where it cannot say.
    pub generator_bytes: u64,
    /// The part of them that may lie over other memory.
    pub generator_aliasable_bytes: u64,
    /// Bytes that the swap chain itself keeps; 0 where it cannot say.
    pub swapchain_bytes: u64,
    /// The part of them that may lie over other memory.
    pub swapchain_aliasable_bytes: u64,
    /// Who generates frames, such as "3.1.6 (analytic)"; empty after cairn_swapchain_fit has failed. UTF-8.
    pub generator: [std::ffi::c_char; 64],
    /// Who presents them. UTF-8.
    pub pacer: [std::ffi::c_char; 64],
}
describe!(cairn_swapchain_statistics, [], {
    struct_size, failed, generated, generator_bytes, generator_aliasable_bytes, swapchain_bytes, swapchain_aliasable_bytes,
    generator, pacer,
});

pub(super) fn check_flags(flags: u32, known: u32, name: &str) -> Outcome<()> {
    if flags & !known == 0 {
        return Ok(());
    }
    Err(Failure::argument(name, format!("{flags:#x} has an unknown bit")))
}

/// Options of a host's that are within their ranges.
///
/// # Safety
/// `options` is null or points to as many readable bytes as its first four say.
pub(super) unsafe fn checked_options(options: *const cairn_swapchain_options) -> Outcome<cairn_swapchain_options> {
    // SAFETY: the caller's promise.
    let options = unsafe { read_or_default(options, "options") }?;
    let all = CAIRN_SWAPCHAIN_ASYNC
        | CAIRN_SWAPCHAIN_SHOWN_MOTION
        | CAIRN_SWAPCHAIN_JITTERED_MOTION
        | CAIRN_SWAPCHAIN_INVERTED_DEPTH
        | CAIRN_SWAPCHAIN_INFINITE_DEPTH
        | CAIRN_SWAPCHAIN_HDR
        | CAIRN_SWAPCHAIN_CHECKED
        | CAIRN_SWAPCHAIN_UNTRIED;
    check_flags(options.flags, all, "options.flags")?;
    if options.provider > CAIRN_FSR_REQUIRE_ANALYTIC {
        return Err(Failure::argument("options.provider", format!("{} names no provider", options.provider)));
    }
    let (width, height) = (options.max_render_width, options.max_render_height);
    if (width == 0) != (height == 0) || width > LARGEST || height > LARGEST {
        let field =
            if width > LARGEST || width == 0 { "options.max_render_width" } else { "options.max_render_height" };
        return Err(Failure::argument(field, format!("{width} x {height} is no size")));
    }
    Ok(options)
}

/// The largest side of a texture.
const LARGEST: u32 = 16_384;

/// Refuses what is no frame, whatever it is a frame of.
pub(super) fn check_frame(frame: &cairn_swapchain_frame) -> Outcome<()> {
    check_flags(frame.flags, CAIRN_SWAPCHAIN_RESET, "frame.flags")?;
    if frame.reserved != 0 {
        return Err(Failure::argument("frame.reserved", "it must be 0"));
    }
    given(frame.depth, "frame.depth")?;
    given(frame.motion, "frame.motion")?;
    for (side, field) in [(frame.render_width, "render_width"), (frame.render_height, "render_height")] {
        if !(1..=LARGEST).contains(&side) {
            return Err(Failure::argument(&format!("frame.{field}"), format!("{side} pixels are no size")));
        }
    }
    let [position, up, right, forward] = [frame.position, frame.up, frame.right, frame.forward];
    let numbers = [
        ("jitter_x", &[frame.jitter_x][..]),
        ("jitter_y", &[frame.jitter_y]),
        ("motion_scale_x", &[frame.motion_scale_x]),
        ("motion_scale_y", &[frame.motion_scale_y]),
        ("frame_time_ms", &[frame.frame_time_ms]),
        ("vertical_fov", &[frame.vertical_fov]),
        ("near_plane", &[frame.near_plane]),
        ("far_plane", &[frame.far_plane]),
        ("metres", &[frame.metres]),
        ("position", &position),
        ("up", &up),
        ("right", &right),
        ("forward", &forward),
    ];
    match numbers.into_iter().find(|(_, numbers)| !numbers.iter().all(|number| number.is_finite())) {
        Some((field, _)) => Err(Failure::argument(&format!("frame.{field}"), "it must be finite")),
        None => Ok(()),
    }
}

/// Pacing of a host's that is within its ranges; none for AMD's own.
///
/// # Safety
/// `pacing` is null or points to as many readable bytes as its first four say.
pub(super) unsafe fn checked_pacing(pacing: *const cairn_swapchain_pacing) -> Outcome<Option<cairn_swapchain_pacing>> {
    if pacing.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's promise.
    let pacing = unsafe { read(pacing, "pacing") }?;
    check_flags(pacing.flags, CAIRN_PACING_HYBRID_SPIN | CAIRN_PACING_WAIT_ON_FENCE, "pacing.flags")?;
    if !(pacing.safety_margin_ms.is_finite() && pacing.safety_margin_ms >= 0.0) {
        return Err(Failure::argument("pacing.safety_margin_ms", "it must be 0 or more"));
    }
    if !(0.0..=1.0).contains(&pacing.variance_factor) {
        return Err(Failure::argument("pacing.variance_factor", "it must be from 0 to 1"));
    }
    Ok(Some(pacing))
}
