#include "CairnWorlds.h"

#include "DynamicRHI.h"
#include "Misc/ScopeLock.h"
#include "MultiGPU.h"
#include "RHI.h"

#if CAIRN_WITH_D3D12

#include "CairnEngine.h"

FString FCairnWorlds::GetUnavailableReason()
{
	if (GDynamicRHI == nullptr || RHIGetInterfaceType() != ERHIInterfaceType::D3D12)
	{
		return FString::Printf(
			TEXT("Cairn: frames are made by Direct3D 12, and the engine runs on %s. Set Project Settings > Platforms > Windows > Default ")
			TEXT("RHI to DirectX 12 and start the editor again, or start the game with -d3d12"),
			GDynamicRHI != nullptr ? GDynamicRHI->GetName() : TEXT("nothing"));
	}
	// With several cards the engine does not signal external fences.
	if (FRHIGPUMask::All().GetNumActive() > 1)
	{
		return TEXT("Cairn: the engine renders on several graphics cards, and Cairn on one only. Start the game without -MaxGPUCount");
	}
	return FString();
}

cairn::result<FCairnDevice> FCairnWorlds::FrameDevice()
{
	const FScopeLock Locked(&Lock);
	if (!Graphics.IsValid())
	{
		ID3D12DynamicRHI* const RHI = GetID3D12DynamicRHI();
		cairn::result<cairn::device> Made =
			cairn::device::d3d12(RHI->RHIGetDevice(CairnEngine::DeviceIndex), RHI->RHIGetCommandQueue());
		if (!Made.ok())
		{
			return Made.why();
		}
		Graphics = MakeShared<cairn::device, ESPMode::ThreadSafe>(MoveTemp(*Made));
	}
	return Graphics;
}

cairn::result<FCairnDevice> FCairnWorlds::AnchorDevice(ECairnAnchors Anchors, int32 Threads)
{
	if (Anchors == ECairnAnchors::Graphics)
	{
		return FrameDevice();
	}
	cairn::device_options Options;
	Options.threads = static_cast<uint32>(FMath::Max(Threads, 0));
	cairn::result<cairn::device> Made = cairn::device::cpu(Options);
	if (!Made.ok())
	{
		return Made.why();
	}
	return FCairnDevice(MakeShared<cairn::device, ESPMode::ThreadSafe>(MoveTemp(*Made)));
}

cairn::result<FCairnWorld> FCairnWorlds::Load(
	const FString& File, const FString& OperatingPoint, ECairnAnchors Anchors, int32 Threads, TFunctionRef<bool(float)> Progress)
{
	// The thread count matters on the processor only; on the graphics device the world is the same with any.
	const FString Name = FString::Printf(
		TEXT("%d|%d|%s|%s"), static_cast<int32>(Anchors), Anchors == ECairnAnchors::Processor ? Threads : 0, *OperatingPoint, *File);
	TSharedPtr<FWorldEntry, ESPMode::ThreadSafe> Loaded;
	{
		const FScopeLock Locked(&Lock);
		for (const TSharedPtr<FWorldEntry, ESPMode::ThreadSafe>& Known : Worlds)
		{
			if (Known->Name == Name)
			{
				Loaded = Known;
			}
		}
		if (!Loaded.IsValid())
		{
			Loaded = MakeShared<FWorldEntry, ESPMode::ThreadSafe>();
			Loaded->Name = Name;
			Worlds.Add(Loaded);
		}
	}
	const FScopeLock Locked(&Loaded->Loading);
	FCairnWorld World = Loaded->World.Pin();
	if (World.IsValid())
	{
		return World;
	}
	cairn::result<FCairnDevice> Device = AnchorDevice(Anchors, Threads);
	if (!Device.ok())
	{
		return Device.why();
	}
	const FTCHARToUTF8 Path(*File);
	const FTCHARToUTF8 Point(*OperatingPoint);
	cairn::world_options Options;
	Options.path = File.IsEmpty() ? nullptr : Path.Get();
	Options.operating_point = OperatingPoint.IsEmpty() ? nullptr : Point.Get();
	cairn::result<cairn::world> Made = cairn::world::load(**Device, Options, [&Progress](const cairn::load_progress& Now)
	{
		// Reading counts as the first half and preparing as the second, whatever their durations.
		const float Part = Now.total > 0 ? static_cast<float>(Now.done) / static_cast<float>(Now.total) : 0.0f;
		return Progress(Now.stage == CAIRN_LOAD_READING ? Part / 2.0f : 0.5f + Part / 2.0f);
	});
	if (!Made.ok())
	{
		return Made.why();
	}
	World = MakeShared<cairn::world, ESPMode::ThreadSafe>(MoveTemp(*Made));
	Loaded->World = World;
	return World;
}

#endif
