//! Statistics of rollouts and presenters.

use std::ffi::c_char;
use std::time::Duration;

use super::boundary::call;
use super::d3d12::backend;
use super::handles::{busy_in_callback, enter};
use super::presenter::cairn_presenter;
use super::results::{CAIRN_OK, cairn_result};
use super::rollout::{cairn_rollout, nanoseconds};
use super::structs::{Out, describe};
use super::text::fixed_text;
use crate::present::Selection;
use crate::world::WorkerStatistics;

/// Statistics of a rollout since it was created, as of the end of its last step. Times are nanoseconds of wall time unless a field says otherwise.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_rollout_statistics {
    /// sizeof(cairn_rollout_statistics)
    pub struct_size: u32,
    /// Steps in its queue now, waiting or running.
    pub queue_depth: u32,
    /// Latents made, including appended ones.
    pub latents: u64,
    /// Denoise passes.
    pub denoise_passes: u64,
    /// Cache passes, which compute keys and values for the ring.
    pub cache_passes: u64,
    /// Passes of the decoder, including those that only prime it.
    pub decode_passes: u64,
    /// Time of encoding pictures into latents.
    pub encode_ns: u64,
    /// Time of denoise passes.
    pub denoise_ns: u64,
    /// Time of cache passes.
    pub cache_ns: u64,
    /// Time of checking results and copying them into the ring.
    pub commit_ns: u64,
    /// Time of decoding latents.
    pub decode_ns: u64,
    /// Time of reading pictures back and resizing them.
    pub resize_ns: u64,
    /// Bytes from the host to the device.
    pub uploaded_bytes: u64,
    /// Bytes copied within the device.
    pub copied_bytes: u64,
    /// Bytes from the device to the host.
    pub read_bytes: u64,
    /// The part of copied_bytes that went into the ring.
    pub ring_bytes: u64,
    /// Passes of the transformer whose time was measured by the clock of a Direct3D 12 device; 0 on other devices, like all fields up to
    /// other_passes. Their times include other work that the queue did meanwhile.
    pub device_passes: u64,
    /// Total time of these passes, in nanoseconds of the device's clock.
    pub device_passes_ns: u64,
    /// Time of the longest of these passes, or of the longest slice of one, in nanoseconds of the device's clock.
    pub device_pass_longest_ns: u64,
    /// Passes of the decoder whose time was measured by the device's clock.
    pub device_decodes: u64,
    /// Total time of these passes, in nanoseconds of the device's clock.
    pub device_decodes_ns: u64,
    /// Time of the longest of these passes, in nanoseconds of the device's clock.
    pub device_decode_longest_ns: u64,
    /// Copies into the ring whose time was measured by the device's clock.
    pub device_commits: u64,
    /// Total time of these copies, in nanoseconds of the device's clock.
    pub device_commits_ns: u64,
    /// Nanoseconds of wall time inside ONNX Runtime, which records the device's command lists and submits them.
    pub runtime_ns: u64,
    /// Nanoseconds of wall time spent waiting for the device.
    pub waited_ns: u64,
    /// Number of waits because of longest_submission_us of cairn_d3d12_options or of cairn_world_options.
    pub yields: u64,
    /// Passes with buffers of their own that run from captured commands: see cairn_d3d12_options.captured_passes.
    pub captured_passes: u32,
    /// Other passes with buffers of their own: not captured, or their captured results are not known to be identical bit for bit.
    pub other_passes: u32,
    /// Nanoseconds per shown frame, as last measured under the budget of cairn_rollout_govern. This and the fields below belong to that budget,
    /// or to the last one that ended.
    pub governed_frame_ns: u64,
    /// Latents measured.
    pub governed_latents: u64,
    /// Frames measured.
    pub governed_frames: u64,
    /// How often quality was reduced because frames took too long.
    pub governed_less: u64,
    /// How often quality was raised again.
    pub governed_more: u64,
    /// How often the window was narrowed because the device's memory was short.
    pub governed_short_of_memory: u64,
    /// How often frames took too long although quality could not be reduced further.
    pub governed_beyond: u64,
    /// Denoise passes per latent from now on; 0 if there never was a budget, like the next two fields.
    pub governed_passes: u32,
    /// The global window from now on.
    pub governed_window: u32,
    /// Different frames shown per anchor, the anchor included.
    pub governed_made: u32,
    /// 0
    pub reserved: u32,
}
describe!(cairn_rollout_statistics, [120, 216], {
    struct_size, queue_depth, latents, denoise_passes, cache_passes, decode_passes, encode_ns, denoise_ns, cache_ns,
    commit_ns, decode_ns, resize_ns, uploaded_bytes, copied_bytes, read_bytes, ring_bytes, device_passes, device_passes_ns,
    device_pass_longest_ns, device_decodes, device_decodes_ns, device_decode_longest_ns, device_commits, device_commits_ns,
    runtime_ns, waited_ns, yields, captured_passes, other_passes, governed_frame_ns, governed_latents, governed_frames,
    governed_less, governed_more, governed_short_of_memory, governed_beyond, governed_passes, governed_window, governed_made,
    reserved,
});

