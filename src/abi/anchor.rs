//! Anchors: the pictures between which frames are generated, each with its latent and its time.

use super::boundary::call;
use super::handles::{Handle, Kind, Object, destroy, enter, insert_to};
use super::images::{Target, cairn_picture, cairn_target, read_picture};
use super::results::{AbiResult, CAIRN_OK, Failure, cairn_result};
use super::structs::{Out, check_flags, check_out, describe, slice_mut};
use crate::world::KeptAnchor;
use crate::{Error, ErrorKind};

/// A flag of cairn_anchor_info: the anchor does not continue the previous one, so nothing may be generated between them. It is the first
/// of a rollout, after a reset or a restored state, or a picture that was appended.
pub const CAIRN_ANCHOR_CUT: u32 = 1;

/// An anchor: an immutable copy, independent of its rollout.
pub struct cairn_anchor(());

impl Handle for cairn_anchor {
    const KIND: Kind = Kind::Anchor;
    const NAME: &'static str = "cairn_anchor";
    type Object = KeptAnchor;
}

impl Object for KeptAnchor {}

/// Properties of an anchor.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_anchor_info {
    /// sizeof(cairn_anchor_info)
    pub struct_size: u32,
    /// CAIRN_ANCHOR_CUT, or 0
    pub flags: u32,
    /// Number of its latent in the rollout, from 0. Its world time is latent / latents_per_second seconds.
    pub latent: u64,
    /// Latents per second of world time; 0 for a host's own picture.
    pub latents_per_second: u32,
    /// Number of its pictures, in order of time; the last is the anchor itself.
    pub pictures: u32,
    /// Size of its pictures, in square pixels.
    pub width: u32,
    /// See width.
    pub height: u32,
    /// Shape of its latent, [channels, height, width]; all 0 if it has none.
    pub latent_channels: u32,
    /// See latent_channels.
    pub latent_height: u32,
    /// See latent_channels.
    pub latent_width: u32,
    /// 0
    pub reserved: u32,
}
describe!(cairn_anchor_info, [], {
    struct_size, flags, latent, latents_per_second, pictures, width, height, latent_channels, latent_height, latent_width,
    reserved,
});

/// Makes an anchor from a picture of the host's own, for frame generation without a world.
///
/// number: increases by one from anchor to anchor.
/// flags: CAIRN_ANCHOR_CUT if it does not continue the previous anchor, or 0.
///
/// Ownership: on success *anchor is the caller's, for cairn_anchor_destroy; on failure it is not written. The picture is copied.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_OUT_OF_MEMORY.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_anchor_create(
    picture: *const cairn_picture,
    number: u64,
    flags: u32,
    anchor: *mut *mut cairn_anchor,
) -> cairn_result {
    call("cairn_anchor_create", || {
        check_out(anchor, "anchor")?;
        check_flags(flags, CAIRN_ANCHOR_CUT, "flags")?;
        // SAFETY: the host's promise about `picture`.
        let picture = unsafe { read_picture(picture, "picture") }?;
        let made = KeptAnchor::of_picture(picture, number, flags & CAIRN_ANCHOR_CUT != 0);
        // SAFETY: checked above; writable by the host's promise.
        unsafe { insert_to::<cairn_anchor>(made, anchor) }
    })
}

/// Gives the properties of an anchor.
///
/// Ownership: info stays the caller's and is filled on success; on failure it is not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_anchor_get_info(
    anchor: *const cairn_anchor,
    info: *mut cairn_anchor_info,
) -> cairn_result {
    call("cairn_anchor_get_info", || {
        let anchor = enter(anchor)?;
        // SAFETY: the host's promise about `info`.
        let info = unsafe { Out::new(info, "info") }?;
        let (width, height) = anchor.size();
        let [latent_channels, latent_height, latent_width] = anchor.latent_shape();
        info.write(&cairn_anchor_info {
            struct_size: 0,
            flags: if anchor.is_cut() { CAIRN_ANCHOR_CUT } else { 0 },
            latent: anchor.number(),
            latents_per_second: anchor.latents_per_second(),
            pictures: anchor.count() as u32,
            width,
            height,
            latent_channels,
            latent_height,
            latent_width,
            reserved: 0,
        });
        Ok(CAIRN_OK)
    })
}

/// Copies one of an anchor's pictures into the host's memory.
///
/// index: 0 to pictures - 1, in order of time.
/// target: of the anchor's size.
///
/// Ownership: the pixels are copied, on success; on failure none is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_anchor_read_picture(
    anchor: *const cairn_anchor,
    index: u32,
    target: *const cairn_target,
) -> cairn_result {
    call("cairn_anchor_read_picture", || {
        let anchor = enter(anchor)?;
        check_index(&anchor, index)?;
        // SAFETY: the host's promise about `target`.
        let target = unsafe { Target::new(target, anchor.size(), "target") }?;
        target.write(anchor.read(index as usize)?);
        Ok(CAIRN_OK)
    })
}

/// Copies an anchor's latent: float32, [channels, height, width], the last index varying fastest.
///
/// count: size of the array in numbers; must be channels * height * width.
///
/// Ownership: the numbers are copied, on success; on failure none is written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED for an anchor without a
/// latent.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_anchor_read_latent(
    anchor: *const cairn_anchor,
    values: *mut f32,
    count: usize,
) -> cairn_result {
    call("cairn_anchor_read_latent", || {
        let anchor = enter(anchor)?;
        let numbers = anchor.latent_shape().iter().map(|&n| n as usize).product::<usize>();
        if numbers == 0 {
            return Err(Error::new(ErrorKind::Unsupported, "the host's own picture has no latent").into());
        }
        if count != numbers {
            return Err(Failure::argument("count", format!("{count} numbers, the latent has {numbers}")));
        }
        // SAFETY: the host's promise about `values`.
        let values = unsafe { slice_mut(values, count, "values") }?;
        values.copy_from_slice(anchor.latent()?);
        Ok(CAIRN_OK)
    })
}

/// Fails for an index that is not below the anchor's number of pictures.
pub(super) fn check_index(anchor: &KeptAnchor, index: u32) -> AbiResult<()> {
    if (index as usize) < anchor.count() {
        return Ok(());
    }
    Err(Failure::argument("index", format!("there is no picture {index}, the anchor has {}", anchor.count())))
}

/// Destroys the handle of an anchor; null is allowed. Guidance and presenters that were given it keep what they need.
///
/// Ownership: on success anchor is no longer a handle; on failure it is unchanged.
/// Threads: any thread; waits for calls in flight on the anchor.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_anchor_destroy(anchor: *mut cairn_anchor) -> cairn_result {
    call("cairn_anchor_destroy", || destroy(anchor))
}
