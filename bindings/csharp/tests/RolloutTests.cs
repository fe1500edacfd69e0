using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Threading;

namespace Cairn.Tests
{
    /// <summary>Rollouts of the world inside the library.</summary>
    internal static class RolloutTests
    {
        [Test]
        private static void AWholeRolloutMakesAnchors()
        {
            WorldInfo world = Shared.World.Info;
            using (Rollout rollout = Shared.World.CreateRollout(new RolloutOptions { Seed = 7 }))
            {
                Expect.Fails(Result.InvalidArgument, () => rollout.Anchor());
                StepInfo seed = rollout.Append(Shared.Seed());
                Expect.True(seed.Latent == 0 && seed.IsCommitted && seed.EncodeNs > 0, "the seed is no latent");
                byte[] before = null;
                for (int number = 1; number <= world.LatentsPerSecond; number++)
                {
                    StepInfo step = rollout.Step(Shared.Walk[number % Shared.Walk.Length]);
                    Expect.True(step.Latent == number && step.DenoisePasses > 0 && step.DenoiseNs > 0, $"step {number} is {step.Latent}");
                    using (Anchor anchor = rollout.Anchor())
                    {
                        AnchorInfo info = anchor.Info;
                        Expect.True(info.Latent == number && !info.IsCut && info.Pictures == world.PicturesPerLatent, "another anchor");
                        Expect.True(info.Width == world.RenderWidth && info.Height == world.RenderHeight, "another size");
                        byte[] picture = anchor.Picture();
                        Expect.Equal(info.Width * info.Height * 4, picture.Length, "the picture's bytes");
                        Expect.True(before == null || !picture.AsSpan().SequenceEqual(before), "two anchors are the same");
                        Expect.True(picture.Distinct().Count() > 20, "a picture of nothing");
                        Expect.Same(picture, anchor.Picture(info.Pictures - 1), "the last picture and the anchor");
                        float[] latent = anchor.Latent();
                        Expect.Equal(world.LatentChannels * world.LatentHeight * world.LatentWidth, latent.Length, "the latent's numbers");
                        Expect.True(latent.All(value => !float.IsNaN(value) && !float.IsInfinity(value)) && latent.Max() > latent.Min(), "a latent of nothing");
                        before = picture;
                    }
                }
                Expect.Equal(world.LatentsPerSecond + 1L, rollout.Info.Latents);
                RolloutStatistics statistics = rollout.Statistics;
                Expect.True(statistics.Latents == rollout.Info.Latents && statistics.DenoiseNs > 0 && statistics.RingBytes > 0, "statistics of nothing");
            }
        }

        [Test]
        private static void FourPicturesAreOneLatent()
        {
            using (Rollout rollout = Shared.World.CreateRollout(new RolloutOptions { Seed = 7 }))
            using (Rollout still = Shared.World.CreateRollout(new RolloutOptions { Seed = 7 }))
            {
                StepInfo info = rollout.Append(Shared.Seed(), Shared.Seed(), Shared.Seed(), Shared.Seed());
                Expect.True(info.Latent == 0 && info.IsCommitted && info.EncodeNs > 0, "four pictures are no latent");
                still.Append(Shared.Seed());
                rollout.Rest();
                using (Anchor one = rollout.Anchor())
                using (Anchor other = still.Anchor())
                {
                    Expect.Same(one.Picture(), other.Picture(), "a still and the same picture four times");
                }
                Expect.True(rollout.TrySubmitPictures(Shared.Seed(), Shared.Seed(), Shared.Seed(), Shared.Seed(), out long ticket), "the queue is full");
                Expect.True(rollout.Wait(ticket, Timeout.InfiniteTimeSpan, out info, out Anchor made), "it does not end");
                made.Dispose();
                Expect.Equal(1L, info.Latent);
                rollout.KeepEncoderStream(false);
                Expect.Fails(Result.Unsupported, () => rollout.KeepEncoderStream(true));
            }
        }

        [Test]
        private static void EqualSeedsAndControlsGiveEqualPictures()
        {
            byte[][] first = Shared.Shown(Shared.Walk);
            byte[][] again = Shared.Shown(Shared.Walk);
            for (int i = 0; i < first.Length; i++) Expect.Same(first[i], again[i], "pictures of equal seeds");
            Expect.True(!first.Last().AsSpan().SequenceEqual(Shared.Shown(Shared.Walk, 8).Last()), "another seed shows the same");
            Expect.True(!first.Last().AsSpan().SequenceEqual(Shared.Shown(new Controls[3]).Last()), "other controls show the same");
        }

