//! Constants and structs of the swap chain interface, and checks of their ranges.

use super::super::d3d12::{ID3D12Resource, check_not_null};
use super::super::results::{AbiResult, Failure};
use super::super::structs::{check_flags, check_zero, describe, read, read_or_default};
use crate::MAX_SIDE;

/// The provider that AMD's libraries and the driver prefer.
pub const CAIRN_FSR_ANY: u32 = 0;
/// The newest machine-learning provider, or else the newest analytic one.
pub const CAIRN_FSR_PREFER_ML: u32 = 1;
/// The newest analytic provider, or else the newest machine-learning one.
pub const CAIRN_FSR_PREFER_ANALYTIC: u32 = 2;
/// The newest machine-learning provider; fails if there is none.
pub const CAIRN_FSR_REQUIRE_ML: u32 = 3;
/// The newest analytic provider; fails if there is none.
pub const CAIRN_FSR_REQUIRE_ANALYTIC: u32 = 4;

/// A flag of cairn_swapchain_options: frames are generated on a compute queue of the swap chain's own, in parallel with the engine's work.
pub const CAIRN_SWAPCHAIN_ASYNC: u32 = 1;
/// A flag of cairn_swapchain_options: the motion texture has the buffers' size instead of the render size.
pub const CAIRN_SWAPCHAIN_SHOWN_MOTION: u32 = 2;
/// A flag of cairn_swapchain_options: motion vectors include the camera's jitter.
pub const CAIRN_SWAPCHAIN_JITTERED_MOTION: u32 = 4;
/// A flag of cairn_swapchain_options: depth is 1 at the near plane.
pub const CAIRN_SWAPCHAIN_INVERTED_DEPTH: u32 = 8;
/// A flag of cairn_swapchain_options: the far plane is infinitely far away.
pub const CAIRN_SWAPCHAIN_INFINITE_DEPTH: u32 = 16;
/// A flag of cairn_swapchain_options: buffers have high dynamic range, as set by SetColorSpace1 and SetHDRMetaData.
pub const CAIRN_SWAPCHAIN_HDR: u32 = 32;
/// A flag of cairn_swapchain_options: AMD's provider checks its inputs and logs errors in them.
pub const CAIRN_SWAPCHAIN_CHECKED: u32 = 64;
/// A flag of cairn_swapchain_options: skips the self-test, in which a provider must move a picture of known motion to the right position.
pub const CAIRN_SWAPCHAIN_UNTRIED: u32 = 128;

/// A flag of cairn_swapchain_frame: the frame has no predecessor, as after a cut. No frame is generated between it and the previous one.
pub const CAIRN_SWAPCHAIN_RESET: u32 = 1;

/// A flag of cairn_swapchain_set_interface: colours are premultiplied by alpha.
pub const CAIRN_INTERFACE_PREMULTIPLIED: u32 = 1;
/// A flag of cairn_swapchain_set_interface: the picture is copied within Present, and may be drawn to again when Present returns. AMD's
/// swap chain then forgets it; cairn_swapchain_prepare sets it again. Without that call, set it before each Present.
pub const CAIRN_INTERFACE_COPIED: u32 = 2;

/// A flag of cairn_swapchain_pacing: waits by sleeping, and by spinning for the last spin_ticks; without it, by spinning alone.
pub const CAIRN_PACING_HYBRID_SPIN: u32 = 1;
/// A flag of cairn_swapchain_pacing: a thread sleeps until the fence is signalled; without it, the thread spins.
pub const CAIRN_PACING_WAIT_ON_FENCE: u32 = 2;

