using System;
using System.ComponentModel;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>The system's loader of shared libraries. Takes full paths, so that it never loads another library of the same name.</summary>
    internal static class Loader
    {
        /// <summary>Loads a file; returns zero and the reason on failure.</summary>
        internal static IntPtr Open(string path, out string why)
        {
            why = "";
            if (RuntimeInformation.IsOSPlatform(OSPlatform.Windows))
            {
                // The library's dependencies are searched beside it, not beside the program.
                const uint AlteredSearchPath = 8;
                IntPtr module = Windows.LoadLibraryExW(path, IntPtr.Zero, AlteredSearchPath);
                if (module == IntPtr.Zero) why = new Win32Exception(Marshal.GetLastWin32Error()).Message;
                return module;
            }
            const int Now = 2;
            byte[] name = Text.Encode(path, nameof(path));
            IntPtr found = OfUnix<IntPtr>(() => Apple.dlopen(name, Now), () => Linux.dlopen(name, Now), () => Other.dlopen(name, Now));
            if (found == IntPtr.Zero) why = Text.Decode(OfUnix<IntPtr>(Apple.dlerror, Linux.dlerror, Other.dlerror));
            return found;
        }

        /// <summary>Address of a function; zero if the library has none of that name.</summary>
        internal static IntPtr Symbol(IntPtr library, string name)
        {
            if (RuntimeInformation.IsOSPlatform(OSPlatform.Windows)) return Windows.GetProcAddress(library, name);
            return OfUnix<IntPtr>(
                () => Apple.dlsym(library, name), () => Linux.dlsym(library, name), () => Other.dlsym(library, name));
        }

        private static T OfUnix<T>(Func<T> apple, Func<T> linux, Func<T> other)
        {
            if (RuntimeInformation.IsOSPlatform(OSPlatform.OSX)) return apple();
            try
            {
                return linux();
            }
            catch (DllNotFoundException)
            {
                // A C library with a built-in loader and without a file of glibc's name.
                return other();
            }
        }

        private static class Windows
        {
            [DllImport("kernel32", CharSet = CharSet.Unicode, ExactSpelling = true, SetLastError = true)]
            internal static extern IntPtr LoadLibraryExW(string path, IntPtr file, uint flags);

            [DllImport("kernel32", CharSet = CharSet.Ansi, ExactSpelling = true, BestFitMapping = false)]
            internal static extern IntPtr GetProcAddress(IntPtr module, string name);
        }

        private static class Linux
        {
            private const string From = "libdl.so.2";

            [DllImport(From)]
            internal static extern IntPtr dlopen(byte[] path, int flags);

            [DllImport(From, CharSet = CharSet.Ansi, BestFitMapping = false)]
            internal static extern IntPtr dlsym(IntPtr library, string name);

            [DllImport(From)]
            internal static extern IntPtr dlerror();
        }

        private static class Other
        {
            private const string From = "libc";

            [DllImport(From)]
            internal static extern IntPtr dlopen(byte[] path, int flags);

            [DllImport(From, CharSet = CharSet.Ansi, BestFitMapping = false)]
            internal static extern IntPtr dlsym(IntPtr library, string name);

            [DllImport(From)]
            internal static extern IntPtr dlerror();
        }

        private static class Apple
        {
            private const string From = "/usr/lib/libSystem.dylib";

            [DllImport(From)]
            internal static extern IntPtr dlopen(byte[] path, int flags);

            [DllImport(From, CharSet = CharSet.Ansi, BestFitMapping = false)]
            internal static extern IntPtr dlsym(IntPtr library, string name);

            [DllImport(From)]
            internal static extern IntPtr dlerror();
        }
    }
}
