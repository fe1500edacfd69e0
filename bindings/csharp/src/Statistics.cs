namespace Cairn
{
    /// <summary>Statistics of a rollout since it was made, up to the end of its last step. Times are nanoseconds of wall time.</summary>
    public struct RolloutStatistics
    {
        private readonly Native.rollout_statistics from;

        internal RolloutStatistics(Native.rollout_statistics from)
        {
            this.from = from;
        }

        /// <summary>Steps that are waiting or running in its queue now.</summary>
        public int QueueDepth
        {
            get { return (int)from.queue_depth; }
        }

        /// <summary>Latents made, including appended ones.</summary>
        public long Latents
        {
            get { return (long)from.latents; }
        }

        /// <summary>Number of denoise passes.</summary>
        public long DenoisePasses
        {
            get { return (long)from.denoise_passes; }
        }

        /// <summary>Number of cache passes, which make keys and values for the ring.</summary>
        public long CachePasses
        {
            get { return (long)from.cache_passes; }
        }

        /// <summary>Number of decoder passes, including those that only prime it.</summary>
        public long DecodePasses
        {
            get { return (long)from.decode_passes; }
        }

        /// <summary>Time of encoding pictures.</summary>
        public long EncodeNs
        {
            get { return (long)from.encode_ns; }
        }

        /// <summary>Time of denoise passes.</summary>
        public long DenoiseNs
        {
            get { return (long)from.denoise_ns; }
        }

        /// <summary>Time of cache passes.</summary>
        public long CacheNs
        {
            get { return (long)from.cache_ns; }
        }

        /// <summary>Time of checking results and copying them into the ring.</summary>
        public long CommitNs
        {
            get { return (long)from.commit_ns; }
        }

        /// <summary>Time of decoding latents.</summary>
        public long DecodeNs
        {
            get { return (long)from.decode_ns; }
        }

        /// <summary>Time of reading back and resizing pictures.</summary>
        public long ResizeNs
        {
            get { return (long)from.resize_ns; }
        }

        /// <summary>Bytes copied from the host to the device.</summary>
        public long UploadedBytes
        {
            get { return (long)from.uploaded_bytes; }
        }

        /// <summary>Bytes copied within the device.</summary>
        public long CopiedBytes
        {
            get { return (long)from.copied_bytes; }
        }

        /// <summary>Bytes copied from the device to the host.</summary>
        public long ReadBytes
        {
            get { return (long)from.read_bytes; }
        }

        /// <summary>The part of <see cref="CopiedBytes"/> that was copied into the ring.</summary>
        public long RingBytes
        {
            get { return (long)from.ring_bytes; }
        }

        /// <summary>Passes of the transformer timed by a Direct3D 12 device's own clock; 0 on other devices, like all values up to <see cref="OtherPasses"/>.</summary>
        public long DevicePasses
        {
            get { return (long)from.device_passes; }
        }

        /// <summary>Total device time of <see cref="DevicePasses"/>, in nanoseconds.</summary>
        public long DevicePassesNs
        {
            get { return (long)from.device_passes_ns; }
        }

        /// <summary>Device time of the longest of these passes, or of the longest slice of one, in nanoseconds.</summary>
        public long DevicePassLongestNs
        {
            get { return (long)from.device_pass_longest_ns; }
        }

        /// <summary>Decoder passes timed on the device.</summary>
        public long DeviceDecodes
        {
            get { return (long)from.device_decodes; }
        }

        /// <summary>Total device time of <see cref="DeviceDecodes"/>, in nanoseconds.</summary>
        public long DeviceDecodesNs
        {
            get { return (long)from.device_decodes_ns; }
        }

        /// <summary>Device time of the longest decoder pass, in nanoseconds.</summary>
        public long DeviceDecodeLongestNs
        {
            get { return (long)from.device_decode_longest_ns; }
        }

        /// <summary>Copies into the ring timed on the device.</summary>
        public long DeviceCommits
        {
            get { return (long)from.device_commits; }
        }

        /// <summary>Total device time of <see cref="DeviceCommits"/>, in nanoseconds.</summary>
        public long DeviceCommitsNs
        {
            get { return (long)from.device_commits_ns; }
        }

        /// <summary>Nanoseconds of wall time inside ONNX Runtime.</summary>
        public long RuntimeNs
        {
            get { return (long)from.runtime_ns; }
        }

        /// <summary>Nanoseconds of wall time spent waiting for the device.</summary>
        public long WaitedNs
        {
            get { return (long)from.waited_ns; }
        }

        /// <summary>Number of waits that gave an engine's frames their turn on the device.</summary>
        public long Yields
        {
            get { return (long)from.yields; }
        }

        /// <summary>Passes that run from a captured command list.</summary>
        public int CapturedPasses
        {
            get { return (int)from.captured_passes; }
        }

        /// <summary>Passes that do not run from a captured command list, or whose captured list is not verified yet to give the same bits.</summary>
        public int OtherPasses
        {
            get { return (int)from.other_passes; }
        }

        /// <summary>Nanoseconds of a presented frame, as last measured for a budget.</summary>
        public long GovernedFrameNs
        {
            get { return (long)from.governed_frame_ns; }
        }

        /// <summary>Latents measured for a budget.</summary>
        public long GovernedLatents
        {
            get { return (long)from.governed_latents; }
        }

        /// <summary>Frames measured for a budget.</summary>
        public long GovernedFrames
        {
            get { return (long)from.governed_frames; }
        }

        /// <summary>Number of times that a budget lowered a setting because frames took too long.</summary>
        public long GovernedLess
        {
            get { return (long)from.governed_less; }
        }

        /// <summary>Number of times that a budget raised a setting again.</summary>
        public long GovernedMore
        {
            get { return (long)from.governed_more; }
        }

        /// <summary>Number of times that a budget narrowed the window because device memory was short.</summary>
        public long GovernedShortOfMemory
        {
            get { return (long)from.governed_short_of_memory; }
        }

        /// <summary>Number of times that frames took too long and no setting could be lowered.</summary>
        public long GovernedBeyond
        {
            get { return (long)from.governed_beyond; }
        }

        /// <summary>Current number of passes per latent; 0 if there never was a budget.</summary>
        public int GovernedPasses
        {
            get { return (int)from.governed_passes; }
        }

        /// <summary>Current global window; 0 if there never was a budget.</summary>
        public int GovernedWindow
        {
            get { return (int)from.governed_window; }
        }

        /// <summary>Different frames shown per anchor, the anchor included; 0 if there never was a budget.</summary>
        public int GovernedMade
        {
            get { return (int)from.governed_made; }
        }
    }

    /// <summary>Statistics of a presenter since it was made.</summary>
    public sealed unsafe class PresenterStatistics
    {
        private readonly Native.presenter_statistics from;

        internal PresenterStatistics(Native.presenter_statistics from)
        {
            this.from = from;
            Generator = Text.Decode(from.generator, 32);
            Preference = Text.Decode(from.preference, 160);
            Upscaler = Text.Decode(from.upscaler, 32);
            Upscaling = Text.Decode(from.upscaling, 160);
        }

        /// <summary>Anchors pushed.</summary>
        public long Anchors
        {
            get { return (long)from.anchors; }
        }

        /// <summary>Anchors that were pushed after they were due.</summary>
        public long LateAnchors
        {
            get { return (long)from.late_anchors; }
        }

        /// <summary>Nanoseconds for which the stream's time stood still to wait for late anchors.</summary>
        public long SlippedNs
        {
            get { return (long)from.slipped_ns; }
        }

        /// <summary>Frames drawn that were anchors. A frame drawn again counts again, here and below.</summary>
        public long ShownAnchors
        {
            get { return (long)from.shown_anchors; }
        }

        /// <summary>Frames drawn that were decoded together with an anchor.</summary>
        public long ShownDecoded
        {
            get { return (long)from.shown_decoded; }
        }

        /// <summary>Frames drawn that were generated between anchors.</summary>
        public long ShownGenerated
        {
            get { return (long)from.shown_generated; }
        }

        /// <summary>Frames drawn that were extrapolated beyond the last anchor.</summary>
        public long ShownExtrapolated
        {
            get { return (long)from.shown_extrapolated; }
        }

        /// <summary>Frames drawn that repeated a picture.</summary>
        public long ShownHeld
        {
            get { return (long)from.shown_held; }
        }

        /// <summary>Frames of any kind that were the same as the one drawn before.</summary>
        public long Repeated
        {
            get { return (long)from.repeated; }
        }

        /// <summary>Frames that were not generated because of a cut.</summary>
        public long Cuts
        {
            get { return (long)from.cuts; }
        }

        /// <summary>Nanoseconds spent on motion and depth.</summary>
        public long GuidanceNs
        {
            get { return (long)from.guidance_ns; }
        }

        /// <summary>Nanoseconds spent on generation.</summary>
        public long GenerateNs
        {
            get { return (long)from.generate_ns; }
        }

        /// <summary>Nanoseconds spent on resizing.</summary>
        public long ResizeNs
        {
            get { return (long)from.resize_ns; }
        }

        /// <summary>Anchors that are not due yet at the latest time that was passed.</summary>
        public int Waiting
        {
            get { return (int)from.waiting; }
        }

        /// <summary>Frames for Direct3D 12 that were submitted and have not completed.</summary>
        public int UnderWay
        {
            get { return (int)from.under_way; }
        }

        /// <summary>Frames for Direct3D 12 timed on the device.</summary>
        public long DeviceFrames
        {
            get { return (long)from.device_frames; }
        }

        /// <summary>Total nanoseconds of them on the device.</summary>
        public long DeviceFramesNs
        {
            get { return (long)from.device_frames_ns; }
        }

        /// <summary>Nanoseconds of the longest one.</summary>
        public long DeviceFrameLongestNs
        {
            get { return (long)from.device_frame_longest_ns; }
        }

        /// <summary>Nanoseconds of the last one.</summary>
        public long DeviceFrameLastNs
        {
            get { return (long)from.device_frame_last_ns; }
        }

        /// <summary>The presenter's own command lists timed on the device.</summary>
        public long DeviceLists
        {
            get { return (long)from.device_lists; }
        }

        /// <summary>Total nanoseconds of them on the device.</summary>
        public long DeviceListsNs
        {
            get { return (long)from.device_lists_ns; }
        }

        /// <summary>Nanoseconds of the longest one.</summary>
        public long DeviceListLongestNs
        {
            get { return (long)from.device_list_longest_ns; }
        }

        /// <summary>Different frames shown per anchor under a budget, the anchor included; 0 if there never was one.</summary>
        public int MadeToAnchor
        {
            get { return (int)from.made_to_anchor; }
        }

        /// <summary>Number of times that it has changed.</summary>
        public int BudgetChanges
        {
            get { return (int)from.budget_changes; }
        }

        /// <summary>Pushed anchors that their device has not finished yet.</summary>
        public int AnchorsUnderWay
        {
            get { return (int)from.anchors_under_way; }
        }

        /// <summary>Frames for Direct3D 12 that showed an anchor because they were not prepared.</summary>
        public long Unprepared
        {
            get { return (long)from.unprepared; }
        }

        /// <summary>Objects of Direct3D and contexts of AMD's libraries that were created while frames were recorded.</summary>
        public long ObjectsMade
        {
            get { return (long)from.objects_made; }
        }

        /// <summary>Recorded frames that a host's command lists may still read.</summary>
        public int ListsPending
        {
            get { return (int)from.lists_pending; }
        }

        /// <summary>Generator of the last frame, such as "cpu"; empty for none.</summary>
        public string Generator { get; }

        /// <summary>Why a generator that might be better is not used, as text.</summary>
        public string Preference { get; }

        /// <summary>Upscaler of frames, such as "spatial"; empty if they have the anchors' size.</summary>
        public string Upscaler { get; }

        /// <summary>Why AMD's upscaler is not used, as text.</summary>
        public string Upscaling { get; }
    }
}