/// Options of AMD's swap chain. All zero: any provider that passes the self-test, with motion and depth of the buffers' size.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_options {
    /// sizeof(cairn_swapchain_options)
    pub struct_size: u32,
    /// CAIRN_SWAPCHAIN_ASYNC to CAIRN_SWAPCHAIN_UNTRIED
    pub flags: u32,
    /// CAIRN_FSR_ANY to CAIRN_FSR_REQUIRE_ANALYTIC
    pub provider: u32,
    /// DXGI_FORMAT of frames without user interface; 0 for that of the buffers.
    pub hudless_format: u32,
    /// Largest width in pixels of motion and depth; 0 in both fields for the buffers' size, also after they are resized.
    pub max_render_width: u32,
    /// See max_render_width.
    pub max_render_height: u32,
}
describe!(cairn_swapchain_options, [], { struct_size, flags, provider, hudless_format, max_render_width, max_render_height });

/// Motion and depth of a frame that the engine draws. Textures are two-dimensional with one level, slice and sample. Each must be in the
/// given D3D12_RESOURCE_STATES before the list runs, and is in it afterwards.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_frame {
    /// sizeof(cairn_swapchain_frame)
    pub struct_size: u32,
    /// CAIRN_SWAPCHAIN_RESET
    pub flags: u32,
    /// Device depth, of the render size.
    pub depth: *mut ID3D12Resource,
    /// Motion from this frame to the previous one in half or single floats, of the render size, or of the buffers' with CAIRN_SWAPCHAIN_SHOWN_MOTION.
    pub motion: *mut ID3D12Resource,
    /// The frame without user interface, of the buffers' size and options.hudless_format; may be null if that is the buffers' own format. It
    /// is read within Present and must not be drawn to until Present returns, with CAIRN_SWAPCHAIN_ASYNC until the next Present returns.
    pub hudless: *mut ID3D12Resource,
    /// Lens distortion: each pixel's position after the lens minus its position before, as a fraction of the picture, of the buffers' size. May
    /// be null. It is read within Present, as hudless is.
    pub distortion: *mut ID3D12Resource,
    /// State of depth.
    pub depth_state: u32,
    /// State of motion.
    pub motion_state: u32,
    /// State of hudless; with CAIRN_SWAPCHAIN_ASYNC one that a compute queue knows.
    pub hudless_state: u32,
    /// State of distortion, as hudless_state.
    pub distortion_state: u32,
    /// Render size in pixels, at most that of the options.
    pub render_width: u32,
    /// See render_width.
    pub render_height: u32,
    /// The rectangle of the buffers that shows the world, in pixels; the rest is shown unchanged. Depth and motion cover this rectangle and
    /// nothing else: the render size is mapped onto it. Size 0 for all of it.
    pub world_left: u32,
    /// See world_left.
    pub world_top: u32,
    /// See world_left.
    pub world_width: u32,
    /// See world_left.
    pub world_height: u32,
    /// Camera jitter in render pixels.
    pub jitter_x: f32,
    /// See jitter_x.
    pub jitter_y: f32,
    /// Factor from motion values to pixels of the motion texture's size; 0 for 1.
    pub motion_scale_x: f32,
    /// See motion_scale_x.
    pub motion_scale_y: f32,
    /// Milliseconds of world time since the previous frame, above 0.
    pub frame_time_ms: f32,
    /// Vertical field of view in radians, inside (0, pi). 0 for an unknown camera: at the origin, looking along z with y up, 1 radian, from
    /// 0.1 to 100 metres. The fields below are then ignored.
    pub vertical_fov: f32,
    /// Distance of the near plane, above 0.
    pub near_plane: f32,
    /// Distance of the far plane, above 0 and different from near; ignored with CAIRN_SWAPCHAIN_INFINITE_DEPTH.
    pub far_plane: f32,
    /// Metres per world unit; 0 for 1.
    pub metres: f32,
    /// Camera position in the world.
    pub position: [f32; 3],
    /// Camera's up direction in the world; a unit vector, as the next two.
    pub up: [f32; 3],
    /// Camera's right direction.
    pub right: [f32; 3],
    /// Camera's forward direction.
    pub forward: [f32; 3],
    /// 0
    pub reserved: u32,
}
describe!(cairn_swapchain_frame, [], {
    struct_size, flags, depth, motion, hudless, distortion, depth_state, motion_state, hudless_state, distortion_state,
    render_width, render_height, world_left, world_top, world_width, world_height, jitter_x, jitter_y, motion_scale_x,
    motion_scale_y, frame_time_ms, vertical_fov, near_plane, far_plane, metres, position, up, right, forward, reserved,
});

