#pragma once

#include "CairnTypes.h"
#include "CoreMinimal.h"
#include "HAL/CriticalSection.h"
#include "Templates/Function.h"

#if CAIRN_WITH_D3D12
#include <cairn.hpp>

using FCairnDevice = TSharedPtr<cairn::device, ESPMode::ThreadSafe>;
using FCairnWorld = TSharedPtr<cairn::world, ESPMode::ThreadSafe>;
#endif

/** Cairn's devices on the engine's, and the worlds that were loaded on them: those that are the same are loaded once. Any thread. */
class FCairnWorlds
{
public:
#if CAIRN_WITH_D3D12
	/** Why the engine's graphics device is none for Cairn, with the setting to change; empty where it is one. */
	static FString WhyImpossible();

	/** The device that frames are made on. */
	cairn::result<FCairnDevice> Frames();

	/**
	 * A world, from anybody who has loaded it or from its file. Progress gets how far it is, 0 to 1, and ends the load by answering false.
	 *
	 * File: nothing for the world inside the library. Threads: for the processor, 0 for one for each core.
	 */
	cairn::result<FCairnWorld> Load(
		const FString& File, const FString& OperatingPoint, ECairnAnchors Anchors, int32 Threads,
		TFunctionRef<bool(float)> Progress);

private:
	struct FLoaded
	{
		FString Name;
		/** Held while it is loaded, so that others wait for it and do not load it a second time. */
		FCriticalSection Loading;
		TWeakPtr<cairn::world, ESPMode::ThreadSafe> World;
	};

	cairn::result<FCairnDevice> Maker(ECairnAnchors Anchors, int32 Threads);

	FCriticalSection Lock;
	FCairnDevice Graphics;
	TArray<TSharedPtr<FLoaded, ESPMode::ThreadSafe>> Worlds;
#endif
};
