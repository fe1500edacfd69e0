#pragma once

#include "CoreMinimal.h"
#include "CairnTypes.h"
#include "Subsystems/GameInstanceSubsystem.h"

#include "CairnWorldSubsystem.generated.h"

class FCairnWorlds;

/** What the components of a game share: Cairn's devices and the worlds that are loaded, and what is asked before a world is shown. */
UCLASS()
class CAIRNRUNTIME_API UCairnWorldSubsystem : public UGameInstanceSubsystem
{
	GENERATED_BODY()

public:
	virtual void Initialize(FSubsystemCollectionBase& Collection) override;
	virtual void Deinitialize() override;

	/** Whether a world can be shown here. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	bool IsAvailable() const;

	/** Why none can be, with what to do, in English; empty where one can. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	FString GetUnavailableReason() const;

	/** What a graphics device needs and what was found, to show a player. Takes a fraction of a second the first time. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	TArray<FCairnRequirement> GetRequirements() const;

	/** The library's version, such as "0.1.0"; empty where it is not loaded. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	FString GetLibraryVersion() const;

	/** For components: null before Initialize and after Deinitialize. */
	TSharedPtr<FCairnWorlds, ESPMode::ThreadSafe> GetWorlds() const { return Worlds; }

private:
	TSharedPtr<FCairnWorlds, ESPMode::ThreadSafe> Worlds;
};