/// Returns statistics of a rollout. Does not wait for a step that is running.
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
        let (worker, depth) = running.statistics();
        let device = backend::rollout_statistics(&worker);
        let WorkerStatistics { rollout, governor, .. } = worker;
        let (stages, bytes) = (rollout.stages, rollout.bytes);
        statistics.write(&cairn_rollout_statistics {
            struct_size: 0,
            queue_depth: u32::try_from(depth).unwrap_or(u32::MAX),
            latents: rollout.latents,
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
            ring_bytes: rollout.ring_bytes,
            device_passes: device.passes.count,
            device_passes_ns: in_ns(device.passes.total),
            device_pass_longest_ns: in_ns(device.passes.longest),
            device_decodes: device.decodes.count,
            device_decodes_ns: in_ns(device.decodes.total),
            device_decode_longest_ns: in_ns(device.decodes.longest),
            device_commits: device.commits.count,
            device_commits_ns: in_ns(device.commits.total),
            runtime_ns: in_ns(device.in_onnxruntime),
            waited_ns: in_ns(device.waiting_for_device),
            yields: device.yields,
            captured_passes: u32::try_from(device.captured).unwrap_or(u32::MAX),
            other_passes: u32::try_from(device.others).unwrap_or(u32::MAX),
            governed_frame_ns: in_ns(governor.frame),
            governed_latents: governor.latents,
            governed_frames: governor.frames,
            governed_less: governor.reductions,
            governed_more: governor.increases,
            governed_short_of_memory: governor.short_of_memory,
            governed_beyond: governor.over_budget,
            governed_passes: governor.passes,
            governed_window: governor.window,
            governed_made: governor.generated,
            reserved: 0,
        });
        Ok(CAIRN_OK)
    })
}

/// Statistics of a presenter since it was created.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_presenter_statistics {
    /// sizeof(cairn_presenter_statistics)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Anchors that arrived.
    pub anchors: u64,
    /// Anchors that arrived after they were due.
    pub late_anchors: u64,
    /// Nanoseconds by which late anchors have delayed the stream.
    pub slipped_ns: u64,
    /// Frames drawn that were anchors. Drawing the same frame again counts again, here and below.
    pub shown_anchors: u64,
    /// Frames drawn that were decoded pictures of an anchor.
    pub shown_decoded: u64,
    /// Frames drawn that were interpolated between anchors.
    pub shown_generated: u64,
    /// Frames drawn that were extrapolated from the last anchor.
    pub shown_extrapolated: u64,
    /// Frames drawn that held a picture because nothing could be generated.
    pub shown_held: u64,
    /// Frames drawn, of any kind, that repeated the previous one.
    pub repeated: u64,
    /// Frames drawn that were not generated because of a cut.
    pub cuts: u64,
    /// Nanoseconds spent on extracting motion and depth.
    pub guidance_ns: u64,
    /// Nanoseconds spent on generating frames.
    pub generate_ns: u64,
    /// Nanoseconds spent on resizing frames.
    pub resize_ns: u64,
    /// The last frame's generator, such as "cpu" or, with its provider's version, "fsr 3.1.5"; empty for none.
    pub generator: [c_char; 32],
    /// Why a preferred generator is not used, for people; UTF-8.
    pub preference: [c_char; 160],
    /// Anchors that have arrived and are not due, as of the latest time that was passed.
    pub waiting: u32,
    /// Frames for Direct3D 12 that were submitted and have not completed.
    pub under_way: u32,
    /// Frames for Direct3D 12 whose time was measured by the device's clock. Their times include other work that the queue did meanwhile.
    pub device_frames: u64,
    /// Total time of these frames, in nanoseconds of the device's clock.
    pub device_frames_ns: u64,
    /// Time of the longest of these frames, in nanoseconds of the device's clock.
    pub device_frame_longest_ns: u64,
    /// Time of the last of these frames, in nanoseconds of the device's clock.
    pub device_frame_last_ns: u64,
    /// The presenter's own lists whose time was measured by the device's clock: they upload pictures, extract motion and depth, and prepare
    /// the work that all frames of a pair share.
    pub device_lists: u64,
    /// Total time of these lists, in nanoseconds of the device's clock.
    pub device_lists_ns: u64,
    /// Time of the longest of these lists, in nanoseconds of the device's clock.
    pub device_list_longest_ns: u64,
    /// Different frames shown per anchor, the anchor included, under a budget of cairn_presenter_set_budget; the others repeat the previous
    /// one. 0 if there never was a budget.
    pub made_to_anchor: u32,
    /// How often that number has changed.
    pub budget_changes: u32,
    /// Upscaler of the last frame: "spatial", AMD's with its version as in "fsr 4.0.3", or empty if frames have the anchors' size.
    pub upscaler: [c_char; 32],
    /// Why AMD's upscaler is not used, for people; UTF-8.
    pub upscaling: [c_char; 160],
    /// Frames for Direct3D 12 replaced by an anchor: CAIRN_FRAME_UNPREPARED.
    pub unprepared: u64,
    /// Direct3D objects and AMD contexts created while frames were recorded or submitted: 0 if all frames were prepared.
    pub objects_made: u64,
    /// Recorded frames whose fences have not been signalled.
    pub lists_pending: u32,
    /// Pushed anchors whose fences have not been signalled.
    pub anchors_under_way: u32,
}
describe!(cairn_presenter_statistics, [304, 376, 568], {
    struct_size, reserved, anchors, late_anchors, slipped_ns, shown_anchors, shown_decoded, shown_generated,
    shown_extrapolated, shown_held, repeated, cuts, guidance_ns, generate_ns, resize_ns, generator, preference, waiting,
    under_way, device_frames, device_frames_ns, device_frame_longest_ns, device_frame_last_ns, device_lists, device_lists_ns,
    device_list_longest_ns, made_to_anchor, budget_changes, upscaler, upscaling, unprepared, objects_made, lists_pending,
    anchors_under_way,
});