        [Test]
        private static void PicturesAreWrittenIntoPartsOfLargerMemory()
        {
            using (Anchor anchor = Anchor.FromPicture(Shared.Seed(), 3, cut: true))
            {
                Expect.True(anchor.Info.IsCut && anchor.Info.Latent == 3 && anchor.Info.LatentChannels == 0, "another anchor");
                byte[] picture = anchor.Picture();
                Expect.Same(Shared.Pattern(), picture, "the picture and what it was made of");
                const int Pitch = 200 * 4;
                var wall = new byte[Pitch * 100];
                for (int i = 0; i < wall.Length; i++) wall[i] = 9;
                anchor.ReadPicture(0, new PictureTarget(wall.AsSpan(10 * Pitch + 80), Shared.Width, Shared.Height, PixelFormat.Rgba8, Pitch));
                for (int y = 0; y < 100; y++)
                {
                    for (int x = 0; x < Pitch; x++)
                    {
                        bool inside = y >= 10 && y < 10 + Shared.Height && x >= 80 && x < 80 + Shared.Width * 4;
                        int wanted = inside ? picture[(y - 10) * Shared.Width * 4 + x - 80] : 9;
                        Expect.Equal(wanted, wall[y * Pitch + x], $"byte {x} of row {y}");
                    }
                }
                using (Anchor part = Anchor.FromPicture(new PictureView(wall.AsSpan(10 * Pitch + 80), Shared.Width, Shared.Height, PixelFormat.Rgba8, Pitch), 0))
                {
                    Expect.Same(picture, part.Picture(), "a part of a larger picture and the picture");
                }
                byte[] blue = anchor.Picture(format: PixelFormat.Bgra8);
                Expect.True(blue[0] == picture[2] && blue[1] == picture[1] && blue[2] == picture[0], "blue is not first");
                Expect.Equal(picture.Length * 2, anchor.Picture(format: PixelFormat.Rgba16F).Length, "bytes of half floats");
                Expect.Fails(Result.InvalidArgument, () => anchor.Picture(1));
                Expect.Fails(Result.InvalidArgument, () => anchor.ReadPicture(0, new PictureTarget(new byte[16], Shared.Width, Shared.Height)));
                Expect.Fails(Result.InvalidArgument, () => anchor.ReadPicture(0, new PictureTarget(Span<byte>.Empty, Shared.Width, Shared.Height)));
                Expect.Fails(Result.Unsupported, () => anchor.ReadLatent(new float[4]));
                Expect.Throws<ArgumentOutOfRangeException>(() => anchor.ReadPicture(0, new PictureTarget(wall, -1, 1)));
            }
            Expect.Fails(Result.InvalidArgument, () => Anchor.FromPicture(new PictureView(new byte[16], 0, 4), 0));
            Expect.Fails(Result.InvalidArgument, () => Anchor.FromPicture(new PictureView(new byte[16], 2, 3), 0));
        }

        [Test]
        private static void InvalidControlsLeaveTheRolloutUnchanged()
        {
            using (Rollout rollout = Shared.Rollout())
            {
                Expect.Fails(Result.InvalidArgument, () => rollout.Step(new Controls { MouseX = float.NaN }));
                Expect.Fails(Result.InvalidArgument, () => rollout.Step(new Controls { MouseY = 1e6f }));
                Expect.Equal(1L, rollout.Info.Latents);
            }
            Expect.Fails(Result.InvalidArgument, () => Shared.World.CreateRollout(new RolloutOptions { QueueCapacity = 65 }));
            Expect.Fails(Result.InvalidArgument, () => Shared.World.CreateRollout(new RolloutOptions { OperatingPoint = "nonsense" }));
        }

        [Test]
        private static void QueuedStepsGiveTheSameResults()
        {
            byte[][] expected = Shared.Shown(Shared.Walk);
            using (Rollout rollout = Shared.World.CreateRollout(new RolloutOptions { Seed = 7, QueueCapacity = 3 }))
            {
                long seed, first, second, none;
                Expect.True(rollout.TrySubmitPicture(Shared.Seed(), out seed), "the queue is full");
                Expect.True(rollout.TrySubmit(Shared.Walk[0], out first) && rollout.TrySubmit(Shared.Walk[1], out second), "the queue is full");
                Expect.True(!rollout.TrySubmit(Shared.Walk[2], out none), "the queue takes more than it has room for");
                StepInfo info;
                Anchor anchor;
                Expect.True(rollout.Wait(seed, Timeout.InfiniteTimeSpan, out info, out anchor) && info.Latent == 0, "no seed");
                anchor.Dispose();
                foreach (long ticket in new[] { first, first + 1 })
                {
                    Expect.True(rollout.Wait(ticket, TimeSpan.FromMinutes(2), out info, out anchor), "no result");
                    Expect.Same(expected[info.Latent - 1], anchor.Picture(), $"queued picture {info.Latent} and the step's");
                    anchor.Dispose();
                }
                Expect.Fails(Result.InvalidArgument, () => rollout.TryTake(first, out info, out anchor));
            }
        }

