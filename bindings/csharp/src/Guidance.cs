using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Source of motion.</summary>
    public enum MotionSource
    {
        /// <summary>The source with the best scores.</summary>
        Auto = Native.MOTION_AUTO,
        /// <summary>Dense optical flow between the two pictures.</summary>
        Pictures = Native.MOTION_PICTURES,
        /// <summary>The two latents, by the paper's method. Only anchors of a world have latents.</summary>
        Paper = Native.MOTION_PAPER,
        /// <summary>Matching of cells of the two latents. Only anchors of a world have latents.</summary>
        Latents = Native.MOTION_LATENTS,
    }

    /// <summary>Kind of your own depth values.</summary>
    public enum DepthKind
    {
        /// <summary>Device depth, 0 near and 1 far.</summary>
        Device = 0,
        /// <summary>Device depth, 1 near and 0 far.</summary>
        Inverted = Native.DEPTH_INVERTED,
        /// <summary>Distance along the view axis, in the units of the near plane.</summary>
        Linear = Native.DEPTH_LINEAR,
    }

    /// <summary>Properties of guidance.</summary>
    public struct GuidanceInfo
    {
        private readonly Native.guidance_info from;

        internal GuidanceInfo(Native.guidance_info from)
        {
            this.from = from;
        }

        /// <summary>In pixels.</summary>
        public int Width
        {
            get { return (int)from.width; }
        }

        /// <summary>In pixels.</summary>
        public int Height
        {
            get { return (int)from.height; }
        }

        /// <summary>Distance of the near plane.</summary>
        public float NearPlane
        {
            get { return (float)from.near_plane; }
        }

        /// <summary>Distance of the far plane; may be infinite.</summary>
        public float FarPlane
        {
            get { return (float)from.far_plane; }
        }

        /// <summary>Vertical field of view in radians.</summary>
        public float VerticalFov
        {
            get { return (float)from.vertical_fov; }
        }
    }

    /// <summary>Planes and field of view of the camera of a picture. Defaults: 0.1, 100 and 60 degrees.</summary>
    public struct GuidanceCamera
    {
        /// <summary>A camera.</summary>
        /// <param name="nearPlane">Above 0.</param>
        /// <param name="farPlane">Above the near plane; may be infinite.</param>
        /// <param name="verticalFov">In radians, inside (0, pi).</param>
        public GuidanceCamera(float nearPlane, float farPlane, float verticalFov)
        {
            NearPlane = nearPlane;
            FarPlane = farPlane;
            VerticalFov = verticalFov;
        }

        /// <summary>Distance of the near plane.</summary>
        public float NearPlane { get; }

        /// <summary>Distance of the far plane.</summary>
        public float FarPlane { get; }

        /// <summary>Vertical field of view in radians.</summary>
        public float VerticalFov { get; }
    }

    /// <summary>
    /// Motion and depth of a pair of anchors, at the anchors' size. Immutable; may be used from any thread.
    /// </summary>
    /// <remarks>
    /// Motion is in pixels: x and y as two half floats per pixel, stored at the current anchor's pixels and pointing from the current anchor
    /// to the previous one, y down. Depth is the current anchor's device depth, 0 near and 1 far. Half floats are given as their bits.
    /// </remarks>
    public sealed unsafe class Guidance : CairnObject
    {
        private Guidance(IntPtr value) : base(value, handle => Library.C.guidance_destroy(handle))
        {
        }

        /// <summary>
        /// Extracts motion and depth of two anchors. A presenter does this itself; use this to do it earlier or to inspect the result.
        /// </summary>
        /// <param name="previous">The anchor before.</param>
        /// <param name="current">Of the same size.</param>
        /// <param name="source">Source of motion.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public static Guidance OfAnchors(Anchor previous, Anchor current, MotionSource source = MotionSource.Auto)
        {
            IntPtr first = Check.NotNull(previous, nameof(previous)).Value;
            IntPtr second = Check.NotNull(current, nameof(current)).Value;
            IntPtr guidance = IntPtr.Zero;
            int result = Library.C.guidance_create(first, second, (uint)source, &guidance);
            GC.KeepAlive(previous);
            GC.KeepAlive(current);
            return new Guidance(CheckCreated(result, ref guidance));
        }

        /// <summary>Makes guidance from your own motion and depth, for example an engine's; both are copied.</summary>
        /// <param name="motion">Two half floats per pixel, row by row. Values that are not finite count as 0.</param>
        /// <param name="depth">One value per pixel, row by row; empty if there is none.</param>
        /// <param name="width">In pixels, the anchors'.</param>
        /// <param name="height">In pixels, the anchors'.</param>
        /// <param name="kind">Kind of the depth values.</param>
        /// <param name="camera">Camera of the picture.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public static Guidance OfEngine(
            ReadOnlySpan<ushort> motion, ReadOnlySpan<float> depth, int width, int height, DepthKind kind = DepthKind.Device,
            GuidanceCamera camera = default(GuidanceCamera))
        {
            fixed (ushort* vectors = &MemoryMarshal.GetReference(motion))
            fixed (float* distances = &MemoryMarshal.GetReference(depth))
            {
                var data = new Native.guidance_data
                {
                    struct_size = (uint)sizeof(Native.guidance_data),
                    flags = (uint)kind,
                    width = Check.NotNegative(width, nameof(width)),
                    height = Check.NotNegative(height, nameof(height)),
                    motion = vectors,
                    motion_count = (ulong)motion.Length,
                    depth = distances,
                    depth_count = (ulong)depth.Length,
                    near_plane = camera.NearPlane,
                    far_plane = camera.FarPlane,
                    vertical_fov = camera.VerticalFov,
                };
                IntPtr guidance = IntPtr.Zero;
                return new Guidance(CheckCreated(Library.C.guidance_create_from_host(&data, &guidance), ref guidance));
            }
        }

        /// <summary>Properties.</summary>
        public GuidanceInfo Info
        {
            get
            {
                var native = new Native.guidance_info { struct_size = (uint)sizeof(Native.guidance_info) };
                CheckResult(Library.C.guidance_get_info(Value, &native));
                return new GuidanceInfo(native);
            }
        }

        /// <summary>Copies the motion: two half floats per pixel, row by row.</summary>
        /// <param name="values">Must have exactly that length.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/> for another length.</exception>
        public void ReadMotion(Span<ushort> values)
        {
            fixed (ushort* at = &MemoryMarshal.GetReference(values))
            {
                CheckResult(Library.C.guidance_read_motion(Value, at, (UIntPtr)values.Length));
            }
        }

        /// <summary>Copies the depth: one value per pixel, row by row.</summary>
        /// <param name="values">Must have exactly that length.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/> for another length.</exception>
        public void ReadDepth(Span<float> values)
        {
            fixed (float* at = &MemoryMarshal.GetReference(values))
            {
                CheckResult(Library.C.guidance_read_depth(Value, at, (UIntPtr)values.Length));
            }
        }
    }
}
