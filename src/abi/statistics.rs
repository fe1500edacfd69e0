//! Figures of a rollout.

use super::boundary::call;
use super::handles::enter;
use super::results::{CAIRN_OK, cairn_result};
use super::rollout::{cairn_rollout, nanoseconds};
use super::structs::{Out, describe};

/// What a rollout has done since it was made, as of the end of its last step. Times are nanoseconds of wall time.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_rollout_statistics {
    /// sizeof(cairn_rollout_statistics)
    pub struct_size: u32,
    /// Steps that wait or run in its queue, now.
    pub queue_depth: u32,
    /// Latents made, appended ones among them.
    pub latents: u64,
    /// Denoise passes.
    pub denoise_passes: u64,
    /// Passes that make keys and values for the ring.
    pub cache_passes: u64,
    /// Passes of the decoder, also those that only prime it.
    pub decode_passes: u64,
    /// Pictures made latents.
    pub encode_ns: u64,
    /// Denoise passes.
    pub denoise_ns: u64,
    /// Cache passes.
    pub cache_ns: u64,
    /// Results checked and copied into the ring.
    pub commit_ns: u64,
    /// Latents made pictures.
    pub decode_ns: u64,
    /// Pictures read and resized.
    pub resize_ns: u64,
    /// Bytes from the host to the device.
    pub uploaded_bytes: u64,
    /// Bytes from place to place on the device.
    pub copied_bytes: u64,
    /// Bytes from the device to the host.
    pub read_bytes: u64,
    /// The part of copied_bytes that went into the ring.
    pub ring_bytes: u64,
}
describe!(cairn_rollout_statistics, [], {
    struct_size, queue_depth, latents, denoise_passes, cache_passes, decode_passes, encode_ns, denoise_ns, cache_ns,
    commit_ns, decode_ns, resize_ns, uploaded_bytes, copied_bytes, read_bytes, ring_bytes,
});

/// Says what a rollout has done so far. Does not wait for a step that is running.
///
/// Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_rollout_get_statistics(
    rollout: *const cairn_rollout,
    statistics: *mut cairn_rollout_statistics,
) -> cairn_result {
    call("cairn_rollout_get_statistics", || {
        let running = enter(rollout)?;
        // SAFETY: the host's promise about `statistics`.
        let statistics = unsafe { Out::new(statistics, "statistics") }?;
        let (figures, depth) = running.statistics();
        let (stages, bytes) = (figures.stages, figures.bytes);
        statistics.write(&cairn_rollout_statistics {
            struct_size: 0,
            queue_depth: u32::try_from(depth).unwrap_or(u32::MAX),
            latents: figures.latents,
            denoise_passes: stages.denoise.count,
            cache_passes: stages.cache.count,
            decode_passes: stages.decode.count,
            encode_ns: nanoseconds(stages.encode),
            denoise_ns: nanoseconds(stages.denoise),
            cache_ns: nanoseconds(stages.cache),
            commit_ns: nanoseconds(stages.commit),
            decode_ns: nanoseconds(stages.decode),
            resize_ns: nanoseconds(stages.resize),
            uploaded_bytes: bytes.uploaded,
            copied_bytes: bytes.copied,
            read_bytes: bytes.read,
            ring_bytes: figures.ring_bytes,
        });
        Ok(CAIRN_OK)
    })
}
