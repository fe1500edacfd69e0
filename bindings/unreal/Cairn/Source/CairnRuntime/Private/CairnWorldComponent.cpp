#include "CairnWorldComponent.h"

#include "CairnInput.h"
#include "CairnLibraryLoader.h"
#include "CairnLog.h"
#include "CairnPass.h"
#include "CairnRuntimeModule.h"
#include "CairnStream.h"
#include "CairnWorldSubsystem.h"
#include "Engine/GameInstance.h"
#include "Engine/TextureRenderTarget2D.h"
#include "Engine/World.h"
#include "GameFramework/PlayerController.h"
#include "Misc/Paths.h"
#include "RenderGraphBuilder.h"
#include "RenderGraphUtils.h"
#include "RenderingThread.h"
#include "TextureResource.h"

UCairnWorldComponent::UCairnWorldComponent()
{
	PrimaryComponentTick.bCanEverTick = true;
	Keys = CairnDefaultKeys();
}

void UCairnWorldComponent::BeginPlay()
{
	Super::BeginPlay();
	// A server shows nothing; in the editor it may run beside its clients, on the same device and with the same render target.
	if (bStartOnBeginPlay && !IsNetMode(NM_DedicatedServer))
	{
		Start();
	}
}

void UCairnWorldComponent::EndPlay(const EEndPlayReason::Type Reason)
{
	Stop();
	Super::EndPlay(Reason);
}

void UCairnWorldComponent::BeginDestroy()
{
	// A component that was started before the game began gets no EndPlay.
	Stop();
	Super::BeginDestroy();
}

bool UCairnWorldComponent::IsPlaying() const
{
	return Stream.IsValid();
}

void UCairnWorldComponent::Stop()
{
	if (Stream.IsValid())
	{
		FCairnRuntimeModule::Retire(MoveTemp(Stream));
		Stream.Reset();
	}
}

void UCairnWorldComponent::Fail(const FString& Message)
{
	Stop();
	UE_LOG(LogCairn, Error, TEXT("%s"), *Message);
	// The event's handler may start the component again.
	OnError.Broadcast(Message);
}

#if CAIRN_WITH_D3D12

namespace
{
	bool ReadTarget(UTextureRenderTarget2D* From, FCairnPicture& Out)
	{
		FTextureRenderTargetResource* const Resource = From->GameThread_GetRenderTargetResource();
		const EPixelFormat Format = From->GetFormat();
		TArray<FColor> Colours;
		bool bRead = false;
		if (Resource != nullptr && Format == PF_FloatRGBA)
		{
			// ReadPixels stretches floats between the least and the largest of the picture as soon as one is above 1.
			TArray<FLinearColor> Light;
			bRead = Resource->ReadLinearColorPixels(Light);
			Colours.Reserve(Light.Num());
			for (const FLinearColor& One : Light)
			{
				Colours.Add(One.ToFColor(true));
			}
		}
		else if (Resource != nullptr && (Format == PF_B8G8R8A8 || Format == PF_R8G8B8A8 || Format == PF_A2B10G10R10))
		{
			bRead = Resource->ReadPixels(Colours);
		}
		// ReadPixels asserts on some of the other formats.
		if (!bRead || Colours.Num() != From->SizeX * From->SizeY)
		{
			return false;
		}
		Out = CairnPictureOf(Colours, From->SizeX, From->SizeY);
		return true;
	}

	/** A relative path starts at the project's folder. */
	FString FullPath(const FString& Path)
	{
		// The project's folder itself is relative to the program's file.
		return Path.IsEmpty() ? Path : FPaths::ConvertRelativePathToFull(FPaths::ConvertRelativePathToFull(FPaths::ProjectDir()), Path);
	}
}