        [Test]
        private static void APausedQueueRunsSingleSteps()
        {
            using (Rollout rollout = Shared.Rollout())
            {
                Expect.Fails(Result.InvalidArgument, () => rollout.SingleStep());
                rollout.Pause();
                Expect.True(!rollout.SingleStep(), "there was a step");
                long first, second;
                StepInfo info;
                Anchor anchor;
                Expect.True(rollout.TrySubmit(new Controls(), out first) && rollout.TrySubmit(new Controls(), out second), "the queue is full");
                Expect.True(!rollout.Wait(first, TimeSpan.FromMilliseconds(20), out info, out anchor) && anchor == null, "a held queue went on");
                Expect.Fails(Result.Busy, () => rollout.Step());
                Expect.True(rollout.SingleStep() && rollout.Wait(first, Timeout.InfiniteTimeSpan, out info, out anchor), "no step");
                anchor.Dispose();
                Expect.True(!rollout.TryTake(first + 1, out info, out anchor), "two steps");
                rollout.Cancel();
                Expect.Fails(Result.Cancelled, () => rollout.Wait(first + 1, Timeout.InfiniteTimeSpan, out info, out anchor));
                rollout.Resume();
                rollout.Step();
                Expect.Throws<ArgumentOutOfRangeException>(() => rollout.Wait(first, TimeSpan.FromSeconds(-2), out info, out anchor));
            }
        }

        [Test]
        private static void ClosingARolloutEndsTheWaitOfAnotherThread()
        {
            Rollout rollout = Shared.Rollout();
            rollout.Pause();
            long ticket;
            Expect.True(rollout.TrySubmit(new Controls(), out ticket), "the queue is full");
            Exception thrown = null;
            var waiting = new ManualResetEventSlim();
            var thread = new Thread(() =>
            {
                try
                {
                    StepInfo info;
                    Anchor anchor;
                    waiting.Set();
                    rollout.Wait(ticket, Timeout.InfiniteTimeSpan, out info, out anchor);
                }
                catch (Exception why)
                {
                    thrown = why;
                }
            });
            thread.Start();
            waiting.Wait();
            rollout.Dispose();
            thread.Join();
            // If the cancellation came after the wait, the handle was destroyed already.
            var known = thrown as CairnException;
            bool ended = thrown is ObjectDisposedException || known != null && (known.Result == Result.Cancelled || known.Result == Result.InvalidHandle);
            Expect.True(ended, $"{thrown}");
        }

        [Test]
        private static void TwoThreadsOnOneRolloutAreBusyAndNothingBreaks()
        {
            var made = 0;
            var other = new List<string>();
            using (Rollout rollout = Shared.Rollout())
            {
                var threads = new Thread[3];
                for (int i = 0; i < threads.Length; i++)
                {
                    threads[i] = new Thread(() =>
                    {
                        for (int step = 0; step < 5; step++)
                        {
                            try
                            {
                                rollout.Step();
                                Interlocked.Increment(ref made);
                            }
                            catch (Exception why)
                            {
                                var known = why as CairnException;
                                if (known == null || known.Result != Result.Busy) lock (other) other.Add(why.ToString());
                            }
                        }
                    });
                    threads[i].Start();
                }
                foreach (Thread thread in threads) thread.Join();
                Expect.Equal(0, other.Count, string.Join("\n", other));
                Expect.Equal(made + 1L, rollout.Info.Latents, "the number of latents");
                Expect.True(made > 0, "no step was made");
            }
        }

        [Test]
        private static void RolloutsRunAtTheSameTime()
        {
            byte[] expected = Shared.Shown(Shared.Walk).Last();
            var found = new byte[3][];
            var threads = new Thread[found.Length];
            for (int i = 0; i < threads.Length; i++)
            {
                int own = i;
                threads[i] = new Thread(() => found[own] = Shared.Shown(Shared.Walk).Last());
                threads[i].Start();
            }
            foreach (Thread thread in threads) thread.Join();
            foreach (byte[] each in found) Expect.Same(expected, each, "pictures of threads");
        }

