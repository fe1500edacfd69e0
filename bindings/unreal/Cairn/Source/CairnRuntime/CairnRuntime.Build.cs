using UnrealBuildTool;

/// <summary>
/// The module is not called Cairn because the build tool would then define CAIRN_API for it, which is a name in cairn.h.
/// </summary>
public class CairnRuntime : ModuleRules
{
	public CairnRuntime(ReadOnlyTargetRules Target) : base(Target)
	{
		PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
		// Only one file includes the system's header; without unity builds the others stay free of it.
		bUseUnity = false;

		PublicDependencyModuleNames.AddRange(new string[] { "Core", "CoreUObject", "Engine", "InputCore", "RenderCore" });
		PrivateDependencyModuleNames.AddRange(new string[] { "CairnLibrary", "ImageCore", "ImageWrapper", "Projects", "RHI" });

		bool bHasD3D12 = Target.Platform == UnrealTargetPlatform.Win64;
		if (bHasD3D12)
		{
			PrivateDependencyModuleNames.Add("D3D12RHI");
			AddEngineThirdPartyPrivateStaticDependencies(Target, "DX12");
		}
		PrivateDefinitions.Add("CAIRN_WITH_D3D12=" + (bHasD3D12 ? "1" : "0"));
	}
}