void UCairnWorldComponent::Start()
{
	Stop();
	const UWorld* const Level = GetWorld();
	const UGameInstance* const Game = Level != nullptr ? Level->GetGameInstance() : nullptr;
	const UCairnWorldSubsystem* const Shared = Game != nullptr ? Game->GetSubsystem<UCairnWorldSubsystem>() : nullptr;
	if (Shared == nullptr || !Shared->GetWorlds().IsValid())
	{
		Fail(TEXT("Cairn: there is no running game around the component. Start it from BeginPlay or later"));
		return;
	}
	const FString Why = Shared->GetUnavailableReason();
	if (!Why.IsEmpty())
	{
		Fail(Why);
		return;
	}
	FCairnSettings Settings;
	FString Wrong;
	if (SeedTarget != nullptr)
	{
		if (!ReadTarget(SeedTarget, Settings.Picture))
		{
			Wrong = TEXT("Cairn: SeedTarget cannot be read. Give it the format RTF RGBA8, RGBA8 SRGB, RGB10A2 or RGBA16f, and draw into it before the component starts");
		}
	}
	else
	{
		const FString File = SeedPicture.FilePath.IsEmpty() ? FPaths::Combine(CairnPluginFolder(), TEXT("Resources/place.ppm"))
															: FullPath(SeedPicture.FilePath);
		(void)CairnReadPicture(File, Settings.Picture, Wrong);
	}
	const EPixelFormat Format = bDrawIntoTarget && Target != nullptr ? Target->GetFormat() : PF_B8G8R8A8;
	if (Format != PF_B8G8R8A8 && Format != PF_R8G8B8A8 && Format != PF_FloatRGBA)
	{
		Wrong = TEXT("Cairn: Target has a format that frames do not go into. Set its Render Target Format to RTF RGBA8 SRGB, or to RTF RGBA16f");
	}
	if (!Wrong.IsEmpty())
	{
		Fail(Wrong);
		return;
	}
	Settings.World = FullPath(WorldBundle.FilePath);
	Settings.OperatingPoint = OperatingPoint;
	Settings.Anchors = Anchors;
	Settings.Threads = Threads;
	Settings.Seed = Seed;
	Settings.Multiplier = Multiplier;
	Settings.bLetterbox = bLetterbox;
	Settings.bLinear = bDrawIntoTarget ? Format == PF_FloatRGBA : bLinearFrames;
	Settings.TargetSize = bDrawIntoTarget && Target != nullptr ? FIntPoint(Target->SizeX, Target->SizeY) : FIntPoint(0, 0);
	Settings.FrameBudgetMs = FrameBudgetMs;
	Settings.BudgetSchedules = BudgetSchedules;
	bReadyFired = false;
	LastProgress = -1.0f;
	Stream = FCairnStream::Start(MoveTemp(Settings), Shared->GetWorlds().ToSharedRef());
}

void UCairnWorldComponent::SetPaused(bool bPaused)
{
	if (Stream.IsValid())
	{
		Stream->SetPaused(bPaused);
	}
}

void UCairnWorldComponent::AppendRenderTarget(UTextureRenderTarget2D* Picture)
{
	FCairnPicture Read;
	if (!Stream.IsValid())
	{
		return;
	}
	if (Picture == nullptr || !ReadTarget(Picture, Read))
	{
		UE_LOG(
			LogCairn, Warning,
			TEXT("Cairn: the picture of AppendRenderTarget cannot be read, and the world goes on without it. Give it the format RTF RGBA8, RGBA8 SRGB, "
				 "RGB10A2 or RGBA16f, and draw into it before"));
		return;
	}
	Stream->Append(MoveTemp(Read));
}

void UCairnWorldComponent::SetKey(FKey Key, bool bDown)
{
	if (!Stream.IsValid())
	{
		return;
	}
	for (const FCairnKey& Known : Keys)
	{
		if (Known.Key == Key)
		{
			Stream->Input.SetKey(Known.VirtualKey > 0 ? Known.VirtualKey : CairnVirtualKey(Key), bDown);
			return;
		}
	}
	Stream->Input.SetKey(CairnVirtualKey(Key), bDown);
}

void UCairnWorldComponent::AddMouse(float Right, float Down)
{
	if (Stream.IsValid())
	{
		Stream->Input.AddMouse(Right, Down);
	}
}

void UCairnWorldComponent::AddScroll(float Up)
{
	if (Stream.IsValid())
	{
		Stream->Input.AddScroll(Up);
	}
}

FCairnStatistics UCairnWorldComponent::GetStatistics() const
{
	return Stream.IsValid() ? Stream->GetStatistics() : FCairnStatistics();
}

