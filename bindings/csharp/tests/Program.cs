using System;

namespace Cairn.Tests
{
    internal static class Program
    {
        /// <summary>Settings from environment variables.</summary>
        internal static string Setting(string name)
        {
            string value = Environment.GetEnvironmentVariable(name);
            Expect.True(!string.IsNullOrEmpty(value), $"{name} is not set: `cargo xtask test csharp` sets it");
            return value;
        }

        private static int Main()
        {
            // A library is loaded once per process, so tests that need it not loaded run first.
            return Runner.Run(
                typeof(InterfaceTests), typeof(LoadingTests), typeof(ThreadTests), typeof(ObjectTests), typeof(RolloutTests), typeof(PresenterTests),
                typeof(PageTests));
        }
    }
}
