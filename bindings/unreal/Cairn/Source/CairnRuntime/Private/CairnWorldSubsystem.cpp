#include "CairnWorldSubsystem.h"

#include "CairnLibraryLoader.h"
#include "CairnRuntimeModule.h"
#include "CairnWorlds.h"

void UCairnWorldSubsystem::Initialize(FSubsystemCollectionBase& Collection)
{
	Super::Initialize(Collection);
	Worlds = MakeShared<FCairnWorlds, ESPMode::ThreadSafe>();
}

void UCairnWorldSubsystem::Deinitialize()
{
	// Streams that still exist keep a reference.
	Worlds.Reset();
	Super::Deinitialize();
}

bool UCairnWorldSubsystem::IsAvailable() const
{
	return GetUnavailableReason().IsEmpty();
}

FString UCairnWorldSubsystem::GetUnavailableReason() const
{
	FString Why = FCairnRuntimeModule::Get().GetUnavailableReason();
#if CAIRN_WITH_D3D12
	if (Why.IsEmpty())
	{
		Why = FCairnWorlds::GetUnavailableReason();
	}
#endif
	return Why;
}

TArray<FCairnRequirement> UCairnWorldSubsystem::GetRequirements() const
{
	TArray<FCairnRequirement> Made;
#if CAIRN_WITH_D3D12
	if (!FCairnRuntimeModule::Get().GetUnavailableReason().IsEmpty())
	{
		return Made;
	}
	const cairn::result<std::vector<cairn::requirement>> Rows = cairn::requirements(CAIRN_DEVICE_D3D12);
	for (std::size_t i = 0; Rows.ok() && i < Rows->size(); i++)
	{
		const cairn::requirement& Row = (*Rows)[i];
		FCairnRequirement Requirement;
		Requirement.Needed = UTF8_TO_TCHAR(Row.needed);
		Requirement.Found = UTF8_TO_TCHAR(Row.found);
		Requirement.bMet = Row.status == CAIRN_REQUIREMENT_MET;
		Requirement.bOptional = Row.status == CAIRN_REQUIREMENT_OPTIONAL;
		Made.Add(Requirement);
	}
#endif
	return Made;
}

FString UCairnWorldSubsystem::GetLibraryVersion() const
{
#if CAIRN_WITH_D3D12
	if (FCairnRuntimeModule::Get().GetUnavailableReason().IsEmpty())
	{
		return CairnVersionText(cairn::version());
	}
#endif
	return FString();
}
