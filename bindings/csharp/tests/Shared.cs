using System;

namespace Cairn.Tests
{
    /// <summary>Objects shared by the tests of a world, which is loaded once.</summary>
    internal static class Shared
    {
        private static Device device;
        private static World world;

        internal const int Width = 128;
        internal const int Height = 72;

        internal static Device Device
        {
            get { return device ?? (device = Cairn.Device.Cpu(new DeviceOptions { Threads = 2 })); }
        }

        /// <summary>The embedded world.</summary>
        internal static World World
        {
            get { return world ?? (world = Device.LoadWorld()); }
        }

        /// <summary>A picture with colour and edges.</summary>
        internal static byte[] Pattern(int width = Width, int height = Height, int shift = 0)
        {
            var pixels = new byte[width * height * 4];
            for (int y = 0; y < height; y++)
            {
                for (int x = 0; x < width; x++)
                {
                    int from = x - shift;
                    int at = (y * width + x) * 4;
                    pixels[at] = (byte)(from * 255 / width);
                    pixels[at + 1] = (byte)(y * 255 / height);
                    pixels[at + 2] = (byte)((from / 8 + y / 8) % 2 * 200);
                    pixels[at + 3] = 255;
                }
            }
            return pixels;
        }

        internal static PictureView Seed()
        {
            return new PictureView(Pattern(), Width, Height);
        }

        /// <summary>A rollout of the world with its seed picture appended.</summary>
        internal static Rollout Rollout(ulong seed = 7, int queue = 0)
        {
            Rollout rollout = World.CreateRollout(new RolloutOptions { Seed = seed, QueueCapacity = queue });
            rollout.Append(Seed());
            return rollout;
        }

        internal static readonly Controls[] Walk =
        {
            new Controls(Key.W) { MouseX = 3, MouseY = -1 }, new Controls(Key.W, Key.Shift), new Controls { Scroll = 1 },
        };

        /// <summary>The picture after each step of a walk.</summary>
        internal static byte[][] Shown(Controls[] walk, ulong seed = 7)
        {
            var pictures = new byte[walk.Length][];
            using (Rollout rollout = Rollout(seed))
            {
                for (int i = 0; i < walk.Length; i++)
                {
                    rollout.Step(walk[i]);
                    using (Anchor anchor = rollout.Anchor()) pictures[i] = anchor.Picture();
                }
            }
            return pictures;
        }
    }
}
