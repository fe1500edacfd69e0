using System;
using System.IO;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>
    /// Reads the system and processor for which a shared library was built from the file's header. The system's loader would report a
    /// mismatch only as a failure to load.
    /// </summary>
    internal sealed class LibraryFile
    {
        /// <summary>The system and processor of this process.</summary>
        internal static readonly LibraryFile Here = OfProcess();

        private readonly string system;
        private readonly string processor;

        /// <summary>Minimum file size in bytes, if known; the system's loader may crash on a truncated file.</summary>
        private long whole;

        private LibraryFile(string system, string processor)
        {
            this.system = system;
            this.processor = processor;
        }

        /// <summary>The name that packages use, such as "linux-x64".</summary>
        internal string Identifier
        {
            get { return (system == "Windows" ? "win" : system == "macOS" ? "osx" : "linux") + "-" + processor; }
        }

        public override string ToString()
        {
            return $"{system} on {processor}";
        }

        /// <summary>Throws if a file is no library for this process. A file that cannot be read is left to the system's loader.</summary>
        internal static void RequireFit(string path)
        {
            LibraryFile found;
            long length;
            try
            {
                using (FileStream file = File.OpenRead(path))
                {
                    length = file.Length;
                    found = Read(file);
                }
            }
            catch (Exception why) when (why is IOException || why is UnauthorizedAccessException)
            {
                throw new LibraryException(path, $"cannot be read: {why.Message}", "Make it a file that this user may read");
            }
            if (found == null)
            {
                throw new LibraryException(path, "is no shared library", $"Name the file {Library.FileName} of a release of Cairn");
            }
            bool otherProcessor = found.processor != null && found.processor != Here.processor;
            if (found.system != Here.system || otherProcessor)
            {
                throw new LibraryException(
                    path, $"is made for {found}, and this process is {Here}",
                    $"Use the library for {Here}, or a process of the library's kind", Result.Unsupported);
            }
            if (length < found.whole)
            {
                throw new LibraryException(
                    path, $"cannot be loaded: it is cut off, {length} bytes of {found.whole} at least", "Copy the whole file again");
            }
        }

        /// <summary>Null if it is no library.</summary>
        internal static LibraryFile Read(Stream file)
        {
            byte[] head = Bytes(file, 0, 64);
            if (Starts(head, 0x7f, (byte)'E', (byte)'L', (byte)'F'))
            {
                // Little-endian, as all supported processors.
                if (head[5] != 1) return new LibraryFile("Linux", "another processor");
                bool wide = head[4] == 2;
                return new LibraryFile("Linux", OfElf(Number(head, 18, 2), wide)) { whole = wide ? WholeElf(file, head) : 0 };
            }
            if (Starts(head, (byte)'M', (byte)'Z'))
            {
                byte[] second = Bytes(file, Number(head, 60, 4), 6);
                return Starts(second, (byte)'P', (byte)'E', 0, 0) ? new LibraryFile("Windows", OfPe(Number(second, 4, 2))) : null;
            }
            if (Starts(head, 0xcf, 0xfa, 0xed, 0xfe))
            {
                long kind = Number(head, 4, 4);
                return new LibraryFile("macOS", kind == 0x01000007 ? "x64" : kind == 0x0100000c ? "arm64" : "another processor");
            }
            // A universal binary for several processors.
            if (Starts(head, 0xca, 0xfe, 0xba, 0xbe)) return new LibraryFile("macOS", null);
            return null;
        }

        /// <summary>End of the last segment of a 64-bit ELF file.</summary>
        private static long WholeElf(Stream file, byte[] head)
        {
            long table = Number(head, 32, 8);
            int size = (int)Number(head, 54, 2);
            int count = (int)Number(head, 56, 2);
            long end = table + size * count;
            // A file without a header of this format is not a library; the system's loader reports that.
            if (table < 0 || size < 56) return 0;
            for (int i = 0; i < count && table + (i + 1) * size <= file.Length; i++)
            {
                byte[] segment = Bytes(file, table + i * size, 56);
                end = Math.Max(end, Number(segment, 8, 8) + Number(segment, 32, 8));
            }
            return end;
        }

        private static LibraryFile OfProcess()
        {
            string system = RuntimeInformation.IsOSPlatform(OSPlatform.Windows) ? "Windows"
                : RuntimeInformation.IsOSPlatform(OSPlatform.OSX) ? "macOS" : "Linux";
            return new LibraryFile(system, RuntimeInformation.ProcessArchitecture.ToString().ToLowerInvariant());
        }

        private static string OfElf(long machine, bool wide)
        {
            switch (machine)
            {
                case 3: return "x86";
                // The x32 ABI has 32-bit ELF files.
                case 62: return wide ? "x64" : "x32";
                case 40: return "arm";
                case 183: return "arm64";
                default: return "another processor";
            }
        }

        private static string OfPe(long machine)
        {
            switch (machine)
            {
                case 0x014c: return "x86";
                case 0x8664: return "x64";
                case 0x01c4: return "arm";
                case 0xaa64: return "arm64";
                default: return "another processor";
            }
        }

        /// <summary>Reads bytes at an offset; those after the file's end are zero.</summary>
        private static byte[] Bytes(Stream file, long from, int count)
        {
            var bytes = new byte[count];
            file.Position = from;
            int have = 0;
            int more;
            while (have < count && (more = file.Read(bytes, have, count - have)) > 0) have += more;
            return bytes;
        }

        private static bool Starts(byte[] bytes, params byte[] with)
        {
            for (int i = 0; i < with.Length; i++)
            {
                if (bytes[i] != with[i]) return false;
            }
            return true;
        }

        private static long Number(byte[] bytes, int at, int size)
        {
            long number = 0;
            for (int i = size - 1; i >= 0; i--) number = number << 8 | bytes[at + i];
            return number;
        }
    }
}
