using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Linq;
using System.Reflection;

namespace Cairn.Tests
{
    /// <summary>A test: a method without parameters. Those of a class run in source order.</summary>
    [AttributeUsage(AttributeTargets.Method)]
    internal sealed class TestAttribute : Attribute
    {
        /// <summary>Whether it needs parts of .NET that Mono's packages do not have.</summary>
        public bool OnDotNet { get; set; }

        /// <summary>Whether it needs application domains that can be unloaded, which .NET does not have.</summary>
        public bool OnMono { get; set; }
    }

    internal sealed class Failure : Exception
    {
        internal Failure(string message) : base(message)
        {
        }
    }

    /// <summary>Assertions.</summary>
    internal static class Expect
    {
        internal static void True(bool holds, string what)
        {
            if (!holds) throw new Failure(what);
        }

        internal static void Equal<T>(T expected, T found, string what = "value")
        {
            if (!EqualityComparer<T>.Default.Equals(expected, found)) throw new Failure($"{what} is {found}, not {expected}");
        }

        internal static void Same(byte[] expected, byte[] found, string what)
        {
            True(expected.AsSpan().SequenceEqual(found), $"{what} differ");
        }

        internal static void Contains(string part, string whole)
        {
            True(whole.Contains(part), $"\"{part}\" is not in \"{whole}\"");
        }

        internal static T Throws<T>(Action act) where T : Exception
        {
            try
            {
                act();
            }
            catch (T thrown)
            {
                return thrown;
            }
            throw new Failure($"no {typeof(T).Name} was thrown");
        }

        internal static CairnException Fails(Result result, Action act)
        {
            var thrown = Throws<CairnException>(act);
            Equal(result, thrown.Result, $"the result ({thrown.Message})");
            Contains(thrown.Function + ": ", thrown.Message);
            return thrown;
        }
    }

    internal static class Runner
    {
        /// <summary>Runs the tests of classes, and prints their results. Returns the process's exit code.</summary>
        internal static int Run(params Type[] classes)
        {
            bool isMono = Type.GetType("Mono.Runtime") != null;
            var failed = 0;
            foreach (Type type in classes)
            {
                foreach (MethodInfo method in type.GetMethods(BindingFlags.Static | BindingFlags.NonPublic | BindingFlags.Public).OrderBy(each => each.MetadataToken))
                {
                    var test = method.GetCustomAttribute<TestAttribute>();
                    if (test == null || (isMono ? test.OnDotNet : test.OnMono)) continue;
                    var clock = Stopwatch.StartNew();
                    try
                    {
                        method.Invoke(null, null);
                        Console.WriteLine($"test {type.Name}.{method.Name} ... ok");
                        Console.WriteLine($"  {clock.ElapsedMilliseconds} ms");
                    }
                    catch (TargetInvocationException why)
                    {
                        failed++;
                        Console.WriteLine(why.InnerException);
                        Console.WriteLine($"test {type.Name}.{method.Name} ... FAILED");
                    }
                }
            }
            return failed == 0 ? 0 : 1;
        }
    }
}
