#pragma once

#include "CoreMinimal.h"
#include "Containers/Ticker.h"
#include "Modules/ModuleInterface.h"

class FCairnStream;

/** Loads the library, and lets go of what components leave behind once the device has done with it. */
class CAIRNRUNTIME_API FCairnRuntimeModule : public IModuleInterface
{
public:
	/** The module, which is loaded where it was not. */
	static FCairnRuntimeModule& Get();

	virtual void StartupModule() override;
	virtual void ShutdownModule() override;

	/** Why the library cannot be used, with what to do; empty where it can. */
	const FString& WhyNot() const { return Why; }

	/**
	 * Stops a stream, and keeps it until its thread and its frames have ended. Does not wait, but where the engine ends and the module is
	 * gone. Game thread.
	 */
	static void Retire(TSharedPtr<FCairnStream, ESPMode::ThreadSafe> Stream);

private:
	bool Tick(float Seconds);

	FString Why;
	TArray<TSharedPtr<FCairnStream, ESPMode::ThreadSafe>> Retired;
	FTSTicker::FDelegateHandle Ticker;
};
