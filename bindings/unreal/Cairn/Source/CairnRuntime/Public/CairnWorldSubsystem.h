#pragma once

#include "CoreMinimal.h"
#include "CairnTypes.h"
#include "Subsystems/GameInstanceSubsystem.h"

#include "CairnWorldSubsystem.generated.h"

class FCairnWorlds;

/** Shared by all components of a game: Cairn's devices, the loaded worlds, and checks before a world is shown. */
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

	/** Why no world can be shown, with a remedy, in English; empty if one can. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	FString GetUnavailableReason() const;

	/** Requirements for the graphics device and what was found, to show to a player. Takes a fraction of a second the first time. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	TArray<FCairnRequirement> GetRequirements() const;

	/** The library's version, such as "0.1.0"; empty if it is not loaded. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	FString GetLibraryVersion() const;

	/** For components. Null before Initialize and after Deinitialize. */
	TSharedPtr<FCairnWorlds, ESPMode::ThreadSafe> GetWorlds() const { return Worlds; }

private:
	TSharedPtr<FCairnWorlds, ESPMode::ThreadSafe> Worlds;
};