/// Returns statistics of a presenter.
///
/// Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
/// Threads: any thread, at any time.
/// Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY from within a
/// callback of a call that records frames of the presenter.
/// Since: 0.1.0
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cairn_presenter_get_statistics(
    presenter: *const cairn_presenter,
    statistics: *mut cairn_presenter_statistics,
) -> cairn_result {
    call("cairn_presenter_get_statistics", || {
        let object = enter(presenter)?;
        // SAFETY: the host's promise about `statistics`.
        let statistics = unsafe { Out::new(statistics, "statistics") }?;
        // First: it reads reports that change the counters below.
        let device = object.frame_statistics(object.is_nested()).ok_or_else(busy_in_callback)?;
        let Selection { name: generator, reason: preference } = object.generator(&device);
        let Selection { name: upscaler, reason: upscaling } = object.upscaler(&device);
        let counters = object.presenter.statistics();
        statistics.write(&cairn_presenter_statistics {
            struct_size: 0,
            reserved: 0,
            anchors: counters.anchors,
            late_anchors: counters.late,
            slipped_ns: counters.slipped_ns,
            shown_anchors: counters.shown_anchors,
            shown_decoded: counters.decoded,
            shown_generated: counters.generated,
            shown_extrapolated: counters.extrapolated,
            shown_held: counters.held,
            repeated: counters.repeated,
            cuts: counters.cuts,
            guidance_ns: in_ns(counters.guidance),
            generate_ns: in_ns(counters.generate),
            resize_ns: in_ns(counters.resize),
            generator: fixed_text(&generator),
            preference: fixed_text(&preference),
            waiting: u32::try_from(object.presenter.waiting(0)).unwrap_or(u32::MAX),
            under_way: device.in_flight,
            device_frames: device.frames.count,
            device_frames_ns: in_ns(device.frames.total),
            device_frame_longest_ns: in_ns(device.frames.longest),
            device_frame_last_ns: in_ns(device.frames.last),
            device_lists: device.lists.count,
            device_lists_ns: in_ns(device.lists.total),
            device_list_longest_ns: in_ns(device.lists.longest),
            made_to_anchor: counters.made_to_anchor,
            budget_changes: u32::try_from(counters.budget_changes).unwrap_or(u32::MAX),
            upscaler: fixed_text(&upscaler),
            upscaling: fixed_text(&upscaling),
            unprepared: counters.unprepared,
            objects_made: counters.objects_made,
            lists_pending: device.lists_pending,
            anchors_under_way: u32::try_from(object.presenter.arriving()).unwrap_or(u32::MAX),
        });
        Ok(CAIRN_OK)
    })
}

fn in_ns(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}
