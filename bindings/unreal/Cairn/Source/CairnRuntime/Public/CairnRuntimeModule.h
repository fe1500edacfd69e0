#pragma once

#include "CoreMinimal.h"
#include "Containers/Ticker.h"
#include "Modules/ModuleInterface.h"

class FCairnStream;

/** Loads the library, and releases what components leave behind once the device has finished with it. */
class CAIRNRUNTIME_API FCairnRuntimeModule : public IModuleInterface
{
public:
	/** The module; loads it if necessary. */
	static FCairnRuntimeModule& Get();

	virtual void StartupModule() override;
	virtual void ShutdownModule() override;

	/** Why the library cannot be used, with a remedy; empty if it can. */
	const FString& GetUnavailableReason() const { return Why; }

	/**
	 * Stops a stream and keeps it until its thread and its frames have ended. Does not wait, unless the engine ends and the module no longer
	 * exists. Game thread.
	 */
	static void Retire(TSharedPtr<FCairnStream, ESPMode::ThreadSafe> Stream);

private:
	bool Tick(float Seconds);

	FString Why;
	TArray<TSharedPtr<FCairnStream, ESPMode::ThreadSafe>> Retired;
	FTSTicker::FDelegateHandle Ticker;
};
