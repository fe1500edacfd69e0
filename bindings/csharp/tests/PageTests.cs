using System.IO;

namespace Cairn.Tests
{
    /// <summary>The examples of README.md, which are compiled into <c>Page</c> unchanged.</summary>
    internal static class PageTests
    {
        [Test]
        private static void ExamplesRun()
        {
            Page.Run();
        }
    }
}