void UCairnWorldComponent::TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction)
{
	Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
	if (!Stream.IsValid())
	{
		return;
	}
	Stream->NoteTick(CairnNow());
	const FString Failure = Stream->GetFailure();
	if (!Failure.IsEmpty())
	{
		Fail(Failure);
		return;
	}
	const float Progress = Stream->GetProgress();
	if (Progress != LastProgress)
	{
		LastProgress = Progress;
		OnProgress.Broadcast(Progress);
	}
	// An event's handler may have stopped the component.
	if (Stream.IsValid() && bReadPlayerInput)
	{
		ReadPlayerInput();
	}
	if (Stream.IsValid() && !bReadyFired && Stream->HasDrawn())
	{
		bReadyFired = true;
		OnReady.Broadcast();
	}
	if (Stream.IsValid() && bDrawIntoTarget && Stream->GetSize().X > 0 && MakeTarget())
	{
		Draw();
	}
}

void UCairnWorldComponent::ReadPlayerInput()
{
	const UWorld* const Level = GetWorld();
	APlayerController* const Player = Level != nullptr ? Level->GetFirstPlayerController() : nullptr;
	if (Player == nullptr)
	{
		return;
	}
	for (const FCairnKey& Known : Keys)
	{
		Stream->Input.SetKey(Known.VirtualKey > 0 ? Known.VirtualKey : CairnVirtualKey(Known.Key), Player->IsInputKeyDown(Known.Key));
	}
	float Right = 0.0f;
	float Up = 0.0f;
	Player->GetInputMouseDelta(Right, Up);
	Stream->Input.AddMouse(Right * MouseScale, -Up * MouseScale);
	const int32 Notches = (Player->WasInputKeyJustPressed(EKeys::MouseScrollUp) ? 1 : 0) -
		(Player->WasInputKeyJustPressed(EKeys::MouseScrollDown) ? 1 : 0);
	Stream->Input.AddScroll(static_cast<float>(Notches));
}

/** Ensures that there is a target: makes one if none was given, and resizes it for another world. Returns whether there is one. */
bool UCairnWorldComponent::MakeTarget()
{
	const FIntPoint Size = Stream->GetSize();
	const bool bMissing = Target == nullptr;
	if (bMissing)
	{
		MadeTarget = NewObject<UTextureRenderTarget2D>(this);
		MadeTarget->RenderTargetFormat = RTF_RGBA8_SRGB;
		Target = MadeTarget;
	}
	if (bMissing || (Target == MadeTarget && FIntPoint(Target->SizeX, Target->SizeY) != Size))
	{
		Target->InitAutoFormat(static_cast<uint32>(Size.X), static_cast<uint32>(Size.Y));
		Target->UpdateResourceImmediate(true);
	}
	return Target->SizeX > 0 && Target->SizeY > 0;
}

/** Has the render thread draw the frame that is due, if it differs from the last one. */
void UCairnWorldComponent::Draw()
{
	const uint64 Now = CairnNow();
	FTextureRenderTargetResource* const Resource = Target->GameThread_GetRenderTargetResource();
	if (Resource == nullptr || !Stream->IsDue(Now, Resource, FIntPoint(Target->SizeX, Target->SizeY)))
	{
		return;
	}
	ENQUEUE_RENDER_COMMAND(CairnDraw)([Drawn = Stream.ToSharedRef(), Resource, Now](FRHICommandListImmediate& RHICmdList)
	{
		FRHITexture* const Texture = Resource->GetRenderTargetTexture();
		if (Texture == nullptr)
		{
			return;
		}
		FRDGBuilder GraphBuilder(RHICmdList, RDG_EVENT_NAME("Cairn"));
		CairnAddPass(GraphBuilder, RegisterExternalTexture(GraphBuilder, Texture, TEXT("Cairn.Target")), Drawn, Now);
		GraphBuilder.Execute();
	});
}

#else

void UCairnWorldComponent::Start()
{
	bReadyFired = false;
	LastProgress = -1.0f;
	Fail(FCairnRuntimeModule::Get().GetUnavailableReason());
}

void UCairnWorldComponent::SetPaused(bool) {}
void UCairnWorldComponent::AppendRenderTarget(UTextureRenderTarget2D*) {}
void UCairnWorldComponent::SetKey(FKey, bool) {}
void UCairnWorldComponent::AddMouse(float, float) {}
void UCairnWorldComponent::AddScroll(float) {}

FCairnStatistics UCairnWorldComponent::GetStatistics() const
{
	return FCairnStatistics();
}

void UCairnWorldComponent::TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction)
{
	Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
}

void UCairnWorldComponent::ReadPlayerInput() {}
void UCairnWorldComponent::Draw() {}

bool UCairnWorldComponent::MakeTarget()
{
	return false;
}

#endif
