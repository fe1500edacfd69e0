using System;
using System.Collections.Generic;
using System.Linq;

namespace Cairn.Tests
{
    /// <summary>Guidance and presenters on the processor.</summary>
    internal static class PresenterTests
    {
        private const long Second = 1000000000;
        private const int Width = 160;
        private const int Height = 96;

        /// <summary>A picture with texture, shifted to the right.</summary>
        private static byte[] Moved(int by)
        {
            var noise = new Random(1);
            var blocks = new byte[Width / 8 * (Height / 8) * 3];
            noise.NextBytes(blocks);
            var pixels = new byte[Width * Height * 4];
            for (int y = 0; y < Height; y++)
            {
                for (int x = 0; x < Width; x++)
                {
                    int block = y / 8 * (Width / 8) + (x - by + Width) % Width / 8;
                    for (int colour = 0; colour < 3; colour++) pixels[(y * Width + x) * 4 + colour] = blocks[block * 3 + colour];
                    pixels[(y * Width + x) * 4 + 3] = 255;
                }
            }
            return pixels;
        }

        private static Anchor Number(int i)
        {
            return Anchor.FromPicture(new PictureView(Moved(4 * i), Width, Height), i);
        }

        /// <summary>Mean difference of colours, without the borders, where new content appears.</summary>
        private static double Difference(byte[] one, byte[] other)
        {
            double sum = 0;
            var count = 0;
            for (int y = 16; y < Height - 16; y++)
            {
                for (int x = 16 * 4; x < (Width - 16) * 4; x++)
                {
                    if (x % 4 == 3) continue;
                    sum += Math.Abs(one[y * Width * 4 + x] - other[y * Width * 4 + x]);
                    count++;
                }
            }
            return sum / count;
        }

        [Test]
        private static void FramesAreGeneratedBetweenAnchors()
        {
            var shown = new List<byte[]>();
            var sources = new List<FrameSource>();
            using (var presenter = new Presenter(new PresenterOptions { Multiplier = 4, IntervalNs = Second }))
            {
                Frame frame;
                var pixels = new byte[Width * Height * 4];
                Expect.True(!presenter.TryQuery(0, out frame) && !presenter.TryDraw(0, new PictureTarget(pixels, Width, Height), out frame), "a frame of nothing");
                for (int quarter = 0; quarter <= 12; quarter++)
                {
                    long now = quarter * Second / 4;
                    if (quarter % 4 == 0)
                    {
                        using (Anchor anchor = Number(quarter / 4)) Expect.True(presenter.TryPush(anchor, now), "the presenter is full");
                    }
                    if (quarter < 4) continue;
                    pixels = new byte[Width * Height * 4];
                    Expect.True(presenter.TryDraw(now, new PictureTarget(pixels, Width, Height), out frame), "no frame");
                    Frame due;
                    Expect.True(presenter.TryQuery(now, out due) && due.Position == frame.Position && due.Source == frame.Source, "another frame was due");
                    Expect.Equal(quarter - 4L, frame.Position);
                    Expect.True(frame.SinceNs <= now && now < frame.UntilNs && !frame.IsCut, "it was not due");
                    shown.Add(pixels);
                    sources.Add(frame.Source);
                }
                PresenterStatistics statistics = presenter.Statistics;
                Expect.Equal("cpu", statistics.Generator);
                Expect.True(statistics.Anchors == 4 && statistics.ShownGenerated == 6, $"{statistics.Anchors} anchors, {statistics.ShownGenerated} frames");
            }
            for (int i = 0; i < sources.Count; i++) Expect.Equal(i % 4 == 0 ? FrameSource.Anchor : FrameSource.Generated, sources[i], $"frame {i}");
            Expect.Same(Moved(0), shown[0], "the first anchor and its frame");
            Expect.Same(Moved(4), shown[4], "the second anchor and its frame");
            // Halfway it has moved two pixels, and the frame is closer to that than either anchor is.
            double error = Difference(shown[2], Moved(2));
            double nearest = Math.Min(Difference(Moved(0), Moved(2)), Difference(Moved(4), Moved(2)));
            Expect.True(error < 0.5 * nearest, $"{error}, and the nearer anchor {nearest}");
        }

        internal static byte[] HalfWay()
        {
            var pixels = new byte[Width * Height * 4];
            using (var presenter = new Presenter(new PresenterOptions { Multiplier = 4, IntervalNs = Second }))
            {
                for (int i = 0; i < 2; i++)
                {
                    using (Anchor anchor = Number(i)) Expect.True(presenter.TryPush(anchor, i * Second), "the presenter is full");
                }
                Frame frame;
                Expect.True(presenter.TryDraw(3 * Second / 2, new PictureTarget(pixels, Width, Height), out frame), "no frame");
                Expect.Equal(FrameSource.Generated, frame.Source);
            }
            return pixels;
        }

