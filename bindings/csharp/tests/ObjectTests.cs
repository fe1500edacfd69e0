using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Runtime.CompilerServices;
using System.Text;
using System.Threading;

namespace Cairn.Tests
{
    /// <summary>Devices, worlds, texts, handles, controls and the log.</summary>
    internal static unsafe class ObjectTests
    {
        [Test]
        private static void TheBestDeviceIsChosenWithReasons()
        {
            var nowhere = new DeviceOptions { WebGpu = "no/such/file Ж", Threads = 2 };
            Requirement provider = Device.Requirements(DeviceKind.WebGpu, nowhere).Single(each => each.Kind == RequirementKind.WebGpu);
            Expect.Equal(RequirementStatus.NotMet, provider.Status);
            Expect.Contains("no/such/file Ж", provider.Found);
            using (Device device = Device.Auto(out string refusals, nowhere))
            {
                Expect.Equal(DeviceKind.Cpu, device.Info.Kind);
                Expect.Contains("not WebGPU: ", refusals);
                Expect.Contains("no/such/file Ж", refusals);
            }
        }

        [Test]
        private static void DevicesListAdaptersAndRequirements()
        {
            Expect.Equal(DeviceKind.Cpu, Device.Adapters()[0].Kind);
            Expect.True(Device.Adapters()[0].Name.Length > 0, "the processor has no name");
            Requirement runtime = Device.Requirements().Single(each => each.Kind == RequirementKind.OnnxRuntime);
            Expect.Equal(RequirementStatus.Met, runtime.Status);
            Expect.Contains("1.24", runtime.Found);
            var nowhere = new DeviceOptions { OnnxRuntime = "no/such/file Ж" };
            runtime = Device.Requirements(DeviceKind.Cpu, nowhere).Single(each => each.Kind == RequirementKind.OnnxRuntime);
            Expect.Equal(RequirementStatus.NotMet, runtime.Status);
            Expect.Contains("Ж", Expect.Fails(Result.RuntimeMissing, () => Device.Cpu(nowhere)).Message);
            // The environment variable of the test run names a missing file.
            var tool = new DeviceOptions { Environment = true };
            Expect.Contains("there is none", Expect.Fails(Result.RuntimeMissing, () => Device.Cpu(tool)).Message);
            DeviceInfo info = Shared.Device.Info;
            Expect.Equal(2, info.Threads);
            Expect.Equal(Precision.F32, info.Precision);
            Expect.Contains("ONNX Runtime 1.24", info.Description);
        }

        [Test]
        private static void TheWorldInsideTheLibraryIsLoadedWithProgress()
        {
            var stages = new List<LoadStage>();
            long last = 0;
            var options = new WorldOptions
            {
                Progress = (stage, done, total) =>
                {
                    if (!stages.Contains(stage)) stages.Add(stage);
                    Expect.True(done <= total, $"{done} of {total}");
                    last = total;
                    return true;
                },
            };
            using (World world = Shared.Device.LoadWorld(options))
            {
                WorldInfo info = world.Info;
                Expect.True(info.RenderWidth > 0 && info.RenderHeight > 0 && info.LatentsPerSecond > 0, "a world without sizes");
                Expect.Equal(64, info.Digest.Length, "the length of the digest");
                Expect.True(info.Name.Length > 0 && info.Licence.Length > 0, "a world without name or licence");
                WorldMemory memory = world.Memory;
                Expect.Equal(memory.Total, memory.Bundle + memory.Weights + memory.Ring + memory.Slabs + memory.Intermediates + memory.Autoencoder + memory.Arena, "the sum");
                Expect.Equal(world.LicenceText, world.LicenceText);
            }
            Expect.True(stages.SequenceEqual(new[] { LoadStage.Reading, LoadStage.Preparing }), string.Join(", ", stages));
            Expect.True(last > 0, "there was nothing to do");
        }

        [Test]
        private static void TheNumberOfSlicesIsGivenOrChosenByALimit()
        {
            int layers = Shared.World.Info.Layers;
            Expect.Equal(1, Shared.World.Info.Slices);
            foreach (WorldOptions options in new[] { new WorldOptions { Slices = layers }, new WorldOptions { LongestSubmissionUs = 1 } })
            {
                using (World world = Shared.Device.LoadWorld(options))
                {
                    Expect.Equal(world.Info.Layers, world.Info.Slices);
                    Expect.Equal(options.Slices == 0, world.Info.LongestSliceUs > 0);
                }
            }
            CairnException thrown = Expect.Fails(Result.InvalidArgument, () => Shared.Device.LoadWorld(new WorldOptions { Slices = layers + 1 }));
            Expect.Equal("slices", thrown.Field);
            Expect.Throws<ArgumentOutOfRangeException>(() => Shared.Device.LoadWorld(new WorldOptions { Slices = -1 }));
            Expect.Throws<ArgumentOutOfRangeException>(() => Shared.Device.LoadWorld(new WorldOptions { LongestSubmissionUs = -1 }));
        }

