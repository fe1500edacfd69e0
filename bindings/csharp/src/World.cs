using System;

namespace Cairn
{
    /// <summary>What a world is. Sizes are in pixels, windows in latents.</summary>
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
            fixed (byte* name = from.name) Name = Text.Decode(name, 128);
            fixed (byte* licence = from.licence) Licence = Text.Decode(licence, 64);
            fixed (byte* digest = from.digest) Digest = Text.Decode(digest, 72);
        }

        /// <summary>Its name, for people.</summary>
        public string Name { get; }

        /// <summary>Its licence as an SPDX expression; <see cref="World.LicenceText"/> is the text.</summary>
        public string Licence { get; }

        /// <summary>The bundle's identity: SHA-256 of its manifest, in hexadecimal.</summary>
        public string Digest { get; }

        /// <summary>What the graphs compute in.</summary>
        public Precision Precision { get; }

        /// <summary>Width of the pictures that anchors have, in square pixels.</summary>
        public int RenderWidth { get; }

        /// <summary>Height of the pictures that anchors have.</summary>
        public int RenderHeight { get; }

        /// <summary>Width of the pictures as the autoencoder makes them, which may be squeezed.</summary>
        public int DecodedWidth { get; }

        /// <summary>Height of the pictures as the autoencoder makes them.</summary>
        public int DecodedHeight { get; }

        /// <summary>Channels of a latent.</summary>
        public int LatentChannels { get; }

        /// <summary>Rows of a latent.</summary>
        public int LatentHeight { get; }

        /// <summary>Columns of a latent.</summary>
        public int LatentWidth { get; }

        /// <summary>Tokens of a latent.</summary>
        public int Tokens { get; }

        /// <summary>Layers of the transformer.</summary>
        public int Layers { get; }

        /// <summary>Pictures that a latent decodes to.</summary>
        public int PicturesPerLatent { get; }

        /// <summary>Latents that a local layer remembers.</summary>
        public int LocalWindow { get; }

        /// <summary>Latents that a global layer looks back over, as loaded.</summary>
        public int GlobalWindow { get; }

        /// <summary>The widest global window that the bundle allows.</summary>
        public int MaxGlobalWindow { get; }

        /// <summary>Global windows are multiples of this.</summary>
        public int GlobalDilation { get; }

        /// <summary>Latents per second of world time that the model was made for.</summary>
        public int LatentsPerSecond { get; }

        /// <summary>Keys that it knows: virtual-key codes from 0 to this, less one.</summary>
        public int Keys { get; }
    }

    /// <summary>Bytes that a world and one rollout need, as was found before loading.</summary>
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

        /// <summary>Weights as ONNX Runtime holds them.</summary>
        public long Weights
        {
            get { return (long)from.weights; }
        }

        /// <summary>Keys and values of one rollout's ring: what each further rollout takes, with the slabs.</summary>
        public long Ring
        {
            get { return (long)from.ring; }
        }

        /// <summary>Keys and values of the current latent.</summary>
        public long Slabs
        {
            get { return (long)from.slabs; }
        }

        /// <summary>Intermediate values of a pass.</summary>
        public long Intermediates
        {
            get { return (long)from.intermediates; }
        }

        /// <summary>Intermediate values, pictures and memories of encoder and decoder.</summary>
        public long Autoencoder
        {
            get { return (long)from.autoencoder; }
        }

        /// <summary>What ONNX Runtime's allocator keeps beyond the values.</summary>
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

    /// <summary>How a rollout runs. As it is made: as its world, with seed 0.</summary>
    public sealed class RolloutOptions
    {
        /// <summary>Decides all noise: the same seed, world, device and controls give the same pictures, bit for bit.</summary>
        public ulong Seed { get; set; }

        /// <summary>As in <see cref="WorldOptions"/>, with the world's global window; null for the world's.</summary>
        public string OperatingPoint { get; set; }

        /// <summary>Steps that may wait, run, or be done and not asked for, 1 to 64; 0 for 4.</summary>
        public int QueueCapacity { get; set; }
    }

    /// <summary>A loaded world. It may have any number of rollouts, which share its weights. May be used from any thread.</summary>
    public sealed unsafe class World : CairnObject
    {
        internal World(IntPtr value) : base(value, handle => Library.C.world_destroy(handle))
        {
        }

        /// <summary>What it is.</summary>
        public WorldInfo Info
        {
            get
            {
                var native = new Native.world_info { struct_size = (uint)sizeof(Native.world_info) };
                Done(Library.C.world_get_info(Value, &native));
                return new WorldInfo(ref native);
            }
        }

        /// <summary>How much memory it needs with one rollout.</summary>
        public WorldMemory Memory
        {
            get
            {
                var native = new Native.world_memory { struct_size = (uint)sizeof(Native.world_memory) };
                Done(Library.C.world_get_memory(Value, &native));
                return new WorldMemory(native);
            }
        }

        /// <summary>The text of its licence; empty where the bundle has none.</summary>
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

        /// <summary>Starts a rollout, empty: the first thing to do is to append a seed picture.</summary>
        /// <param name="options">How it runs; null for the defaults.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/> with figures, <see cref="Result.Device"/>.
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
                int result = Done(Library.C.rollout_create(Value, &native, &rollout));
                return new Rollout(Made(result, ref rollout));
            }
        }
    }
}
