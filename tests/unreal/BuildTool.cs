// Declarations of the parts of Unreal's build tool that the plugin's Build.cs files use, rewritten from its public interface, and a program
// that runs them: it prints the requirements of each module of the plugin in the given folder.
using System;
using System.Collections.Generic;
using System.IO;

namespace UnrealBuildTool
{
    public class BuildException : Exception
    {
        public BuildException(string message) : base(message) { }
    }

    public struct UnrealTargetPlatform : IEquatable<UnrealTargetPlatform>
    {
        public static readonly UnrealTargetPlatform Win64 = new UnrealTargetPlatform("Win64");
        public static readonly UnrealTargetPlatform Linux = new UnrealTargetPlatform("Linux");
        private readonly string name;
        private UnrealTargetPlatform(string name) { this.name = name; }
        public bool Equals(UnrealTargetPlatform other) { return name == other.name; }
        public override bool Equals(object other) { return other is UnrealTargetPlatform && Equals((UnrealTargetPlatform)other); }
        public override int GetHashCode() { return name.GetHashCode(); }
        public static bool operator ==(UnrealTargetPlatform a, UnrealTargetPlatform b) { return a.Equals(b); }
        public static bool operator !=(UnrealTargetPlatform a, UnrealTargetPlatform b) { return !a.Equals(b); }
        public override string ToString() { return name; }
    }

    public class ReadOnlyTargetRules
    {
        public UnrealTargetPlatform Platform;
        internal string Plugin, Module;
    }

    public class RuntimeDependencyList
    {
        internal readonly List<string> All = new List<string>();
        public void Add(string path) { All.Add(path); }
    }

    public class ModuleRules
    {
        public enum ModuleType { CPlusPlus, External }
        public enum PCHUsageMode { Default, UseExplicitOrSharedPCHs }

        public ModuleType Type = ModuleType.CPlusPlus;
        public PCHUsageMode PCHUsage;
        public bool bUseUnity = true;
        public readonly List<string> PublicSystemIncludePaths = new List<string>();
        public readonly List<string> PublicAdditionalLibraries = new List<string>();
        public readonly List<string> PublicDelayLoadDLLs = new List<string>();
        public readonly List<string> PublicDependencyModuleNames = new List<string>();
        public readonly List<string> PrivateDependencyModuleNames = new List<string>();
        public readonly List<string> PrivateDefinitions = new List<string>();
        public readonly RuntimeDependencyList RuntimeDependencies = new RuntimeDependencyList();
        public string ModuleDirectory { get; private set; }
        public string PluginDirectory { get; private set; }

        public ModuleRules(ReadOnlyTargetRules target)
        {
            PluginDirectory = target.Plugin;
            ModuleDirectory = target.Module;
        }

        public void AddEngineThirdPartyPrivateStaticDependencies(ReadOnlyTargetRules target, params string[] names)
        {
            PrivateDependencyModuleNames.AddRange(names);
        }
    }

    internal static class Program
    {
        private static void Print(string name, IEnumerable<string> values)
        {
            foreach (string value in values) Console.WriteLine(name + " " + value.Replace('\\', '/'));
        }

        private static int Main(string[] arguments)
        {
            string plugin = Path.GetFullPath(arguments[0]);
            try
            {
                foreach (UnrealTargetPlatform platform in new[] { UnrealTargetPlatform.Win64, UnrealTargetPlatform.Linux })
                {
                    string source = Path.Combine(plugin, "Source");
                    ModuleRules library = new CairnLibrary(new ReadOnlyTargetRules
                    {
                        Platform = platform, Plugin = plugin, Module = Path.Combine(source, "ThirdParty", "CairnLibrary")
                    });
                    ModuleRules runtime = new CairnRuntime(new ReadOnlyTargetRules
                    {
                        Platform = platform, Plugin = plugin, Module = Path.Combine(source, "CairnRuntime")
                    });
                    foreach (ModuleRules module in new[] { library, runtime })
                    {
                        Console.WriteLine("module " + module.GetType().Name + " " + module.Type + " on " + platform);
                        Print("include", module.PublicSystemIncludePaths);
                        Print("library", module.PublicAdditionalLibraries);
                        Print("delayed", module.PublicDelayLoadDLLs);
                        Print("depends", module.PublicDependencyModuleNames);
                        Print("depends", module.PrivateDependencyModuleNames);
                        Print("define", module.PrivateDefinitions);
                        Print("needs", module.RuntimeDependencies.All);
                    }
                }
            }
            catch (BuildException why)
            {
                Console.WriteLine("error " + why.Message);
                return 1;
            }
            return 0;
        }
    }
}
