using System;
using System.Collections.Generic;
using System.IO;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>
    /// The shared library: its search paths and the loaded file. It is loaded at first use and stays loaded until the process ends.
    /// </summary>
    public static class Library
    {
        /// <summary>Environment variable with the path of the library; if set, no other path is searched.</summary>
        public const string Variable = "CAIRN_LIBRARY";

        private static readonly object Loading = new object();
        private static volatile Loaded loaded;

        /// <summary>The name of the library's file on this system.</summary>
        public static string FileName
        {
            get
            {
                if (RuntimeInformation.IsOSPlatform(OSPlatform.Windows)) return "cairn.dll";
                return RuntimeInformation.IsOSPlatform(OSPlatform.OSX) ? "libcairn.dylib" : "libcairn.so";
            }
        }

        /// <summary>The file that is loaded.</summary>
        /// <exception cref="LibraryException">It is missing, or is not compatible.</exception>
        public static string Path
        {
            get { return Get().Path; }
        }

        /// <summary>The version of the loaded library.</summary>
        /// <exception cref="LibraryException">It is missing, or is not compatible.</exception>
        public static Version Version
        {
            get { return Dotted(Get().Number); }
        }

        /// <summary>Version of the binary interface of this assembly, which the loaded library must have.</summary>
        public static int AbiVersion
        {
            get { return Native.ABI_VERSION; }
        }

        /// <summary>All functions; loads the library if necessary.</summary>
        internal static Native.Functions C
        {
            get { return Get().Functions; }
        }

        /// <summary>
        /// The paths that are searched, in this order: if <see cref="Variable"/> is set, only its path; otherwise beside this assembly and beside
        /// the program, including the folders in which packages keep the files of each system.
        /// </summary>
        public static IReadOnlyList<string> Places()
        {
            string named = Environment.GetEnvironmentVariable(Variable);
            if (!string.IsNullOrEmpty(named)) return new[] { System.IO.Path.GetFullPath(named) };
            var places = new List<string>();
            // Empty if the assembly is bundled into the program's file.
            string assembly = typeof(Library).Assembly.Location;
            string beside = string.IsNullOrEmpty(assembly) ? null : System.IO.Path.GetDirectoryName(assembly);
            string package = System.IO.Path.Combine("runtimes", LibraryFile.Here.Identifier, "native");
            foreach (string folder in new[] { beside, AppContext.BaseDirectory })
            {
                if (string.IsNullOrEmpty(folder)) continue;
                foreach (string below in new[] { "", package })
                {
                    string place = System.IO.Path.GetFullPath(System.IO.Path.Combine(folder, below, FileName));
                    if (!places.Contains(place)) places.Add(place);
                }
            }
            return places;
        }

        /// <summary>Loads a library by its path. Call this before anything else here; repeating it with the loaded path is allowed.</summary>
        /// <param name="path">The file, for example <see cref="FileName"/> in your folder.</param>
        /// <exception cref="LibraryException">It is missing or not compatible; another path may be tried.</exception>
        /// <exception cref="InvalidOperationException">The process uses another file already.</exception>
        public static void Load(string path)
        {
            if (path == null) throw new ArgumentNullException(nameof(path));
            if (path.Length == 0) throw new ArgumentException("It is empty. Name the library's file", nameof(path));
            string whole = System.IO.Path.GetFullPath(path);
            lock (Loading)
            {
                if (loaded == null) loaded = new Loaded(whole);
                if (loaded.Path != whole)
                {
                    throw new InvalidOperationException(
                        $"{whole}: this process uses {loaded.Path} already. Name the library before anything else of Cairn is used");
                }
            }
        }

        private static Loaded Get()
        {
            Loaded found = loaded;
            if (found != null) return found;
            lock (Loading)
            {
                if (loaded == null) loaded = new Loaded(Find());
                return loaded;
            }
        }

        /// <summary>The first path that exists.</summary>
        internal static string Find()
        {
            IReadOnlyList<string> places = Places();
            foreach (string place in places)
            {
                if (File.Exists(place)) return place;
            }
            string named = Environment.GetEnvironmentVariable(Variable);
            throw new LibraryException(
                string.IsNullOrEmpty(named) ? FileName : Variable,
                "Cairn's library was not found; looked at " + string.Join(", ", places),
                $"Put {FileName} beside the program, or set {Variable} to its path");
        }

        internal static Version Dotted(uint version)
        {
            return new Version((int)(version / 1000000), (int)(version / 1000 % 1000), (int)(version % 1000));
        }

        /// <summary>A loaded library: both versions are checked, and every function was found.</summary>
        private sealed class Loaded : Native.IResolver
        {
            internal readonly string Path;
            internal readonly uint Number;
            internal readonly Native.Functions Functions;
            private readonly IntPtr module;

            internal Loaded(string path)
            {
                const string Remedy = "Use library and assembly of the same release";
                Path = path;
                if (!File.Exists(path))
                {
                    throw new LibraryException(path, "there is no such file", $"Name the file {FileName} of a release of Cairn");
                }
                LibraryFile.RequireFit(path);
                string why;
                module = Loader.Open(path, out why);
                if (module == IntPtr.Zero)
                {
                    throw new LibraryException(path, $"cannot be loaded: {why}", "Name the whole library, and have beside it what it needs");
                }
                uint abi = Resolve<Native.abi_version_function>("cairn_abi_version")();
                if (abi != Native.ABI_VERSION)
                {
                    string age = abi > Native.ABI_VERSION ? "later" : "earlier";
                    throw new LibraryException(
                        path, $"has the binary interface {abi}, {age} than {Native.ABI_VERSION}, which this assembly was made for", Remedy, Result.Unsupported);
                }
                Number = Resolve<Native.version_function>("cairn_version")();
                if (Number < Native.VERSION)
                {
                    throw new LibraryException(
                        path, $"is version {Dotted(Number)}, older than {Dotted(Native.VERSION)}, which this assembly was made for", Remedy, Result.Unsupported);
                }
                Functions = new Native.Functions(this);
            }

            public T Resolve<T>(string name) where T : class
            {
                IntPtr function = Loader.Symbol(module, name);
                if (function == IntPtr.Zero)
                {
                    throw new LibraryException(Path, $"has no {name}", "Name the file that is Cairn's library, and whole", Result.Unsupported);
                }
                return Marshal.GetDelegateForFunctionPointer<T>(function);
            }
        }
    }
}
