//! Motion and depth of a pair of anchors.

use half::f16;

use super::anchor::cairn_anchor;
use super::boundary::call;
use super::handles::{Handle, Kind, Object, destroy, enter, insert_to};
use super::results::{AbiResult, CAIRN_OK, Failure, cairn_result};
use super::structs::{Out, check_flags, check_out, check_zero, describe, read, slice, slice_mut};
use crate::allocate;
use crate::guidance::{DepthEncoding, DepthMap, Guidance, MotionField, MotionOrigin, Projection, paper, picture_flow};
use crate::present::presenter::extract;
use crate::world::GuidanceSource;

/// Motion from the source with the best scores (docs/motion.md); today CAIRN_MOTION_PICTURES.
pub const CAIRN_MOTION_AUTO: u32 = 0;
/// Motion from the two pictures: dense optical flow.
pub const CAIRN_MOTION_PICTURES: u32 = 1;
/// Motion from the two latents, by the paper's method. Only anchors of a world have latents.
pub const CAIRN_MOTION_PAPER: u32 = 2;
/// Motion from block matching of the two latents. Only anchors of a world have latents.
pub const CAIRN_MOTION_LATENTS: u32 = 3;

/// A flag of cairn_guidance_data: depth is 1 near and 0 far.
pub const CAIRN_DEPTH_INVERTED: u32 = 1;
/// A flag of cairn_guidance_data: depth is the distance along the view axis, in the units of near_plane.
pub const CAIRN_DEPTH_LINEAR: u32 = 2;

/// Motion and depth of a pair of anchors, both of the anchors' size. Immutable.
///
/// Motion is in pixels, a half float each for x and y, stored at the current anchor's pixel and pointing from the current anchor to
/// the previous one, y down. Depth is device depth of the current anchor, 0 near and 1 far.
pub struct cairn_guidance(());

impl Handle for cairn_guidance {
    const KIND: Kind = Kind::Guidance;
    const NAME: &'static str = "cairn_guidance";
    type Object = Guidance;
}

impl Object for Guidance {}

/// Motion and depth from the host, in its memory.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_guidance_data {
    /// sizeof(cairn_guidance_data)
    pub struct_size: u32,
    /// CAIRN_DEPTH_INVERTED, CAIRN_DEPTH_LINEAR, or 0 for device depth with 0 near
    pub flags: u32,
    /// Size in pixels, 1 to 16384; must be the anchors'.
    pub width: u32,
    /// See width.
    pub height: u32,
    /// Half floats x, y for each pixel, row by row without padding, with the meaning they have in cairn_guidance. Non-finite values
    /// count as 0.
    pub motion: *const u16,
    /// Number of half floats: width * height * 2.
    pub motion_count: u64,
    /// One value for each pixel, row by row without padding; null for no depth.
    pub depth: *const f32,
    /// Number of values: width * height, or 0.
    pub depth_count: u64,
    /// Distance of the near plane, above 0; 0 in near_plane, far_plane and vertical_fov for 0.1, 100 and 60 degrees.
    pub near_plane: f32,
    /// Distance of the far plane, above near_plane; may be infinite.
    pub far_plane: f32,
    /// Vertical field of view in radians, inside (0, pi).
    pub vertical_fov: f32,
    /// 0
    pub reserved: u32,
}
describe!(cairn_guidance_data, [], {
    struct_size, flags, width, height, motion, motion_count, depth, depth_count, near_plane, far_plane, vertical_fov,
    reserved,
});

/// Properties of guidance.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_guidance_info {
    /// sizeof(cairn_guidance_info)
    pub struct_size: u32,
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Distance of the near plane.
    pub near_plane: f32,
    /// Distance of the far plane; may be infinite.
    pub far_plane: f32,
    /// Vertical field of view in radians.
    pub vertical_fov: f32,
}
describe!(cairn_guidance_info, [], { struct_size, width, height, near_plane, far_plane, vertical_fov });

