#include "CairnLibraryLoader.h"

#include "Interfaces/IPluginManager.h"
#include "Misc/Paths.h"

#if CAIRN_WITH_D3D12

#include "Windows/AllowWindowsPlatformTypes.h"
THIRD_PARTY_INCLUDES_START
#include "cairn_ld.h"
THIRD_PARTY_INCLUDES_END
#include "Windows/HideWindowsPlatformTypes.h"

FString CairnLibraryLoader::Load()
{
	const FString File = FPaths::ConvertRelativePathToFull(
		FPaths::Combine(CairnPluginFolder(), TEXT("Binaries/ThirdParty/Cairn/Win64/cairn.dll")));
	// It stays loaded, and so the imports that the linker left for later find it by its name.
	static cairn_ld Loaded;
	char Message[1024];
	if (cairn_ld_load(&Loaded, TCHAR_TO_UTF8(*File), Message, sizeof Message) != CAIRN_OK)
	{
		return FString(TEXT("Cairn: ")) + UTF8_TO_TCHAR(Message) +
			TEXT(". Take the plugin whole from Cairn's Windows archive, and package the game anew");
	}
	FString Why;
	if (Loaded.cairn_presenter_record_d3d12 == nullptr)
	{
		const uint32 Version = Loaded.cairn_version();
		Why = FString::Printf(
			TEXT("Cairn: %s: the library is version %u.%u.%u, and the plugin was compiled for %u.%u.%u, which must be the same for ")
			TEXT("Direct3D 12. Put the cairn.dll of the plugin's own archive there, or compile the plugin of the library's archive"),
			*File, Version / 1000000, Version / 1000 % 1000, Version % 1000, static_cast<uint32>(CAIRN_VERSION) / 1000000,
			static_cast<uint32>(CAIRN_VERSION) / 1000 % 1000, static_cast<uint32>(CAIRN_VERSION) % 1000);
	}
	else if (GetModuleHandleW(L"cairn.dll") != static_cast<HMODULE>(Loaded.library))
	{
		Why = FString(TEXT("Cairn: the process has loaded another cairn.dll than ")) + File +
			TEXT(". Disable the other plugin that brings one, or remove the file beside the program");
	}
	if (!Why.IsEmpty())
	{
		cairn_ld_unload(&Loaded);
	}
	return Why;
}

#else

FString CairnLibraryLoader::Load()
{
	return TEXT("Cairn: frames are made by Direct3D 12, and this platform has none. Run the game on 64-bit Windows");
}

#endif

FString CairnPluginFolder()
{
	const TSharedPtr<IPlugin> Plugin = IPluginManager::Get().FindPlugin(TEXT("Cairn"));
	return Plugin.IsValid() ? Plugin->GetBaseDir() : FString();
}
