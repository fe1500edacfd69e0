#include "CairnPipelineCache.h"

#if CAIRN_WITH_D3D12

#include "CairnLog.h"
#include "HAL/CriticalSection.h"
#include "HAL/FileManager.h"
#include "HAL/PlatformProcess.h"
#include "Misc/FileHelper.h"
#include "Misc/Paths.h"
#include "Misc/ScopeLock.h"

#include <cstring>

namespace
{
	FString PipelineFile()
	{
		return FPaths::ConvertRelativePathToFull(FPaths::ProjectSavedDir() + TEXT("Cairn/Pipelines.bin"));
	}
}

uint64_t FCairnPipelineCache::Load(void* Bytes, uint64_t Capacity, void* User)
{
	TArray64<uint8>& Content = static_cast<FCairnPipelineCache*>(User)->Loaded;
	if (Bytes == nullptr && !FFileHelper::LoadFileToArray(Content, *PipelineFile(), FILEREAD_Silent))
	{
		Content.Empty();
	}
	const uint64_t Size = static_cast<uint64_t>(Content.Num());
	if (Bytes != nullptr && Size <= Capacity)
	{
		std::memcpy(Bytes, Content.GetData(), static_cast<std::size_t>(Size));
	}
	return Size;
}

void FCairnPipelineCache::Store(const void* Bytes, uint64_t Size, void*)
{
	// Several streams, or another process of the project, may write at the same time. Each writes a whole file; the last move wins.
	static FCriticalSection Writing;
	const FScopeLock Locked(&Writing);
	const FString File = PipelineFile();
	const FString Part = FString::Printf(TEXT("%s.%u"), *File, FPlatformProcess::GetCurrentProcessId());
	const TArrayView<const uint8> Whole(static_cast<const uint8*>(Bytes), static_cast<int32>(Size));
	if (!FFileHelper::SaveArrayToFile(Whole, *Part) || !IFileManager::Get().Move(*File, *Part))
	{
		IFileManager::Get().Delete(*Part);
		UE_LOG(LogCairn, Warning, TEXT("%s cannot be written: the next run compiles its pipelines again"), *File);
	}
}

#endif