/// Finds motion and depth of a pair of anchors. Takes milliseconds, on the calling thread. A presenter does this itself when a frame first
/// needs it; call this to do it off the render thread, or to inspect the result.
///
/// source: CAIRN_MOTION_AUTO, CAIRN_MOTION_PICTURES, CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS.
///
/// Ownership: on success *guidance is the caller's, for cairn_guidance_destroy; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for anchors of different sizes and for missing
/// latents; CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_guidance_create(
    previous: *const cairn_anchor,
    current: *const cairn_anchor,
    source: u32,
    guidance: *mut *mut cairn_guidance,
) -> cairn_result {
    call("cairn_guidance_create", || {
        let (previous, current) = (enter(previous)?, enter(current)?);
        check_out(guidance, "guidance")?;
        let made = extract(motion_source(source, "source")?, &previous, &current)?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_guidance>(made, guidance) }
    })
}

/// Makes guidance from the host's own motion and depth, such as an engine's.
///
/// Ownership: on success *guidance is the caller's, for cairn_guidance_destroy; on failure it is not written. What data points
/// to is copied.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_guidance_create_from_host(
    data: *const cairn_guidance_data,
    guidance: *mut *mut cairn_guidance,
) -> cairn_result {
    call("cairn_guidance_create_from_host", || {
        check_out(guidance, "guidance")?;
        // SAFETY: the host's promise about `data`.
        let data = unsafe { read(data, "data") }?;
        // SAFETY: the host's promise about what data points to.
        let made = unsafe { from_host(&data) }?;
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_guidance>(made, guidance) }
    })
}

/// Gives the properties of guidance.
///
/// Ownership: info stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_guidance_get_info(
    guidance: *const cairn_guidance,
    info: *mut cairn_guidance_info,
) -> cairn_result {
    call("cairn_guidance_get_info", || {
        let guidance = enter(guidance)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::new(info, "info") }?;
        let ((width, height), camera) = (guidance.size(), guidance.depth().projection());
        info.write(&cairn_guidance_info {
            struct_size: 0,
            width,
            height,
            near_plane: camera.near(),
            far_plane: camera.far(),
            vertical_fov: camera.vertical_fov(),
        });
        Ok(CAIRN_OK)
    })
}

/// Copies the motion: half floats x, y for each pixel, row by row.
///
/// count: size of the array in half floats; must be width * height * 2.
///
/// Ownership: the numbers are copied, on success; on failure none is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_guidance_read_motion(
    guidance: *const cairn_guidance,
    values: *mut u16,
    count: usize,
) -> cairn_result {
    call("cairn_guidance_read_motion", || {
        let guidance = enter(guidance)?;
        let (width, height) = guidance.size();
        check_count(count, width as usize * height as usize * 2, "count")?;
        // SAFETY: the host's promise about `values`.
        let values = unsafe { slice_mut(values, count, "values") }?;
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        for (to, (x, y)) in values.as_chunks_mut::<2>().0.iter_mut().zip(pixels) {
            *to = guidance.motion().at(x, y).map(f16::to_bits);
        }
        Ok(CAIRN_OK)
    })
}

/// Copies the depth: device depth for each pixel, 0 near, row by row.
///
/// count: size of the array in numbers; must be width * height.
///
/// Ownership: the numbers are copied, on success; on failure none is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_guidance_read_depth(
    guidance: *const cairn_guidance,
    values: *mut f32,
    count: usize,
) -> cairn_result {
    call("cairn_guidance_read_depth", || {
        let guidance = enter(guidance)?;
        let depth = guidance.depth();
        let (width, tile) = (depth.width() as usize, depth.tile() as usize);
        check_count(count, width * depth.height() as usize, "count")?;
        // SAFETY: the host's promise about `values`.
        let values = unsafe { slice_mut(values, count, "values") }?;
        for (y, row) in values.chunks_exact_mut(width).enumerate() {
            let tiles = &depth.depth()[y / tile * depth.columns() as usize..];
            row.chunks_mut(tile).zip(tiles).for_each(|(to, depth)| to.fill(*depth));
        }
        Ok(CAIRN_OK)
    })
}

