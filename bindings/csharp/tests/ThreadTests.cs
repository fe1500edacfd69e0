using System.Threading;

namespace Cairn.Tests
{
    /// <summary>Thread settings. Runs before all tests that keep objects, because threads can be set only while there is no object.</summary>
    internal static class ThreadTests
    {
        [Test]
        private static void AJobSystemDoesTheWorkAndChangesNoFrame()
        {
            byte[] own = PresenterTests.HalfWay();
            var asked = 0;
            JobRunner runner = (jobs, job) =>
            {
                Interlocked.Increment(ref asked);
                job();
                throw new Failure("a runner's own");
            };
            Threads.UseJobs(runner, 3);
            try
            {
                Expect.Same(own, PresenterTests.HalfWay(), "a frame by the program's own jobs");
                Expect.True(asked > 0, "the runner was not asked");
            }
            finally
            {
                Threads.UseJobs(null, 0);
            }
            int before = asked;
            Expect.Same(own, PresenterTests.HalfWay(), "a frame by the library's threads again");
            Expect.Equal(before, asked);
            Expect.Fails(Result.InvalidArgument, () => Threads.UseJobs(runner, 0));
        }
    }
}
