using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Pixel format.</summary>
    public enum PixelFormat
    {
        /// <summary>Four bytes per pixel, RGBA; display-referred sRGB, straight alpha.</summary>
        Rgba8 = Native.FORMAT_RGBA8,
        /// <summary>Four bytes per pixel, BGRA.</summary>
        Bgra8 = Native.FORMAT_BGRA8,
        /// <summary>Four half floats per pixel, RGBA; for targets only.</summary>
        Rgba16F = Native.FORMAT_RGBA16F,
        /// <summary>Four bytes per pixel: ten bits each of red (lowest), green and blue, two of alpha; for targets only.</summary>
        Rgb10A2 = Native.FORMAT_RGB10A2,
    }

    /// <summary>
    /// A picture in your memory, which is read during the call only: rows from top to bottom, in a span, an array or native memory.
    /// </summary>
    public ref struct PictureView
    {
        /// <summary>A picture.</summary>
        /// <param name="pixels">The pixels, the top left one first.</param>
        /// <param name="width">In pixels, 1 to 16384.</param>
        /// <param name="height">In pixels, 1 to 16384.</param>
        /// <param name="format"><see cref="PixelFormat.Rgba8"/> or <see cref="PixelFormat.Bgra8"/>.</param>
        /// <param name="rowPitch">Bytes from one row to the next; 0 for rows without a gap.</param>
        public PictureView(ReadOnlySpan<byte> pixels, int width, int height, PixelFormat format = PixelFormat.Rgba8, int rowPitch = 0)
        {
            Pixels = pixels;
            Width = width;
            Height = height;
            Format = format;
            RowPitch = rowPitch;
        }

        /// <summary>The pixels, the top left one first.</summary>
        public ReadOnlySpan<byte> Pixels { get; }

        /// <summary>In pixels.</summary>
        public int Width { get; }

        /// <summary>In pixels.</summary>
        public int Height { get; }

        /// <summary>Pixel format.</summary>
        public PixelFormat Format { get; }

        /// <summary>Bytes from one row to the next; 0 for rows without a gap.</summary>
        public int RowPitch { get; }

        /// <summary>The library's struct; the caller has pinned the pixels.</summary>
        internal unsafe Native.picture At(byte* pixels)
        {
            return new Native.picture
            {
                struct_size = (uint)sizeof(Native.picture),
                format = (uint)Format,
                width = Check.NotNegative(Width, "width"),
                height = Check.NotNegative(Height, "height"),
                pixels = pixels,
                size = (ulong)Pixels.Length,
                row_pitch = Check.NotNegative(RowPitch, "rowPitch"),
            };
        }
    }

    /// <summary>
    /// Your memory into which a picture is written during the call only. Bytes between rows are not changed.
    /// </summary>
    public ref struct PictureTarget
    {
        /// <summary>Memory for a picture.</summary>
        /// <param name="pixels">Memory for the pixels, the top left one first.</param>
        /// <param name="width">In pixels; must be the picture's width.</param>
        /// <param name="height">In pixels; must be the picture's height.</param>
        /// <param name="format">Pixel format to write.</param>
        /// <param name="rowPitch">Bytes from one row to the next; 0 for rows without a gap.</param>
        public PictureTarget(Span<byte> pixels, int width, int height, PixelFormat format = PixelFormat.Rgba8, int rowPitch = 0)
        {
            Pixels = pixels;
            Width = width;
            Height = height;
            Format = format;
            RowPitch = rowPitch;
        }

        /// <summary>Memory for the pixels, the top left one first.</summary>
        public Span<byte> Pixels { get; }

        /// <summary>In pixels.</summary>
        public int Width { get; }

        /// <summary>In pixels.</summary>
        public int Height { get; }

        /// <summary>Pixel format to write.</summary>
        public PixelFormat Format { get; }

        /// <summary>Bytes from one row to the next; 0 for rows without a gap.</summary>
        public int RowPitch { get; }

        /// <summary>The library's struct; the caller has pinned the pixels.</summary>
        internal unsafe Native.target At(byte* pixels)
        {
            return new Native.target
            {
                struct_size = (uint)sizeof(Native.target),
                format = (uint)Format,
                width = Check.NotNegative(Width, "width"),
                height = Check.NotNegative(Height, "height"),
                pixels = pixels,
                size = (ulong)Pixels.Length,
                row_pitch = Check.NotNegative(RowPitch, "rowPitch"),
            };
        }
    }
}