/// Destroys the handle of guidance; null is allowed. Presenters that were given it keep what they need.
///
/// Ownership: on success guidance is no longer a handle; on failure it is unchanged.
/// Threads: any thread; waits for calls in flight on the guidance.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_guidance_destroy(guidance: *mut cairn_guidance) -> cairn_result {
    call("cairn_guidance_destroy", || destroy(guidance))
}

/// The source of motion of the header's number.
pub(super) fn motion_source(number: u32, name: &str) -> AbiResult<GuidanceSource> {
    match number {
        CAIRN_MOTION_AUTO => Ok(GuidanceSource::BEST),
        CAIRN_MOTION_PICTURES => Ok(GuidanceSource::PictureFlow),
        CAIRN_MOTION_PAPER => Ok(GuidanceSource::Paper),
        CAIRN_MOTION_LATENTS => Ok(GuidanceSource::LatentFlow),
        other => Err(Failure::argument(name, format!("{other} is no source of motion"))),
    }
}

fn check_count(count: usize, needed: usize, name: &str) -> AbiResult<()> {
    if count == needed {
        return Ok(());
    }
    Err(Failure::argument(name, format!("{count} numbers where there are {needed}")))
}

/// Makes guidance from a host's arrays; without depth, every pixel gets the same.
///
/// # Safety
/// The arrays can be read as `data` says.
unsafe fn from_host(data: &cairn_guidance_data) -> AbiResult<Guidance> {
    check_flags(data.flags, CAIRN_DEPTH_INVERTED | CAIRN_DEPTH_LINEAR, "data.flags")?;
    check_zero(data.reserved, "data.reserved")?;
    // Check the array's length before allocating memory for the stated size.
    let pixels = u64::from(data.width) * u64::from(data.height);
    if u128::from(data.motion_count) != u128::from(pixels) * 2 {
        let why = format!("{} numbers, {} x {} pixels have {} each", data.motion_count, data.width, data.height, 2);
        return Err(Failure::argument("data.motion_count", why));
    }
    let projection = match [data.near_plane, data.far_plane, data.vertical_fov] {
        [0.0, 0.0, 0.0] => paper::PROJECTION,
        [near, far, fov] => Projection::new(near, far, fov)?,
    };
    let mut motion = MotionField::new(data.width, data.height)?;
    // SAFETY: the caller's promise.
    let vectors = unsafe { slice(data.motion, data.motion_count as usize, "data.motion") }?;
    for (to, from) in motion.vectors_mut().iter_mut().zip(vectors.as_chunks::<2>().0) {
        // A non-finite vector points to no pixel.
        *to = from.map(f16::from_bits).map(|v| if v.is_finite() { v } else { f16::ZERO });
    }
    let mut values = Vec::new();
    let count = pixels as usize;
    allocate::reserve(&mut values, count)?;
    if data.depth.is_null() && data.depth_count == 0 {
        values.resize(count, picture_flow::FLAT_DEPTH);
        let flat = DepthMap::from_host(data.width, data.height, values, DepthEncoding::default(), projection)?;
        return Ok(Guidance::from_parts(motion, flat, MotionOrigin::Geometry)?);
    }
    if data.depth_count != pixels {
        let why = format!("{} numbers, {} x {} pixels have one each", data.depth_count, data.width, data.height);
        return Err(Failure::argument("data.depth_count", why));
    }
    // SAFETY: the caller's promise.
    values.extend_from_slice(unsafe { slice(data.depth, count, "data.depth") }?);
    let encoding = DepthEncoding {
        inverted: data.flags & CAIRN_DEPTH_INVERTED != 0,
        linear: data.flags & CAIRN_DEPTH_LINEAR != 0,
    };
    let depth = DepthMap::from_host(data.width, data.height, values, encoding, projection)?;
    Ok(Guidance::from_parts(motion, depth, MotionOrigin::Geometry)?)
}