        [Test]
        private static void ALoadEndsIfItsCallbackReturnsFalseOrThrows()
        {
            Expect.Fails(Result.Cancelled, () => Shared.Device.LoadWorld(new WorldOptions { Progress = (stage, done, total) => false }));
            var thrown = Expect.Throws<Failure>(() => Shared.Device.LoadWorld(new WorldOptions { Progress = (stage, done, total) => { throw new Failure("mine"); } }));
            Expect.Equal("mine", thrown.Message);
            // The device cannot be destroyed during the load: the call fails, and both stay as they are.
            var busy = Result.Ok;
            using (Device device = Device.Cpu(new DeviceOptions { Threads = 2 }))
            {
                var options = new WorldOptions
                {
                    Progress = (stage, done, total) =>
                    {
                        if (busy == Result.Ok) busy = Expect.Throws<CairnException>(device.Dispose).Result;
                        return !device.IsClosed;
                    },
                };
                device.LoadWorld(options).Dispose();
            }
            Expect.Equal(Result.Busy, busy);
        }

        [Test]
        private static void AnErrorHasTheLibrarysMessageAndItsParts()
        {
            string nowhere = Path.Combine(Path.GetTempPath(), "nowhere Ж");
            CairnException thrown = Expect.Fails(Result.Io, () => Shared.Device.LoadWorld(new WorldOptions { Path = nowhere }));
            Expect.Equal("cairn_world_load", thrown.Function);
            Expect.Contains(nowhere, thrown.Field);
            foreach (string part in new[] { thrown.Field, thrown.Cause, thrown.Remedy })
            {
                Expect.True(part.Length > 0, "a part is empty");
                Expect.Contains(part, thrown.Message);
            }
            thrown = Expect.Fails(Result.InvalidArgument, () => Shared.Device.LoadWorld(new WorldOptions { OperatingPoint = "fastest" }));
            Expect.Contains("fastest", thrown.Message);
            Expect.Fails(Result.InvalidArgument, () => Device.Cpu(new DeviceOptions { Threads = 1025 }));
            Expect.Throws<ArgumentOutOfRangeException>(() => Device.Cpu(new DeviceOptions { Threads = -1 }));
        }

        [Test]
        private static void TextsWithNulOrInvalidCharactersAreRefused()
        {
            foreach (string path in new[] { "a\0b", "\udcff" })
            {
                var thrown = Expect.Throws<ArgumentException>(() => Shared.Device.LoadWorld(new WorldOptions { Path = path }));
                Expect.Equal("options", thrown.ParamName);
            }
        }

        [Test]
        private static void TextsOfAnyLengthAreReadCompletely()
        {
            string same;
            using (var recorder = new Recorder())
            {
                for (int i = 0; i < 2000; i++) recorder.Scroll(TimeSpan.FromMilliseconds(i * 100), 1);
                using (Script script = recorder.Script(TimeSpan.FromMinutes(4))) same = script.Text;
            }
            Expect.True(same.Length > 10000, $"{same.Length} letters");
            using (var again = new Script(same)) Expect.Equal(same, again.Text);
        }

        [Test]
        private static void ClosedObjectsStayClosed()
        {
            Rollout rollout = Shared.World.CreateRollout();
            Expect.True(!rollout.IsClosed, "it is closed");
            rollout.Dispose();
            rollout.Dispose();
            Expect.True(rollout.IsClosed, "it is open");
            var thrown = Expect.Throws<ObjectDisposedException>(() => rollout.Step());
            Expect.Equal("Rollout", thrown.ObjectName);
            using (Anchor anchor = Anchor.FromPicture(Shared.Seed(), 0))
            using (var presenter = new Presenter())
            {
                anchor.Dispose();
                Expect.Throws<ObjectDisposedException>(() => presenter.TryPush(anchor, 0));
                Expect.Throws<ArgumentNullException>(() => presenter.TryPush(null, 0));
            }
        }

        [Test]
        private static void InvalidHandlesAreErrors()
        {
            // Calls that the classes never make: with a destroyed handle, one of another kind, and one that never existed.
            Rollout rollout = Shared.World.CreateRollout();
            IntPtr number = rollout.Value;
            rollout.Dispose();
            foreach (IntPtr handle in new[] { number, Shared.World.Value, (IntPtr)12345, IntPtr.Zero })
            {
                Expect.Equal(Native.ERROR_INVALID_HANDLE, Library.C.rollout_reset(handle), handle.ToString());
            }
        }

        [Test]
        private static void ObjectsAreClosedInAnyOrder()
        {
            Device device = Device.Cpu(new DeviceOptions { Threads = 2 });
            World world = device.LoadWorld();
            device.Dispose();
            Rollout rollout = world.CreateRollout();
            world.Dispose();
            rollout.Append(Shared.Seed());
            Anchor anchor = rollout.Anchor();
            rollout.Dispose();
            Expect.True(anchor.Picture().Length > 0 && anchor.Latent().Length > 0, "the anchor is empty");
            anchor.Dispose();
        }

        [MethodImpl(MethodImplOptions.NoInlining)]
        private static IntPtr Forgotten()
        {
            return Anchor.FromPicture(Shared.Seed(), 0).Value;
        }

