using System;

namespace Cairn
{
    /// <summary>Properties of a world. Sizes are in pixels, windows in latents.</summary>
    public sealed unsafe class WorldInfo
    {
        internal WorldInfo(ref Native.world_info from)
        {
            Precision = (Precision)from.precision;
            RenderWidth = (int)from.render_width;
            RenderHeight = (int)from.render_height;
            DecodedWidth = (int)from.decoded_width;
            DecodedHeight = (int)from.decoded_height;
            LatentChannels = (int)from.latent_channels;
            LatentHeight = (int)from.latent_height;
            LatentWidth = (int)from.latent_width;
            Tokens = (int)from.tokens;
            Layers = (int)from.layers;
            PicturesPerLatent = (int)from.pictures_per_latent;
            LocalWindow = (int)from.local_window;
            GlobalWindow = (int)from.global_window;
            MaxGlobalWindow = (int)from.max_global_window;
            GlobalDilation = (int)from.global_dilation;
            LatentsPerSecond = (int)from.latents_per_second;
            Keys = (int)from.keys;
            Slices = (int)from.slices;
            LongestSliceUs = (long)from.longest_slice_us;
            fixed (byte* name = from.name) Name = Text.Decode(name, 128);
            fixed (byte* licence = from.licence) Licence = Text.Decode(licence, 64);
            fixed (byte* digest = from.digest) Digest = Text.Decode(digest, 72);
        }

        /// <summary>Name for display.</summary>
        public string Name { get; }

        /// <summary>Its licence as an SPDX expression; <see cref="World.LicenceText"/> is the text.</summary>
        public string Licence { get; }

        /// <summary>The bundle's identity: SHA-256 of its manifest, in hexadecimal.</summary>
        public string Digest { get; }

        /// <summary>Precision of the graphs.</summary>
        public Precision Precision { get; }

        /// <summary>Width of the anchors' pictures, in square pixels.</summary>
        public int RenderWidth { get; }

        /// <summary>Height of the anchors' pictures.</summary>
        public int RenderHeight { get; }

        /// <summary>Width of the decoded pictures, whose pixels may not be square.</summary>
        public int DecodedWidth { get; }

        /// <summary>Height of the decoded pictures.</summary>
        public int DecodedHeight { get; }

        /// <summary>Channels of a latent.</summary>
        public int LatentChannels { get; }

        /// <summary>Rows of a latent.</summary>
        public int LatentHeight { get; }

        /// <summary>Columns of a latent.</summary>
        public int LatentWidth { get; }

        /// <summary>Tokens per latent.</summary>
        public int Tokens { get; }

        /// <summary>Layers of the transformer.</summary>
        public int Layers { get; }

        /// <summary>Decoded pictures per latent.</summary>
        public int PicturesPerLatent { get; }

        /// <summary>Window of local layers, in latents.</summary>
        public int LocalWindow { get; }

        /// <summary>Window of global layers, in latents, as loaded.</summary>
        public int GlobalWindow { get; }

        /// <summary>The widest global window that the bundle allows.</summary>
        public int MaxGlobalWindow { get; }

        /// <summary>Global windows are multiples of this.</summary>
        public int GlobalDilation { get; }

        /// <summary>Latents per second of world time for which the model was made.</summary>
        public int LatentsPerSecond { get; }

        /// <summary>Number of keys that it knows: virtual-key codes from 0 to this minus 1.</summary>
        public int Keys { get; }

        /// <summary>Slices of the transformer.</summary>
        public int Slices { get; }

        /// <summary>Time of the longest slice in microseconds, as measured at load; 0 if no number of slices had to be chosen.</summary>
        public long LongestSliceUs { get; }
    }

    /// <summary>Memory in bytes of a world and one rollout, as computed before loading.</summary>
    public struct WorldMemory
    {
        private readonly Native.world_memory from;

        internal WorldMemory(Native.world_memory from)
        {
            this.from = from;
        }

