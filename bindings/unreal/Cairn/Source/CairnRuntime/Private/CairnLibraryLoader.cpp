#include "CairnLibraryLoader.h"

#include "Interfaces/IPluginManager.h"
#include "Misc/Paths.h"

#if CAIRN_WITH_D3D12

#include "Windows/AllowWindowsPlatformTypes.h"
THIRD_PARTY_INCLUDES_START
#include "cairn_ld.h"
THIRD_PARTY_INCLUDES_END
#include "Windows/HideWindowsPlatformTypes.h"

namespace
{
	/** Whether the delay-loaded imports find this library by its name. If several have that name, Windows takes the one that was loaded first. */
	bool IsFoundByName(const cairn_ld& Loaded)
	{
		const HMODULE Found = LoadLibraryW(L"cairn.dll");
		if (Found != nullptr)
		{
			FreeLibrary(Found);
		}
		return Found == static_cast<HMODULE>(Loaded.library);
	}
}

FString CairnLibraryLoader::Load()
{
	const FString File = FPaths::ConvertRelativePathToFull(
		FPaths::Combine(CairnPluginFolder(), TEXT("Binaries/ThirdParty/Cairn/Win64/cairn.dll")));
	// It stays loaded for the delay-loaded imports.
	static cairn_ld Loaded;
	char Message[1024];
	if (cairn_ld_load(&Loaded, TCHAR_TO_UTF8(*File), Message, sizeof Message) != CAIRN_OK)
	{
		return FString(TEXT("Cairn: ")) + UTF8_TO_TCHAR(Message) +
			TEXT(". Copy the complete plugin from Cairn's Windows archive, and package the game again");
	}
	FString Why;
	if (Loaded.cairn_presenter_record_d3d12 == nullptr)
	{
		Why = FString::Printf(
			TEXT("Cairn: %s: the library is version %s, and the plugin was compiled for %s, which must be the same for Direct3D 12. ")
			TEXT("Put the cairn.dll of the plugin's own archive there, or compile the plugin of the library's archive"),
			*File, *CairnVersionText(Loaded.cairn_version()), *CairnVersionText(CAIRN_VERSION));
	}
	else if (!IsFoundByName(Loaded))
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

FString CairnVersionText(uint32 Version)
{
	return FString::Printf(TEXT("%u.%u.%u"), Version / 1000000, Version / 1000 % 1000, Version % 1000);
}

FString CairnPluginFolder()
{
	const TSharedPtr<IPlugin> Plugin = IPluginManager::Get().FindPlugin(TEXT("Cairn"));
	return Plugin.IsValid() ? Plugin->GetBaseDir() : FString();
}
