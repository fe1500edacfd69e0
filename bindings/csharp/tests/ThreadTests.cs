using System;
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

        [Test(OnMono = true)]
        private static void AnUnloadedDomainTakesItsRunnerAlong()
        {
            byte[] own = PresenterTests.HalfWay();
            AppDomain domain = AppDomain.CreateDomain("scripts");
            var scripts = (Scripts)domain.CreateInstanceAndUnwrap(typeof(Scripts).Assembly.FullName, typeof(Scripts).FullName);
            Expect.True(scripts.Play(Library.Path) > 0, "the domain's runner was not asked");
            AppDomain.Unload(domain);
            // A runner of the unloaded domain would be called here, which ends the process.
            Expect.Same(own, PresenterTests.HalfWay(), "a frame after the unloading");
            Threads.UseJobs(null, 0);
        }

        /// <summary>Scripts of an editor, which reloads them in the middle of a game.</summary>
        private sealed class Scripts : MarshalByRefObject
        {
            private static Anchor open;

            /// <summary>Sets a runner, and leaves an open object and one that is garbage. Returns how often the runner was asked.</summary>
            /// <param name="library">The library of the process, which the new domain would search for again.</param>
            public int Play(string library)
            {
                Library.Load(library);
                var asked = 0;
                Threads.UseJobs((jobs, job) => { Interlocked.Increment(ref asked); job(); }, 3);
                PresenterTests.HalfWay();
                open = Picture();
                Picture();
                return open.IsClosed ? 0 : asked;
            }

            private static Anchor Picture()
            {
                return Anchor.FromPicture(new PictureView(new byte[64 * 64 * 4], 64, 64), 0);
            }
        }
    }
}
