using System.IO;
using UnrealBuildTool;

/// <summary>
/// The library itself: its headers, its import library, and the files that a game must ship. cairn.dll is delay-loaded by the runtime module,
/// so that a game whose copy is missing or wrong can report that.
/// </summary>
public class CairnLibrary : ModuleRules
{
	public CairnLibrary(ReadOnlyTargetRules Target) : base(Target)
	{
		Type = ModuleType.External;

		string Headers = Path.Combine(ModuleDirectory, "include");
		if (!File.Exists(Path.Combine(Headers, "cairn.h")))
		{
			throw new BuildException("The plugin Cairn has no library: " + Headers + " has no cairn.h. Take the folder unreal/Cairn " +
				"of Cairn's Windows archive, which is whole; the plugin in Cairn's repository is filled by cargo xtask dist.");
		}
		PublicSystemIncludePaths.Add(Headers);

		if (Target.Platform == UnrealTargetPlatform.Win64)
		{
			PublicAdditionalLibraries.Add(Path.Combine(ModuleDirectory, "lib", "cairn.lib"));
			PublicDelayLoadDLLs.Add("cairn.dll");

			string Libraries = Path.Combine(PluginDirectory, "Binaries", "ThirdParty", "Cairn", "Win64");
			string[] Names =
			{
				"cairn.dll", "onnxruntime.dll", "DirectML.dll", "amd_fidelityfx_loader_dx12.dll", "amd_fidelityfx_framegeneration_dx12.dll",
				"amd_fidelityfx_upscaler_dx12.dll", "amd_fidelityfx_dx12.dll"
			};
			foreach (string Name in Names)
			{
				// The slim archive does not contain Microsoft's libraries, and no archive contains AMD's.
				if (File.Exists(Path.Combine(Libraries, Name)))
				{
					RuntimeDependencies.Add("$(PluginDir)/Binaries/ThirdParty/Cairn/Win64/" + Name);
				}
			}
		}
		RuntimeDependencies.Add("$(PluginDir)/Resources/place.ppm");
	}
}