        /// <summary>The bundle's files, while they are loaded.</summary>
        public long Bundle
        {
            get { return (long)from.bundle; }
        }

        /// <summary>Weights as ONNX Runtime holds them, and those that are kept in the host's memory for noise levels not seen yet.</summary>
        public long Weights
        {
            get { return (long)from.weights; }
        }

        /// <summary>Keys and values of one rollout's ring. Each further rollout needs this, the slabs, and a part of the intermediates.</summary>
        public long Ring
        {
            get { return (long)from.ring; }
        }

        /// <summary>Keys and values of the current latent.</summary>
        public long Slabs
        {
            get { return (long)from.slabs; }
        }

        /// <summary>Intermediate tensors of a pass, and the largest matrix that a pass unpacks from 8 or 4 bits.</summary>
        public long Intermediates
        {
            get { return (long)from.intermediates; }
        }

        /// <summary>Intermediate tensors, pictures and state of encoder and decoder.</summary>
        public long Autoencoder
        {
            get { return (long)from.autoencoder; }
        }

        /// <summary>Additional memory held by ONNX Runtime's allocator.</summary>
        public long Arena
        {
            get { return (long)from.arena; }
        }

        /// <summary>The sum.</summary>
        public long Total
        {
            get { return (long)from.total; }
        }
    }

    /// <summary>Settings of a rollout. Defaults: the world's, with seed 0.</summary>
    public sealed class RolloutOptions
    {
        /// <summary>Seed of all noise: the same seed, world, device and controls give the same pictures, bit for bit.</summary>
        public ulong Seed { get; set; }

        /// <summary>Operating point as in <see cref="WorldOptions"/>, with the world's global window; null for the world's.</summary>
        public string OperatingPoint { get; set; }

        /// <summary>Maximum number of steps that wait, run, or have a result that was not taken, 1 to 64; 0 for 4.</summary>
        public int QueueCapacity { get; set; }
    }

    /// <summary>A loaded world. It may have any number of rollouts, which share its weights. May be used from any thread.</summary>
    public sealed unsafe class World : CairnObject
    {
        internal World(IntPtr value) : base(value, handle => Library.C.world_destroy(handle))
        {
        }

        /// <summary>Properties.</summary>
        public WorldInfo Info
        {
            get
            {
                var native = new Native.world_info { struct_size = (uint)sizeof(Native.world_info) };
                CheckResult(Library.C.world_get_info(Value, &native));
                return new WorldInfo(ref native);
            }
        }

        /// <summary>Memory needed with one rollout.</summary>
        public WorldMemory Memory
        {
            get
            {
                var native = new Native.world_memory { struct_size = (uint)sizeof(Native.world_memory) };
                CheckResult(Library.C.world_get_memory(Value, &native));
                return new WorldMemory(native);
            }
        }

        /// <summary>Text of its licence; empty if the bundle has none.</summary>
        public string LicenceText
        {
            get
            {
                IntPtr world = Value;
                string text = Text.Read((at, capacity, length) => Library.C.world_get_licence(world, at, capacity, length));
                GC.KeepAlive(this);
                return text;
            }
        }

        /// <summary>Starts an empty rollout. Append a seed picture first.</summary>
        /// <param name="options">Settings; null for the defaults.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/> with the numbers, <see cref="Result.Device"/>.
        /// </exception>
        public Rollout CreateRollout(RolloutOptions options = null)
        {
            options = options ?? new RolloutOptions();
            fixed (byte* operatingPoint = Text.Encode(options.OperatingPoint, nameof(options)))
            {
                var native = new Native.rollout_options
                {
                    struct_size = (uint)sizeof(Native.rollout_options),
                    queue_capacity = Check.NotNegative(options.QueueCapacity, nameof(options)),
                    seed = options.Seed,
                    operating_point = operatingPoint,
                };
                IntPtr rollout = IntPtr.Zero;
                int result = CheckResult(Library.C.rollout_create(Value, &native, &rollout));
                return new Rollout(CheckCreated(result, ref rollout));
            }
        }
    }
}
