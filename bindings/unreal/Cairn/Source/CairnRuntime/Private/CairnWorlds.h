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

/** Cairn's devices on the engine's device, and the loaded worlds. Equal worlds are loaded once. Any thread. */
class FCairnWorlds
{
public:
#if CAIRN_WITH_D3D12
	/** Why Cairn cannot use the engine's graphics device, with the setting to change; empty if it can. */
	static FString GetUnavailableReason();

	/** The device that frames are made on. */
	cairn::result<FCairnDevice> FrameDevice();

	/**
	 * Returns a world that is loaded already, or loads it from its file. Progress gets the progress, 0 to 1; returning false ends the load.
	 *
	 * File: empty for the world inside the library. Threads: of the processor, 0 for one per core.
	 */
	cairn::result<FCairnWorld> Load(
		const FString& File, const FString& OperatingPoint, ECairnAnchors Anchors, int32 Threads,
		TFunctionRef<bool(float)> Progress);

private:
	struct FWorldEntry
	{
		FString Name;
		/** Held during a load, so that others wait for it and do not load the world a second time. */
		FCriticalSection Loading;
		TWeakPtr<cairn::world, ESPMode::ThreadSafe> World;
	};

	cairn::result<FCairnDevice> AnchorDevice(ECairnAnchors Anchors, int32 Threads);

	FCriticalSection Lock;
	FCairnDevice Graphics;
	TArray<TSharedPtr<FWorldEntry, ESPMode::ThreadSafe>> Worlds;
#endif
};
