#pragma once

#include "CoreMinimal.h"

/** The library's file: where it is, and whether it is the one that this plugin was compiled for. */
namespace CairnLibraryLoader
{
	/** Loads the library from the plugin's own folder, for the rest of the process. Why that cannot be, with what to do; empty on success. */
	FString Load();
}

/** A version of the library as people write it, such as "0.1.0". */
FString CairnVersionText(uint32 Version);

/** Where the plugin's own files are. */
FString CairnPluginFolder();
