using System;
using System.Collections;
using System.Collections.Generic;
using System.Diagnostics;
using System.Linq;
using System.Reflection;
using System.Threading;
using Cairn.Tests;
using UnityEngine;

namespace Cairn.Unity.Tests
{
    /// <summary>Messages that Unity sends to components, and their private fields.</summary>
    internal static class Reflected
    {
        private const BindingFlags Own = BindingFlags.Instance | BindingFlags.NonPublic;

        internal static void Send(this MonoBehaviour component, string message)
        {
            component.GetType().GetMethod(message, Own).Invoke(component, null);
        }

        internal static T Field<T>(this MonoBehaviour component, string name)
        {
            return (T)component.GetType().GetField(name, Own).GetValue(component);
        }
    }

    /// <summary>The player's input. Runs with each input system.</summary>
    internal static class InputTests
    {
        /// <summary>A frame in which these keys are held and the mouse moves.</summary>
        internal static void Frame(CairnInput input, string[] held, float x = 0, float y = 0, float wheel = 0)
        {
            EngineDouble.Held.Clear();
            EngineDouble.Tapped.Clear();
            EngineDouble.Held.UnionWith(held);
            EngineDouble.Mouse = new Vector2(x, y);
            EngineDouble.Wheel = wheel;
            input.Send("Update");
        }

        private static void Holds(CairnInput input, params Key[] keys)
        {
            Key[] found = input.Take().Keys.ToArray();
            Expect.True(found.SequenceEqual(keys), $"[{string.Join(", ", found)}] are held, not [{string.Join(", ", keys)}]");
        }

        private static void Moves(CairnInput input, float x, float y, int wheel)
        {
            Controls controls = input.Take();
            Expect.Equal(x, controls.MouseX, "x");
            Expect.Equal(y, controls.MouseY, "y");
            Expect.Equal(wheel, Math.Sign(controls.Scroll), "the wheel's direction");
        }

        private static readonly string[] None = new string[0];

        [Test]
        private static void BothSidesOfAModifierHaveItsOneCode()
        {
            var input = new CairnInput();
            foreach (string side in new[] { "Left", "Right" })
            {
                Frame(input, new[] { side + "Shift" });
                Holds(input, Key.Shift);
                // The input systems' names differ.
                Frame(input, new[] { side + "Control", side + "Ctrl" });
                Holds(input, Key.Ctrl);
                Frame(input, new[] { side + "Alt", "A" });
                Holds(input, Key.Alt, Key.A);
            }
        }

        [Test]
        private static void AKeyCountsIfItWasHeldAtAnyTimeDuringTheStep()
        {
            var input = new CairnInput();
            Frame(input, new[] { "W", "Space" });
            Frame(input, new[] { "W" });
            Holds(input, Key.Space, Key.W);
            // Steps may be faster than frames.
            Holds(input, Key.W);
            Frame(input, None);
            Holds(input);
            Frame(input, new[] { "W" });
            Frame(input, None);
            input.Send("OnDisable");
            Holds(input);
        }

        [Test]
        private static void AKeyTappedBetweenTwoFramesCounts()
        {
            var input = new CairnInput();
            EngineDouble.Held.Clear();
            EngineDouble.Tapped.UnionWith(new[] { "Space", "Mouse0" });
#if CAIRN_INPUT_SYSTEM && !CAIRN_INPUT_SYSTEM_1_9
            EngineDouble.TellsOfTaps = false;
            input.Send("Update");
            Holds(input);
#else
            input.Send("Update");
            Frame(input, None);
            Holds(input, Key.MouseLeft, Key.Space);
#endif
            Holds(input);
        }

        [Test]
        private static void MovementIsSummedWithinTheRangeOfControls()
        {
            var input = new CairnInput { MouseSpeed = 2 };
            Frame(input, None, 20, 40, 1);
            Frame(input, None, 20, -20, 1);
            // Unity's y points up, a world's down.
            Moves(input, 80, -40, 1);
            Frame(input, None, 1e9f, 1e9f);
            Frame(input, None, float.NaN, float.PositiveInfinity, float.NaN);
            Moves(input, 32768, -32768, 0);
            Moves(input, 0, 0, 0);
        }

        [Test]
        private static void NoTypeHasTheNameOfOneOfUnity()
        {
            IEnumerable<Type> unity = typeof(MonoBehaviour).Assembly.GetExportedTypes().Where(type => type.Namespace == "UnityEngine");
            IEnumerable<string> own = typeof(Controls).Assembly.GetExportedTypes().Select(type => type.Name);
            string[] both = own.Intersect(unity.Select(type => type.Name)).ToArray();
            Expect.True(both.Length == 0, string.Join(", ", both));
        }
    }