/// Pacing of presents.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_pacing {
    /// sizeof(cairn_swapchain_pacing)
    pub struct_size: u32,
    /// CAIRN_PACING_HYBRID_SPIN, CAIRN_PACING_WAIT_ON_FENCE
    pub flags: u32,
    /// Safety margin in milliseconds, subtracted from the time between presents, 0 or more; AMD's default is 0.1.
    pub safety_margin_ms: f32,
    /// Fraction of the frame times' variance subtracted as well, from 0 to 1; AMD's default is 0.1.
    pub variance_factor: f32,
    /// Ticks of the system's timer that CAIRN_PACING_HYBRID_SPIN spins for; AMD's default is 2.
    pub spin_ticks: u32,
}
describe!(cairn_swapchain_pacing, [], { struct_size, flags, safety_margin_ms, variance_factor, spin_ticks });

/// Statistics of AMD's swap chain.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_swapchain_statistics {
    /// sizeof(cairn_swapchain_statistics)
    pub struct_size: u32,
    /// Last error code of AMD's generator within Present, one of ffx-api's; 0 if it never failed.
    pub failed: u32,
    /// Frames generated.
    pub generated: u64,
    /// Bytes of device memory that the generator reports; 0 if unknown.
    pub generator_bytes: u64,
    /// The part of them that may alias other memory.
    pub generator_aliasable_bytes: u64,
    /// Bytes of device memory of the swap chain itself; 0 if unknown.
    pub swapchain_bytes: u64,
    /// The part of them that may alias other memory.
    pub swapchain_aliasable_bytes: u64,
    /// Provider that generates frames, such as "3.1.6 (analytic)"; empty if cairn_swapchain_fit could not create one. UTF-8.
    pub generator: [std::ffi::c_char; 64],
    /// Provider of the swap chain, which presents frames. UTF-8.
    pub pacer: [std::ffi::c_char; 64],
    /// Frames that were presented twice because no frame was generated before them: they were not prepared, or the generation failed.
    pub repeated: u64,
}
describe!(cairn_swapchain_statistics, [176], {
    struct_size, failed, generated, generator_bytes, generator_aliasable_bytes, swapchain_bytes, swapchain_aliasable_bytes,
    generator, pacer, repeated,
});

/// Reads a host's options and checks their ranges.
///
/// # Safety
/// `options` is null or points to as many readable bytes as its first four say.
pub(super) unsafe fn checked_options(options: *const cairn_swapchain_options) -> AbiResult<cairn_swapchain_options> {
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
    if (width == 0) != (height == 0) || width > MAX_SIDE || height > MAX_SIDE {
        let field =
            if width > MAX_SIDE || width == 0 { "options.max_render_width" } else { "options.max_render_height" };
        return Err(Failure::argument(field, format!("{width} x {height} is no size")));
    }
    Ok(options)
}

/// Checks what does not depend on the swap chain: flags, required textures, the render size, and that all numbers are finite.
pub(super) fn check_frame(frame: &cairn_swapchain_frame) -> AbiResult<()> {
    check_flags(frame.flags, CAIRN_SWAPCHAIN_RESET, "frame.flags")?;
    check_zero(frame.reserved, "frame.reserved")?;
    check_not_null(frame.depth, "frame.depth")?;
    check_not_null(frame.motion, "frame.motion")?;
    for (side, field) in [(frame.render_width, "render_width"), (frame.render_height, "render_height")] {
        if !(1..=MAX_SIDE).contains(&side) {
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

/// Reads a host's pacing and checks its ranges; `None` for AMD's defaults.
///
/// # Safety
/// `pacing` is null or points to as many readable bytes as its first four say.
pub(super) unsafe fn checked_pacing(
    pacing: *const cairn_swapchain_pacing,
) -> AbiResult<Option<cairn_swapchain_pacing>> {
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
