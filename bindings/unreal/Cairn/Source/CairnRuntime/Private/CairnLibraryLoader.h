#pragma once

#include "CoreMinimal.h"

/** Finds the library's file and checks that this plugin was compiled for it. */
namespace CairnLibraryLoader
{
	/** Loads the library from the plugin's own folder for the rest of the process. Returns why it failed and what to do; empty on success. */
	FString Load();
}

/** A library version as text, such as "0.1.0". */
FString CairnVersionText(uint32 Version);

/** The plugin's folder. */
FString CairnPluginFolder();