        [Test]
        private static void ARestoredStateContinuesBitForBit()
        {
            byte[] expected = Shared.Shown(Shared.Walk).Last();
            string file = Path.Combine(Path.GetDirectoryName(typeof(Program).Assembly.Location), "ein Zustand – 状態.state");
            using (Rollout rollout = Shared.Rollout())
            using (Rollout second = Shared.World.CreateRollout())
            using (Rollout third = Shared.World.CreateRollout())
            {
                rollout.Step(Shared.Walk[0]);
                rollout.Step(Shared.Walk[1]);
                byte[] state = rollout.Save();
                rollout.SaveFile(file);
                Expect.Same(state, File.ReadAllBytes(file), "the state in memory and in a file");
                second.Restore(state);
                third.RestoreFile(file);
                foreach (Rollout heir in new[] { second, third })
                {
                    Expect.Equal(7ul, heir.Info.Seed);
                    heir.Step(Shared.Walk[2]);
                    using (Anchor anchor = heir.Anchor()) Expect.Same(expected, anchor.Picture(), "the heir's picture and the first one's");
                }
                state[state.Length / 2] ^= 1;
                Expect.Fails(Result.InvalidState, () => second.Restore(state));
                Expect.Throws<CairnException>(() => second.Restore(Span<byte>.Empty));
                Expect.Fails(Result.Io, () => second.RestoreFile(file + ".nowhere"));
                Expect.Throws<ArgumentNullException>(() => second.RestoreFile(null));
                Expect.Equal(4L, second.Info.Latents);
                second.Reset();
                Expect.Equal(0L, second.Info.Latents);
            }
            File.Delete(file);
        }

        /// <summary>Saves a state whose size is the next of <paramref name="sizes"/> in each call; the last one stays.</summary>
        private static unsafe byte[] SavedWithSizes(params int[] sizes)
        {
            int calls = 0;
            return Rollout.SavedBy(
                (rollout, bytes, capacity, size) =>
                {
                    int length = sizes[Math.Min(calls++, sizes.Length - 1)];
                    if (bytes != null && (int)capacity < length) return (int)Result.InvalidArgument;
                    if (bytes != null) new Span<byte>(bytes, length).Fill((byte)length);
                    *size = (UIntPtr)length;
                    return (int)Result.Ok;
                },
                IntPtr.Zero);
        }

        [Test]
        private static void AStateWhoseSizeChangesIsSavedWhole()
        {
            foreach (int[] sizes in new[] { new[] { 100 }, new[] { 100, 60 }, new[] { 100, 120 }, new[] { 100, 120, 120, 90 } })
            {
                int last = sizes[sizes.Length - 1];
                Expect.Same(Enumerable.Repeat((byte)last, last).ToArray(), SavedWithSizes(sizes), $"the state of {last} bytes");
            }
            Expect.Fails(Result.InvalidArgument, () => SavedWithSizes(100, 120, 100));
            Expect.Fails(Result.InvalidArgument, () => SavedWithSizes(Enumerable.Range(1, 100).ToArray()));
        }

        [Test]
        private static void OneBudgetLimitsLatentsAndFrames()
        {
            using (Rollout rollout = Shared.Rollout())
            using (var presenter = new Presenter(new PresenterOptions { Multiplier = 4, IntervalNs = 66666667 }))
            {
                // No step finishes within a nanosecond.
                var budget = new Budget { FrameNs = 1, Schedules = new[] { "stock", "explicit:1:0.5:0" }, Worlds = new[] { Shared.World }, Presenter = presenter };
                rollout.Govern(budget);
                int[] passes = Enumerable.Range(0, 5).Select(step => rollout.Step().DenoisePasses).ToArray();
                Expect.True(passes[0] > 2 && passes[4] == 2, string.Join(", ", passes));
                RolloutStatistics told = rollout.Statistics;
                Expect.True(told.GovernedLess == 1 && told.GovernedMade == 1 && told.GovernedPasses == 2, $"{told.GovernedLess} {told.GovernedMade} {told.GovernedPasses}");
                Expect.Equal(1, presenter.Statistics.MadeToAnchor);
                Expect.Fails(Result.InvalidArgument, () => rollout.Govern(new Budget { FrameNs = 1, Multiplier = 3, Presenter = presenter }));
                Expect.Fails(Result.OutOfMemory, () => rollout.Govern(new Budget { MemoryMib = 1 }));
                rollout.Govern(null);
                rollout.SetBudget(0);
                rollout.Step();
            }
        }
    }
}