        [Test]
        private static void TheGarbageCollectorDestroysObjects()
        {
            // The garbage collector scans stacks conservatively, so one of many objects may stay alive.
            var forgotten = new IntPtr[32];
            var thread = new Thread(() =>
            {
                for (int i = 0; i < forgotten.Length; i++) forgotten[i] = Forgotten();
            });
            thread.Start();
            thread.Join();
            var gone = 0;
            for (int tries = 0; tries < 50 && gone < forgotten.Length / 2; tries++)
            {
                GC.Collect();
                GC.WaitForPendingFinalizers();
                gone = forgotten.Count(IsGone);
            }
            Expect.True(gone >= forgotten.Length / 2, $"{gone} of {forgotten.Length} were given back");
        }

        private static bool IsGone(IntPtr anchor)
        {
            var info = new Native.anchor_info { struct_size = (uint)sizeof(Native.anchor_info) };
            return Library.C.anchor_get_info(anchor, &info) == Native.ERROR_INVALID_HANDLE;
        }

        [Test]
        private static void ControlsMatchScriptsAndRecorders()
        {
            var controls = new Controls(Key.W, Key.Quote, (Key)255) { MouseX = 3, MouseY = -4, Scroll = 1 };
            Expect.True(controls.Keys.SequenceEqual(new[] { Key.W, Key.Quote, (Key)255 }), string.Join(", ", controls.Keys));
            controls.Release((Key)255);
            Expect.True(controls.IsHeld(Key.W) && !controls.IsHeld((Key)255) && !controls.IsHeld(Key.S), "keys are not as they were set");
            using (var recorder = new Recorder())
            {
                recorder.Step(1, 15, controls);
                recorder.Step(2, 15, new Controls(Key.Space));
                using (Script script = recorder.Script(TimeSpan.FromTicks(2 * TimeSpan.TicksPerSecond / 15)))
                {
                    Expect.Equal(controls, script.Controls(1, 15));
                    Expect.Equal(new Controls(Key.Space), script.Controls(2, 15));
                    Expect.Equal(new Controls(), script.Controls(3, 15));
                    Expect.True(Math.Abs(script.Duration.TotalSeconds - 2 / 15.0) < 1e-5, script.Duration.ToString());
                    string file = Path.Combine(Path.GetDirectoryName(typeof(Program).Assembly.Location), "Gang Ж.txt");
                    File.WriteAllText(file, script.Text);
                    using (Script read = Script.Read(file)) Expect.Equal(controls, read.Controls(1, 15));
                }
                recorder.Key(TimeSpan.FromSeconds(5), Key.A, true);
                recorder.Mouse(TimeSpan.FromSeconds(6), 1, 2);
                Expect.Fails(Result.InvalidArgument, () => recorder.Mouse(TimeSpan.FromSeconds(7), float.NaN, 0));
                Expect.Fails(Result.InvalidArgument, () => recorder.Script(TimeSpan.FromSeconds(1)));
                Expect.Throws<ArgumentOutOfRangeException>(() => recorder.Scroll(TimeSpan.FromSeconds(-1), 1));
            }
            Expect.Contains("line", Expect.Fails(Result.InvalidArgument, () => new Script("no script")).Message);
        }

        [Test]
        private static void ThreadsCanBeSetOnlyWithoutObjects()
        {
            using (Recorder recorder = new Recorder())
            {
                Expect.Contains("objects live", Expect.Fails(Result.Busy, () => Threads.Set(2)).Message);
            }
            Expect.Fails(Result.InvalidArgument, () => Threads.Set(1025));
            Expect.Fails(Result.InvalidArgument, () => Threads.Set(2, (WorkerPriority)7));
            Expect.Throws<ArgumentOutOfRangeException>(() => Threads.Set(-1));
        }

        [Test]
        private static void TheLogGoesToASinkThatMayThrow()
        {
            var heard = new List<string>();
            LogSink sink = (level, target, message) =>
            {
                heard.Add($"{level} {target}: {message}");
                throw new Failure("a sink's own");
            };
            Log.To(sink, LogLevel.Trace);
            try
            {
                // The library logs little when all is well, so the callback is called directly.
                var handle = System.Runtime.InteropServices.GCHandle.Alloc(sink);
                fixed (byte* target = Encoding.UTF8.GetBytes("cairn::part\0"))
                fixed (byte* message = Encoding.UTF8.GetBytes("grün\0"))
                {
                    Log.OnMessage((uint)LogLevel.Info, target, message, (void*)System.Runtime.InteropServices.GCHandle.ToIntPtr(handle));
                }
                handle.Free();
                Expect.Equal("Info cairn::part: grün", heard.Last());
                int before = heard.Count;
                // The library logs a budget that cannot be met.
                using (Rollout rollout = Shared.Rollout())
                {
                    rollout.SetBudget(1, "stock", "explicit:1:0.5:0");
                    for (int i = 0; i < 5; i++) rollout.Step();
                }
                Expect.True(heard.Count > before, "the library said nothing");
                Log.To(sink, LogLevel.Error);
                Expect.Fails(Result.InvalidArgument, () => Log.To(sink, (LogLevel)9));
            }
            finally
            {
                Log.To(null);
            }
        }
    }
}
