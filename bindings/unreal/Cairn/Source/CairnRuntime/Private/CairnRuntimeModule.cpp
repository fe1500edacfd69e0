#include "CairnRuntimeModule.h"

#include "CairnLibraryLoader.h"
#include "CairnLog.h"
#include "CairnStream.h"
#include "Modules/ModuleManager.h"
#include "RenderingThread.h"

#include <cairn.hpp>

DEFINE_LOG_CATEGORY(LogCairn);

IMPLEMENT_MODULE(FCairnRuntimeModule, CairnRuntime)

#if CAIRN_WITH_D3D12
namespace
{
	void OnLog(uint32_t Level, const char* Target, const char* Message, void*)
	{
		const FString Text = FString(UTF8_TO_TCHAR(Target)) + TEXT(": ") + UTF8_TO_TCHAR(Message);
		switch (Level)
		{
		case CAIRN_LOG_ERROR: UE_LOG(LogCairn, Error, TEXT("%s"), *Text); break;
		case CAIRN_LOG_WARNING: UE_LOG(LogCairn, Warning, TEXT("%s"), *Text); break;
		case CAIRN_LOG_INFO: UE_LOG(LogCairn, Log, TEXT("%s"), *Text); break;
		default: UE_LOG(LogCairn, Verbose, TEXT("%s"), *Text); break;
		}
	}
}
#endif

FCairnRuntimeModule& FCairnRuntimeModule::Get()
{
	return FModuleManager::LoadModuleChecked<FCairnRuntimeModule>(TEXT("CairnRuntime"));
}

void FCairnRuntimeModule::StartupModule()
{
	Why = CairnLibraryLoader::Load();
	if (!Why.IsEmpty())
	{
		// No world was requested yet. An error would fail a cook, which needs none.
		UE_LOG(LogCairn, Warning, TEXT("%s"), *Why);
		return;
	}
#if CAIRN_WITH_D3D12
	(void)cairn::set_log_callback(CAIRN_LOG_INFO, OnLog);
#endif
	Ticker = FTSTicker::GetCoreTicker().AddTicker(FTickerDelegate::CreateRaw(this, &FCairnRuntimeModule::Tick), 0.1f);
}

void FCairnRuntimeModule::ShutdownModule()
{
	if (!Why.IsEmpty())
	{
		return;
	}
	FTSTicker::GetCoreTicker().RemoveTicker(Ticker);
	// Render commands hold streams and run code of this module.
	FlushRenderingCommands();
	for (const TSharedPtr<FCairnStream, ESPMode::ThreadSafe>& Stream : Retired)
	{
		Stream->Abandon();
	}
	Retired.Empty();
#if CAIRN_WITH_D3D12
	(void)cairn::set_log_callback(CAIRN_LOG_OFF, nullptr);
#endif
}

void FCairnRuntimeModule::Retire(TSharedPtr<FCairnStream, ESPMode::ThreadSafe> Stream)
{
	Stream->RequestStop();
	if (FCairnRuntimeModule* const Module = FModuleManager::GetModulePtr<FCairnRuntimeModule>(TEXT("CairnRuntime")))
	{
		Module->Retired.Add(MoveTemp(Stream));
	}
	else
	{
		Stream->Abandon();
	}
}

bool FCairnRuntimeModule::Tick(float)
{
	for (int32 i = Retired.Num() - 1; i >= 0; i--)
	{
		// Render commands also hold a reference until they have run.
		if (Retired[i].GetSharedReferenceCount() == 1 && Retired[i]->HasEnded())
		{
			Retired.RemoveAt(i);
		}
	}
	return true;
}
