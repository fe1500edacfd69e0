namespace Cairn
{
    /// <summary>What a rollout has done since it was made, as of the end of its last step. Times are nanoseconds of wall time.</summary>
    public struct RolloutStatistics
    {
        private readonly Native.rollout_statistics from;

        internal RolloutStatistics(Native.rollout_statistics from)
        {
            this.from = from;
        }

        /// <summary>Steps that wait or run in its queue, now.</summary>
        public int QueueDepth
        {
            get { return (int)from.queue_depth; }
        }

        /// <summary>Latents made, appended ones among them.</summary>
        public long Latents
        {
            get { return (long)from.latents; }
        }

        /// <summary>Denoise passes.</summary>
        public long DenoisePasses
        {
            get { return (long)from.denoise_passes; }
        }

        /// <summary>Passes that make keys and values for the ring.</summary>
        public long CachePasses
        {
            get { return (long)from.cache_passes; }
        }

        /// <summary>Passes of the decoder, also those that only prime it.</summary>
        public long DecodePasses
        {
            get { return (long)from.decode_passes; }
        }

        /// <summary>Pictures made latents.</summary>
        public long EncodeNs
        {
            get { return (long)from.encode_ns; }
        }

        /// <summary>Denoise passes.</summary>
        public long DenoiseNs
        {
            get { return (long)from.denoise_ns; }
        }

        /// <summary>Cache passes.</summary>
        public long CacheNs
        {
            get { return (long)from.cache_ns; }
        }

        /// <summary>Results checked and copied into the ring.</summary>
        public long CommitNs
        {
            get { return (long)from.commit_ns; }
        }

        /// <summary>Latents made pictures.</summary>
        public long DecodeNs
        {
            get { return (long)from.decode_ns; }
        }

        /// <summary>Pictures read and resized.</summary>
        public long ResizeNs
        {
            get { return (long)from.resize_ns; }
        }

        /// <summary>Bytes from the host to the device.</summary>
        public long UploadedBytes
        {
            get { return (long)from.uploaded_bytes; }
        }

        /// <summary>Bytes from place to place on the device.</summary>
        public long CopiedBytes
        {
            get { return (long)from.copied_bytes; }
        }

        /// <summary>Bytes from the device to the host.</summary>
        public long ReadBytes
        {
            get { return (long)from.read_bytes; }
        }

        /// <summary>The part of <see cref="CopiedBytes"/> that went into the ring.</summary>
        public long RingBytes
        {
            get { return (long)from.ring_bytes; }
        }

        /// <summary>Passes whose time on a Direct3D 12 device is known by its own clock; 0 on others, as what follows.</summary>
        public long DevicePasses
        {
            get { return (long)from.device_passes; }
        }

        /// <summary>Nanoseconds of them on the device, all together.</summary>
        public long DevicePassesNs
        {
            get { return (long)from.device_passes_ns; }
        }

        /// <summary>Nanoseconds of the longest.</summary>
        public long DevicePassLongestNs
        {
            get { return (long)from.device_pass_longest_ns; }
        }

        /// <summary>Passes of the decoder whose time on the device is known.</summary>
        public long DeviceDecodes
        {
            get { return (long)from.device_decodes; }
        }

        /// <summary>Nanoseconds of them on the device, all together.</summary>
        public long DeviceDecodesNs
        {
            get { return (long)from.device_decodes_ns; }
        }

        /// <summary>Nanoseconds of the longest.</summary>
        public long DeviceDecodeLongestNs
        {
            get { return (long)from.device_decode_longest_ns; }
        }

        /// <summary>Copies into the ring whose time on the device is known.</summary>
        public long DeviceCommits
        {
            get { return (long)from.device_commits; }
        }

        /// <summary>Nanoseconds of them on the device, all together.</summary>
        public long DeviceCommitsNs
        {
            get { return (long)from.device_commits_ns; }
        }

        /// <summary>Nanoseconds of wall time inside ONNX Runtime.</summary>
        public long RuntimeNs
        {
            get { return (long)from.runtime_ns; }
        }

        /// <summary>Nanoseconds of wall time of waiting for the device.</summary>
        public long WaitedNs
        {
            get { return (long)from.waited_ns; }
        }

        /// <summary>How often it waited so that an engine's frames got their turn.</summary>
        public long Yields
        {
            get { return (long)from.yields; }
        }

        /// <summary>Passes that run by capture.</summary>
        public int CapturedPasses
        {
            get { return (int)from.captured_passes; }
        }

        /// <summary>Those that do not, or have not shown yet that their bits are the same.</summary>
        public int OtherPasses
        {
            get { return (int)from.other_passes; }
        }

        /// <summary>Nanoseconds of a frame that was shown, as measured last for a budget.</summary>
        public long GovernedFrameNs
        {
            get { return (long)from.governed_frame_ns; }
        }

        /// <summary>Latents that a budget measured.</summary>
        public long GovernedLatents
        {
            get { return (long)from.governed_latents; }
        }

        /// <summary>Frames that it measured.</summary>
        public long GovernedFrames
        {
            get { return (long)from.governed_frames; }
        }

        /// <summary>How often it gave something up as frames took too long.</summary>
        public long GovernedLess
        {
            get { return (long)from.governed_less; }
        }

        /// <summary>How often something came back.</summary>
        public long GovernedMore
        {
            get { return (long)from.governed_more; }
        }

        /// <summary>How often the window became narrower as the device's memory was short.</summary>
        public long GovernedShortOfMemory
        {
            get { return (long)from.governed_short_of_memory; }
        }

        /// <summary>How often frames took too long although nothing was left to give up.</summary>
        public long GovernedBeyond
        {
            get { return (long)from.governed_beyond; }
        }

        /// <summary>Passes that latents have from now on; 0 where there never was a budget.</summary>
        public int GovernedPasses
        {
            get { return (int)from.governed_passes; }
        }

        /// <summary>The global window from now on; 0 likewise.</summary>
        public int GovernedWindow
        {
            get { return (int)from.governed_window; }
        }

        /// <summary>Frames to an anchor that are made; 0 likewise.</summary>
        public int GovernedMade
        {
            get { return (int)from.governed_made; }
        }
    }

    /// <summary>What a presenter has done since it was made.</summary>
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

        /// <summary>Anchors that came.</summary>
        public long Anchors
        {
            get { return (long)from.anchors; }
        }

        /// <summary>Those that came after they were due.</summary>
        public long LateAnchors
        {
            get { return (long)from.late_anchors; }
        }

        /// <summary>Nanoseconds that time stood still for late ones.</summary>
        public long SlippedNs
        {
            get { return (long)from.slipped_ns; }
        }

        /// <summary>Frames drawn that were anchors. A frame drawn again counts again, here and below.</summary>
        public long ShownAnchors
        {
            get { return (long)from.shown_anchors; }
        }

        /// <summary>Frames drawn that anchors brought with them.</summary>
        public long ShownDecoded
        {
            get { return (long)from.shown_decoded; }
        }

        /// <summary>Frames drawn that were generated between anchors.</summary>
        public long ShownGenerated
        {
            get { return (long)from.shown_generated; }
        }

        /// <summary>Frames drawn that were generated beyond the last anchor.</summary>
        public long ShownExtrapolated
        {
            get { return (long)from.shown_extrapolated; }
        }

        /// <summary>Frames drawn that stood.</summary>
        public long ShownHeld
        {
            get { return (long)from.shown_held; }
        }

        /// <summary>Those of all of them that were the same as the one drawn before.</summary>
        public long Repeated
        {
            get { return (long)from.repeated; }
        }

        /// <summary>Those that a cut kept from being generated.</summary>
        public long Cuts
        {
            get { return (long)from.cuts; }
        }

        /// <summary>Nanoseconds of finding motion and depth.</summary>
        public long GuidanceNs
        {
            get { return (long)from.guidance_ns; }
        }

        /// <summary>Nanoseconds of generating.</summary>
        public long GenerateNs
        {
            get { return (long)from.generate_ns; }
        }

        /// <summary>Nanoseconds of resizing.</summary>
        public long ResizeNs
        {
            get { return (long)from.resize_ns; }
        }

        /// <summary>Anchors that wait for their time, as of the latest time that was heard of.</summary>
        public int Waiting
        {
            get { return (int)from.waiting; }
        }

        /// <summary>Frames for Direct3D 12 that are recorded and have not run.</summary>
        public int UnderWay
        {
            get { return (int)from.under_way; }
        }

        /// <summary>Frames for Direct3D 12 whose time on the device is known.</summary>
        public long DeviceFrames
        {
            get { return (long)from.device_frames; }
        }

        /// <summary>Nanoseconds of them on the device, all together.</summary>
        public long DeviceFramesNs
        {
            get { return (long)from.device_frames_ns; }
        }

        /// <summary>Nanoseconds of the longest.</summary>
        public long DeviceFrameLongestNs
        {
            get { return (long)from.device_frame_longest_ns; }
        }

        /// <summary>Nanoseconds of the last.</summary>
        public long DeviceFrameLastNs
        {
            get { return (long)from.device_frame_last_ns; }
        }

        /// <summary>Lists of the presenter's own whose time on the device is known.</summary>
        public long DeviceLists
        {
            get { return (long)from.device_lists; }
        }

        /// <summary>Nanoseconds of them on the device, all together.</summary>
        public long DeviceListsNs
        {
            get { return (long)from.device_lists_ns; }
        }

        /// <summary>Nanoseconds of the longest.</summary>
        public long DeviceListLongestNs
        {
            get { return (long)from.device_list_longest_ns; }
        }

        /// <summary>Frames to an anchor that are made where a budget holds them; 0 where there never was one.</summary>
        public int MadeToAnchor
        {
            get { return (int)from.made_to_anchor; }
        }

        /// <summary>How often that has changed.</summary>
        public int BudgetChanges
        {
            get { return (int)from.budget_changes; }
        }

        /// <summary>Anchors that were pushed and that their device still works on.</summary>
        public int AnchorsUnderWay
        {
            get { return (int)from.anchors_under_way; }
        }

        /// <summary>Frames for Direct3D 12 in whose place an anchor was shown, as they were not prepared.</summary>
        public long Unprepared
        {
            get { return (long)from.unprepared; }
        }

        /// <summary>Objects of Direct3D and contexts of AMD's that were made while frames were recorded.</summary>
        public long ObjectsMade
        {
            get { return (long)from.objects_made; }
        }

        /// <summary>Recorded frames that a host's command lists may still read.</summary>
        public int ListsPending
        {
            get { return (int)from.lists_pending; }
        }

        /// <summary>The last frame's generator, such as "cpu"; empty for none.</summary>
        public string Generator { get; }

        /// <summary>Why a generator that might be better is not used, for people.</summary>
        public string Preference { get; }

        /// <summary>What brings frames to their size, such as "spatial"; empty where they have the anchors'.</summary>
        public string Upscaler { get; }

        /// <summary>Why AMD's upscaler does not, for people.</summary>
        public string Upscaling { get; }
    }
}
