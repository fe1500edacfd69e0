using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Properties of an anchor.</summary>
    public struct AnchorInfo
    {
        private readonly Native.anchor_info from;

        internal AnchorInfo(Native.anchor_info from)
        {
            this.from = from;
        }

        /// <summary>
        /// There is no motion from the previous anchor to this one: it is the first of a rollout, the first after a reset or a restored
        /// state, or a picture that was appended.
        /// </summary>
        public bool IsCut
        {
            get { return (from.flags & Native.ANCHOR_CUT) != 0; }
        }

        /// <summary>Number of its latent in the rollout, from 0.</summary>
        public long Latent
        {
            get { return (long)from.latent; }
        }

        /// <summary>Latents per second of world time; 0 for a picture of your own.</summary>
        public int LatentsPerSecond
        {
            get { return (int)from.latents_per_second; }
        }

        /// <summary>Number of pictures. They are in order of time; the last is the anchor itself.</summary>
        public int Pictures
        {
            get { return (int)from.pictures; }
        }

        /// <summary>Width of its pictures, in square pixels.</summary>
        public int Width
        {
            get { return (int)from.width; }
        }

        /// <summary>Height of its pictures.</summary>
        public int Height
        {
            get { return (int)from.height; }
        }

        /// <summary>Channels of its latent; 0 if it has none.</summary>
        public int LatentChannels
        {
            get { return (int)from.latent_channels; }
        }

        /// <summary>Rows of its latent.</summary>
        public int LatentHeight
        {
            get { return (int)from.latent_height; }
        }

        /// <summary>Columns of its latent.</summary>
        public int LatentWidth
        {
            get { return (int)from.latent_width; }
        }
    }

    /// <summary>An anchor: an immutable copy, independent of its rollout. May be used from any thread.</summary>
    public sealed unsafe class Anchor : CairnObject
    {
        internal Anchor(IntPtr value) : base(value, handle => Library.C.anchor_destroy(handle))
        {
        }

        /// <summary>Makes an anchor from a picture of your own, for frame generation without a world. The picture is copied.</summary>
        /// <param name="picture">Four bytes per pixel.</param>
        /// <param name="number">Increases by one from anchor to anchor.</param>
        /// <param name="cut">Whether there is no motion from the previous anchor to this one.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public static Anchor FromPicture(PictureView picture, long number, bool cut = false)
        {
            fixed (byte* pixels = &MemoryMarshal.GetReference(picture.Pixels))
            {
                Native.picture native = picture.At(pixels);
                IntPtr anchor = IntPtr.Zero;
                uint flags = cut ? (uint)Native.ANCHOR_CUT : 0;
                int result = Library.C.anchor_create(&native, Check.NotNegative(number, nameof(number)), flags, &anchor);
                return new Anchor(CheckCreated(result, ref anchor));
            }
        }

        /// <summary>Properties.</summary>
        public AnchorInfo Info
        {
            get
            {
                var native = new Native.anchor_info { struct_size = (uint)sizeof(Native.anchor_info) };
                CheckResult(Library.C.anchor_get_info(Value, &native));
                return new AnchorInfo(native);
            }
        }

        /// <summary>Copies one of its pictures into your memory.</summary>
        /// <param name="index">0 to <see cref="AnchorInfo.Pictures"/> less one, in order of time.</param>
        /// <param name="target">Must have the anchor's size.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>; no pixel is written then.</exception>
        public void ReadPicture(int index, PictureTarget target)
        {
            fixed (byte* pixels = &MemoryMarshal.GetReference(target.Pixels))
            {
                Native.target native = target.At(pixels);
                CheckResult(Library.C.anchor_read_picture(Value, Check.NotNegative(index, nameof(index)), &native));
            }
        }

        /// <summary>One of its pictures in new memory, without gaps between rows.</summary>
        /// <param name="index">In order of time; a negative index counts from the end. The last is the anchor itself.</param>
        /// <param name="format">Pixel format of the copy.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>.</exception>
        public byte[] Picture(int index = -1, PixelFormat format = PixelFormat.Rgba8)
        {
            AnchorInfo info = Info;
            var pixels = new byte[checked(info.Width * info.Height * (format == PixelFormat.Rgba16F ? 8 : 4))];
            ReadPicture(index < 0 ? index + info.Pictures : index, new PictureTarget(pixels, info.Width, info.Height, format));
            return pixels;
        }

        /// <summary>Copies its latent: [channels, rows, columns], the last varying fastest.</summary>
        /// <param name="values">Must have exactly that length.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.Unsupported"/> for a picture of your own; <see cref="Result.InvalidArgument"/>.
        /// </exception>
        public void ReadLatent(Span<float> values)
        {
            fixed (float* at = &MemoryMarshal.GetReference(values))
            {
                CheckResult(Library.C.anchor_read_latent(Value, at, (UIntPtr)values.Length));
            }
        }

        /// <summary>Its latent in new memory: [channels, rows, columns], the last varying fastest.</summary>
        /// <exception cref="CairnException"><see cref="Result.Unsupported"/> for a picture of your own.</exception>
        public float[] Latent()
        {
            AnchorInfo info = Info;
            var values = new float[info.LatentChannels * info.LatentHeight * info.LatentWidth];
            ReadLatent(values);
            return values;
        }
    }
}