    /// <summary>A world and its presenter, with a test double of the native plugin.</summary>
    internal static class WorldTests
    {
        private const int Width = 64;
        private const int Height = 36;

        private static byte[] Seed()
        {
            var pixels = new byte[Width * Height * 4];
            for (int i = 0; i < pixels.Length; i++) pixels[i] = (byte)(i % 4 == 3 ? 255 : i / 40);
            return pixels;
        }

        /// <summary>The library's own anchor after a number of steps without input.</summary>
        private static byte[] Anchor(int steps, out WorldInfo info)
        {
            using (Device device = Device.Cpu())
            using (World world = device.LoadWorld(new WorldOptions { FitWindow = true }))
            using (Rollout rollout = world.CreateRollout(new RolloutOptions { Seed = 1 }))
            {
                info = world.Info;
                rollout.Append(new PictureView(Seed(), Width, Height));
                for (int i = 0; i < steps; i++) rollout.Step(default(Controls));
                using (Anchor anchor = rollout.Anchor()) return anchor.Picture();
            }
        }

        /// <summary>Runs frames until a condition holds.</summary>
        private static void Until(CairnPresenter presenter, CairnWorld world, Func<bool> holds)
        {
            var clock = Stopwatch.StartNew();
            while (!holds())
            {
                Expect.True(world.State != WorldState.Failed && presenter.Failure.Length == 0, world.Message + presenter.Failure);
                Expect.True(clock.Elapsed.TotalSeconds < 200, "nothing happens");
                Thread.Sleep(2);
                world.Send("Update");
                presenter.Send("LateUpdate");
            }
        }

        [Test]
        private static void AWorldIsPlayedFromItsBeginningWithThePropertiesOfThatTime()
        {
            Plugin.Load();
            WorldInfo info;
            Anchor(0, out info);
            int width = info.RenderWidth;
            int height = info.RenderHeight;
            var renderer = new Renderer { material = new Material() };
            EngineDouble.Components.Add(renderer);

            var input = new CairnInput();
            // The player does this while the world is loading.
            InputTests.Frame(input, new[] { "W", "Space" }, 500, 300, 1);
            InputTests.Frame(input, new string[0]);
            var world = new CairnWorld { Input = input, Processor = WorldProcessor.Processor };
            world.SetSeed(Seed(), Width, Height);
            var presenter = new CairnPresenter
            {
                World = world, Multiplier = 1, Format = PresenterFormat.ARGB32, Output = PresenterOutput.Renderer,
            };
            presenter.Resize(width, height);
            world.Send("OnEnable");
            presenter.Send("OnEnable");
            try
            {
                var pixels = new byte[width * height * 4];
                var frame = default(Frame);
                Until(presenter, world, () =>
                {
                    // The world's thread pushes anchors at the same time.
                    var own = presenter.Field<Presenter>("presenter");
                    if (own == null || !own.TryDraw(Clock.NowNs, new PictureTarget(pixels, width, height), out frame)) return false;
                    return frame.Source == FrameSource.Anchor;
                });
                Expect.Same(Anchor((int)frame.Previous, out info), pixels, "an anchor, and one without the input while the world was loading,");

                Until(presenter, world, () => presenter.Field<int>("preparedWidth") == width);
                Expect.Equal(height, presenter.Field<int>("preparedHeight"));

                // Nothing updates while an editor pauses the game.
                long resting = -1;
                long before = -2;
                for (int i = 0; i < 5 && resting != before; i++)
                {
                    before = resting;
                    Thread.Sleep(1000);
                    resting = world.Anchors;
                }
                Expect.Equal(before, resting);
                Until(presenter, world, () => world.Anchors > resting + 1);

                var shown = presenter.Field<Presenter>("presenter");
                presenter.World = new CairnWorld();
                presenter.Format = PresenterFormat.ARGBHalf;
                presenter.Output = PresenterOutput.Texture;
                presenter.Multiplier = 4;
                presenter.Send("LateUpdate");
                Expect.True(ReferenceEquals(shown, presenter.Field<Presenter>("presenter")), "another world is shown");
                presenter.Resize(width / 2, height / 2);
                Expect.Equal(RenderTextureFormat.ARGB32, presenter.Texture.format);
                Expect.True(ReferenceEquals(renderer.material.mainTexture, presenter.Texture), "the renderer has the texture of the old size");
                presenter.Send("OnDisable");
                Expect.Equal(0, world.Field<IList>("presenters").Count, "the number of the world's presenters");
            }
            finally
            {
                world.Send("OnDisable");
            }
        }
    }

    internal static class Program
    {
        private static int Main(string[] arguments)
        {
            return arguments.Contains("input") ? Runner.Run(typeof(InputTests)) : Runner.Run(typeof(InputTests), typeof(WorldTests));
        }
    }
}
