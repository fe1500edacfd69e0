using System;
using System.IO;
using System.Linq;
using System.Threading;

namespace Cairn.Tests
{
    /// <summary>Missing and incompatible libraries, then the right one. These tests must run before any use of the library.</summary>
    internal static class LoadingTests
    {
        private static readonly string Folder = Path.GetDirectoryName(typeof(LoadingTests).Assembly.Location);

        private static LibraryException Refused(string path, Result result, params string[] says)
        {
            var thrown = Expect.Throws<LibraryException>(() => Library.Load(path));
            Expect.Equal(result, thrown.Result, thrown.Message);
            Expect.Equal(path, thrown.Field, "the file");
            Expect.True(thrown.Remedy.Length > 10, $"there is no remedy in \"{thrown.Message}\"");
            Expect.Equal($"{thrown.Field}: {thrown.Cause}. {thrown.Remedy}", thrown.Message);
            foreach (string part in says) Expect.Contains(part, thrown.Message);
            return thrown;
        }

        /// <summary>The first bytes of the library, with some of them changed.</summary>
        private static string Changed(string name, Action<byte[]> change)
        {
            var head = new byte[4096];
            using (FileStream file = File.OpenRead(Path.Combine(Folder, Library.FileName))) file.Read(head, 0, head.Length);
            change(head);
            string path = Path.Combine(Folder, name);
            File.WriteAllBytes(path, head);
            return path;
        }

        private static void WithVariable(string value, Action act)
        {
            string before = Environment.GetEnvironmentVariable(Library.Variable);
            Environment.SetEnvironmentVariable(Library.Variable, value);
            try
            {
                act();
            }
            finally
            {
                Environment.SetEnvironmentVariable(Library.Variable, before);
            }
        }

        [Test]
        private static void AMissingLibraryIsReportedWithARemedy()
        {
            string nowhere = Path.Combine(Folder, "nowhere", Library.FileName);
            Refused(nowhere, Result.Io, "there is no such file", Library.FileName);
            WithVariable(nowhere, () =>
            {
                Expect.Equal(nowhere, Library.Places().Single());
                var thrown = Expect.Throws<LibraryException>(() => Device.Cpu());
                Expect.Contains(Library.Variable, thrown.Message);
                Expect.Contains(nowhere, thrown.Message);
                Expect.Contains("Put " + Library.FileName, thrown.Remedy);
            });
        }

        [Test]
        private static void TheLibraryIsSearchedForBesideTheAssemblyAndInPackages()
        {
            WithVariable(null, () =>
            {
                Expect.Equal(Path.Combine(Folder, Library.FileName), Library.Places()[0], "the first place");
                string package = Path.Combine(Folder, "runtimes", LibraryFile.Here.Identifier, "native", Library.FileName);
                Expect.True(Library.Places().Contains(package), $"{package} is not looked at");
            });
        }

        [Test]
        private static void FilesThatAreNoLibraryAreReported()
        {
            string text = Path.Combine(Folder, "text.so");
            File.WriteAllText(text, "no library");
            Refused(text, Result.Io, "is no shared library");
            File.WriteAllText(text, "");
            Refused(text, Result.Io, "is no shared library");
            // The system's own loader would crash on it.
            Refused(Changed("cut.so", head => { }), Result.Io, "cannot be loaded: it is cut off, 4096 bytes of ");
            // An invalid segment table, which is left to the system's loader.
            Refused(Changed("broken.so", head => head[54] = 1), Result.Io, "cannot be loaded: ");
        }

        [Test]
        private static void LibrariesOfAnotherProcessorOrSystemAreReported()
        {
            // ELF stores the machine type at offset 18.
            bool arm = LibraryFile.Here.Identifier == "linux-arm64";
            string other = arm ? "x64" : "arm64";
            Refused(Changed("other.so", head => head[18] = (byte)(arm ? 62 : 183)), Result.Unsupported, $"made for Linux on {other}", $"this process is {LibraryFile.Here}");
            Refused(Changed("x86.so", head => { head[4] = 1; head[18] = 3; }), Result.Unsupported, "made for Linux on x86");
            Refused(Changed("windows.dll", head =>
            {
                Array.Clear(head, 0, head.Length);
                new byte[] { (byte)'M', (byte)'Z' }.CopyTo(head, 0);
                head[60] = 128;
                new byte[] { (byte)'P', (byte)'E', 0, 0, 0x64, 0x86 }.CopyTo(head, 128);
            }), Result.Unsupported, "made for Windows on x64", $"Use the library for {LibraryFile.Here}");
            Refused(Changed("apple.dylib", head => new byte[] { 0xcf, 0xfa, 0xed, 0xfe, 0x0c, 0, 0, 1 }.CopyTo(head, 0)), Result.Unsupported, "macOS on arm64");
        }

        [Test]
        private static void IncompatibleVersionsAreReported()
        {
            string standIns = Program.Setting("CAIRN_TEST_STAND_INS");
            Refused(Path.Combine(standIns, "later.so"), Result.Unsupported, $"the binary interface {Native.ABI_VERSION + 1}, later than", "same release");
            Refused(Path.Combine(standIns, "earlier.so"), Result.Unsupported, $"the binary interface {Native.ABI_VERSION - 1}, earlier than");
            Refused(Path.Combine(standIns, "older.so"), Result.Unsupported, "is version 0.0.999, older than 0.1.0");
            Refused(Path.Combine(standIns, "incomplete.so"), Result.Unsupported, "has no cairn_result_name", "whole");
            Refused(Path.Combine(standIns, "other.so"), Result.Unsupported, "has no cairn_abi_version");
        }

        [Test]
        private static void AnEmptyPathIsRefused()
        {
            Expect.Throws<ArgumentNullException>(() => Library.Load(null));
            Expect.Throws<ArgumentException>(() => Library.Load(""));
        }

        [Test]
        private static void ThreadsLoadOneLibraryFromAPathOfAnyLetters()
        {
            Expect.True(Folder.Contains(' ') && Folder.Any(letter => letter > 127), $"{Folder} has no space or only Latin letters");
            WithVariable(null, () =>
            {
                var paths = new string[4];
                var threads = new Thread[paths.Length];
                for (int i = 0; i < threads.Length; i++)
                {
                    int own = i;
                    threads[i] = new Thread(() => paths[own] = Library.Path);
                    threads[i].Start();
                }
                foreach (Thread thread in threads) thread.Join();
                Expect.True(paths.All(path => path == Path.Combine(Folder, Library.FileName)), string.Join(", ", paths));
            });
            Expect.Equal(Native.ABI_VERSION, Library.AbiVersion);
            Expect.True(Library.Version >= new Version(0, 1, 0), Library.Version.ToString());
        }

        [Test]
        private static void ASecondLibraryInOneProcessIsRefused()
        {
            Library.Load(Library.Path);
            string second = Path.Combine(Program.Setting("CAIRN_TEST_STAND_INS"), "later.so");
            var thrown = Expect.Throws<InvalidOperationException>(() => Library.Load(second));
            Expect.Contains(second, thrown.Message);
            Expect.Contains(Library.Path, thrown.Message);
        }
    }
}