        [Test]
        private static void AWorldIsShownAtFourTimesItsRate()
        {
            WorldInfo world = Shared.World.Info;
            var sources = new HashSet<FrameSource>();
            using (Rollout rollout = Shared.Rollout())
            using (var presenter = new Presenter(new PresenterOptions { Multiplier = 4, Width = 256, Height = 256, Letterbox = true, NoDecoded = true }))
            {
                var pixels = new byte[256 * 256 * 4];
                long interval = Second / world.LatentsPerSecond;
                for (int latent = 0; latent < 4; latent++)
                {
                    rollout.Step(new Controls(Key.W));
                    using (Anchor anchor = rollout.Anchor()) Expect.True(presenter.TryPush(anchor, latent * interval), "the presenter is full");
                    for (int quarter = 0; quarter < 4; quarter++)
                    {
                        Frame frame;
                        Expect.True(presenter.TryDraw(latent * interval + quarter * interval / 4, new PictureTarget(pixels, 256, 256), out frame), "no frame");
                        sources.Add(frame.Source);
                    }
                }
                Expect.Equal("spatial", presenter.Statistics.Upscaler);
                Expect.True(pixels[0] == 0 && pixels[3] == 255 && pixels.Skip(128 * 256 * 4).Take(1024).Any(value => value > 0 && value < 255), "no letterbox");
            }
            Expect.True(sources.Contains(FrameSource.Anchor) && sources.Contains(FrameSource.Generated), string.Join(", ", sources));
        }

        [Test]
        private static void MotionIsFoundBetweenTwoPictures()
        {
            using (Anchor first = Number(0))
            using (Anchor second = Number(1))
            using (Guidance guidance = Guidance.OfAnchors(first, second))
            {
                Expect.True(guidance.Info.Width == Width && guidance.Info.Height == Height, "another size");
                var motion = new ushort[Width * Height * 2];
                var depth = new float[Width * Height];
                guidance.ReadMotion(motion);
                guidance.ReadDepth(depth);
                // The content moved to the right, so the motion to the previous picture points left: -4 as a half float.
                int[] middle = Enumerable.Range(40 * Width + 40, 80).Select(pixel => (int)motion[pixel * 2]).ToArray();
                Array.Sort(middle);
                Expect.True(Math.Abs(middle[40] - 0xc400) < 0x80, $"{middle[40]:x}");
                Expect.Fails(Result.InvalidArgument, () => guidance.ReadDepth(new float[4]));
                Expect.Fails(Result.InvalidArgument, () => Guidance.OfAnchors(first, second, MotionSource.Paper));
                using (Guidance own = Guidance.OfEngine(motion, depth, Width, Height, DepthKind.Inverted, new GuidanceCamera(0.5f, 50, 1)))
                {
                    var back = new ushort[motion.Length];
                    own.ReadMotion(back);
                    Expect.True(back.SequenceEqual(motion), "motion changed on its way");
                    var turned = new float[depth.Length];
                    own.ReadDepth(turned);
                    Expect.True(Enumerable.Range(0, depth.Length).All(i => Math.Abs(turned[i] - (1 - depth[i])) < 1e-6), "depth was not turned over");
                    GuidanceInfo info = own.Info;
                    Expect.True(info.NearPlane == 0.5f && info.FarPlane == 50 && info.VerticalFov == 1, "another camera");
                    using (var presenter = new Presenter(new PresenterOptions { IntervalNs = Second }))
                    {
                        Expect.True(presenter.TryPush(first, 0) && presenter.TryPush(second, Second, own), "the presenter is full");
                    }
                }
                using (Guidance still = Guidance.OfEngine(motion, ReadOnlySpan<float>.Empty, Width, Height)) Expect.Equal(Width, still.Info.Width);
                Expect.Fails(Result.InvalidArgument, () => Guidance.OfEngine(motion, depth, Width, Height + 1));
            }
        }

        [Test]
        private static void InvalidPresenterCallsFail()
        {
            Expect.Fails(Result.InvalidArgument, () => new Presenter(new PresenterOptions { Multiplier = 5 }));
            Expect.Throws<ArgumentOutOfRangeException>(() => new Presenter(new PresenterOptions { DelayNs = -1 }));
            using (var presenter = new Presenter())
            using (Anchor anchor = Number(0))
            {
                // With neither a rate nor an interval.
                Expect.Fails(Result.InvalidArgument, () => presenter.TryPush(anchor, 0));
            }
            using (var presenter = new Presenter(new PresenterOptions { IntervalNs = Second, Capacity = 1, ColourSpace = ColourSpace.Linear }))
            using (Anchor first = Number(0))
            {
                Expect.True(presenter.TryPush(first, 0), "the presenter is full");
                var more = 0;
                for (bool taken = true; taken && more < 5; more++)
                {
                    using (Anchor next = Number(more + 1)) taken = presenter.TryPush(next, 0);
                }
                Expect.True(more < 5, "it takes more than it has room for");
                Frame frame;
                Expect.Fails(Result.InvalidArgument, () => presenter.TryDraw(0, new PictureTarget(new byte[Width * Height * 4], Width, Height), out frame));
                var halves = new byte[Width * Height * 8];
                Expect.True(presenter.TryDraw(Second, new PictureTarget(halves, Width, Height, PixelFormat.Rgba16F), out frame), "no frame");
                presenter.SetOverlay(new byte[Width * Height], Width, Height);
                presenter.SetOverlay(ReadOnlySpan<byte>.Empty, 0, 0);
                Expect.Fails(Result.InvalidArgument, () => presenter.SetOverlay(new byte[4], 2, 2));
                Expect.Fails(Result.InvalidArgument, () => presenter.Resize(0, 5));
                presenter.Resize(80, 48);
                Expect.True(presenter.TryDraw(Second, new PictureTarget(new byte[80 * 48 * 8], 80, 48, PixelFormat.Rgba16F), out frame), "no frame");
                presenter.SetBudget(Second);
                presenter.Reset();
                Expect.True(!presenter.TryQuery(Second, out frame), "it forgot nothing");
            }
        }
    }
}
