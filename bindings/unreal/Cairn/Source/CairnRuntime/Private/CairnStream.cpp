#include "CairnStream.h"

#if CAIRN_WITH_D3D12

#include "CairnEngine.h"
#include "CairnPass.h"
#include "CairnPipelineCache.h"
#include "HAL/PlatformProcess.h"
#include "HAL/PlatformTime.h"
#include "Misc/ScopeLock.h"

#include <utility>

namespace
{
	/** Recorded frames that may wait for the device: render thread, RHI thread and device have some each. */
	constexpr uint32 PendingLists = 6;

	/** Milliseconds; longer than the device takes for the frames that were submitted. */
	constexpr uint32 LongestFrameMs = 2000;

	/** The thread's longest sleep, so that it reacts to changes within this time. */
	constexpr uint32 LongestSleepMs = 50;
	/** A game that has not ticked for so long is paused or in the background. */
	constexpr uint64 LongestTickNs = 500000000;

	// Blueprints see the library's own frame source numbers.
	static_assert(static_cast<uint32>(ECairnFrameSource::Anchor) == CAIRN_FRAME_ANCHOR, "as in cairn.h");
	static_assert(static_cast<uint32>(ECairnFrameSource::Decoded) == CAIRN_FRAME_DECODED, "as in cairn.h");
	static_assert(static_cast<uint32>(ECairnFrameSource::Generated) == CAIRN_FRAME_GENERATED, "as in cairn.h");
	static_assert(static_cast<uint32>(ECairnFrameSource::Extrapolated) == CAIRN_FRAME_EXTRAPOLATED, "as in cairn.h");
	static_assert(static_cast<uint32>(ECairnFrameSource::Held) == CAIRN_FRAME_HELD, "as in cairn.h");

	cairn::picture PictureOf(const FCairnPicture& From)
	{
		return cairn::picture_of(
			cairn::span<const unsigned char>(From.Pixels.GetData(), static_cast<std::size_t>(From.Pixels.Num())),
			static_cast<uint32>(From.Width), static_cast<uint32>(From.Height), CAIRN_FORMAT_BGRA8);
	}
}

uint64 CairnNow()
{
	return static_cast<uint64>(FPlatformTime::Seconds() * 1e9);
}

FCairnStream::FCairnStream(FCairnSettings InSettings, TSharedRef<FCairnWorlds, ESPMode::ThreadSafe> InWorlds)
	: Settings(MoveTemp(InSettings)), Worlds(MoveTemp(InWorlds))
{
}

TSharedRef<FCairnStream, ESPMode::ThreadSafe> FCairnStream::Start(
	FCairnSettings InSettings, TSharedRef<FCairnWorlds, ESPMode::ThreadSafe> InWorlds)
{
	const TSharedRef<FCairnStream, ESPMode::ThreadSafe> Made =
		MakeShareable(new FCairnStream(MoveTemp(InSettings), MoveTemp(InWorlds)));
	FCairnStream& Stream = *Made;
	Stream.Thread.Reset(FRunnableThread::Create(&Stream, TEXT("Cairn anchors"), 0, TPri_BelowNormal));
	if (!Stream.Thread.IsValid())
	{
		Stream.bEnded = true;
		Stream.Fail(TEXT("Cairn: no thread can be started. End other programs"));
	}
	return Made;
}

FCairnStream::~FCairnStream()
{
	EndThread();
}

void FCairnStream::EndThread()
{
	RequestStop();
	if (Thread.IsValid())
	{
		Thread->WaitForCompletion();
		// The engine's thread object calls Stop again in its destructor, so it is destroyed while everything that Stop uses exists.
		Thread.Reset();
	}
}

void FCairnStream::RequestStop()
{
	const FScopeLock Locked(&Lock);
	bStopping = true;
	if (Cancellable != nullptr)
	{
		(void)Cancellable->cancel();
	}
	Changed->Trigger();
}

bool FCairnStream::HasEnded() const
{
	return bEnded && (!Fence.IsValid() || Fence->GetCompletedValue() >= Recorded);
}

void FCairnStream::Abandon()
{
	EndThread();
	// The device soon finishes the lists that were submitted.
	for (uint32 WaitedMs = 0; !HasEnded() && WaitedMs < LongestFrameMs; WaitedMs++)
	{
		FPlatformProcess::Sleep(0.001f);
	}
	if (!HasEnded())
	{
		// The presenter's destructor would wait for frames that the engine may never submit, and the device may still signal the fence: leak it.
		(void)Presenter.release();
		Fence->AddRef();
	}
}

FIntPoint FCairnStream::GetSize() const
{
	const FScopeLock Locked(&Lock);
	return WorldSize;
}

FString FCairnStream::GetFailure() const
{
	const FScopeLock Locked(&Lock);
	return Failure;
}

void FCairnStream::Fail(const FString& Message)
{
	{
		const FScopeLock Locked(&Lock);
		if (!Failure.IsEmpty())
		{
			return;
		}
		Failure = Message;
	}
	RequestStop();
}

void FCairnStream::NoteTick(uint64 NowNs)
{
	LastTickNs = NowNs;
}

void FCairnStream::SetPaused(bool bHold)
{
	bPaused = bHold;
	Changed->Trigger();
}

void FCairnStream::Append(FCairnPicture Picture)
{
	const FScopeLock Locked(&Lock);
	Edits.Add(MoveTemp(Picture));
	Changed->Trigger();
}

/* ---- The thread: anchors ----------------------------------------------------------------------------------------- */

uint32 FCairnStream::Run()
{
	cairn::result<void> Done = Prepare();
	if (Done.ok())
	{
		Done = Play();
	}
	{
		const FScopeLock Locked(&Lock);
		Cancellable = nullptr;
	}
	if (!Done.ok() && !(bStopping && Done.code() == CAIRN_ERROR_CANCELLED))
	{
		Fail(UTF8_TO_TCHAR(Done.why().what()));
	}
	bEnded = true;
	return 0;
}

/** Loads the world and prepares everything needed to show it. */
cairn::result<void> FCairnStream::Prepare()
{
	cairn::result<FCairnDevice> Frames = Worlds->FrameDevice();
	if (!Frames.ok())
	{
		return Frames.why();
	}
	Device = *Frames;
	ID3D12Device* const Engine = GetID3D12DynamicRHI()->RHIGetDevice(CairnEngine::DeviceIndex);
	if (FAILED(Engine->CreateFence(0, D3D12_FENCE_FLAG_NONE, IID_PPV_ARGS(Fence.GetInitReference()))))
	{
		return cairn::error(CAIRN_ERROR_DEVICE, "ID3D12Device::CreateFence failed: the graphics device is gone. Start the game again");
	}
	cairn::result<FCairnWorld> Loaded = Worlds->Load(
		Settings.World, Settings.OperatingPoint, Settings.Anchors, Settings.Threads, [this](float Part)
		{
			Progress = Part;
			return !bStopping;
		});
	if (!Loaded.ok())
	{
		return Loaded.why();
	}
	World = *Loaded;
	Progress = 1.0f;
	const cairn::result<cairn::world_info> Info = World->info();
	if (!Info.ok())
	{
		return Info.why();
	}
	KnownKeys = Info->keys;

	cairn::rollout_options RolloutOptions;
	RolloutOptions.seed = static_cast<uint64>(Settings.Seed);
	cairn::result<cairn::rollout> MadeRollout = cairn::rollout::create(*World, RolloutOptions);
	if (!MadeRollout.ok())
	{
		return MadeRollout.why();
	}
	Rollout = MoveTemp(*MadeRollout);

	cairn::presenter_options Shape;
	Shape.multiplier = static_cast<uint32>(FMath::Max(Settings.Multiplier, 0));
	// With one frame to an anchor nothing is generated, not even when the next anchor is late.
	Shape.flags = CAIRN_PRESENTER_CATCH_UP | (Settings.Multiplier == 1 ? CAIRN_PRESENTER_HOLD_LATE : 0u) |
		(Settings.bLetterbox ? CAIRN_PRESENTER_LETTERBOX : 0u);
	Shape.colour_space = Settings.bLinear ? CAIRN_COLOUR_LINEAR : CAIRN_COLOUR_SRGB;
	cairn::result<cairn::presenter> MadePresenter = cairn::presenter::create(Shape);
	if (!MadePresenter.ok())
	{
		return MadePresenter.why();
	}
	Presenter = MoveTemp(*MadePresenter);
	AnchorSize = FIntPoint(static_cast<int32>(Info->render_width), static_cast<int32>(Info->render_height));
	const cairn::result<void> Prepared = PrepareFrames(Settings.TargetSize.X > 0 ? Settings.TargetSize : AnchorSize);
	if (!Prepared.ok())
	{
		return Prepared.why();
	}

	if (Settings.FrameBudgetMs > 0.0f)
	{
		const FTCHARToUTF8 Schedules(*Settings.BudgetSchedules);
		cairn::budget Budget;
		Budget.frame_ns = static_cast<uint64>(static_cast<double>(Settings.FrameBudgetMs) * 1e6);
		Budget.schedules = Settings.BudgetSchedules.IsEmpty() ? nullptr : Schedules.Get();
		Budget.presenter = Presenter.get();
		const cairn::result<void> Governed = Rollout.govern(Budget);
		if (!Governed.ok())
		{
			return Governed.why();
		}
	}
	const FScopeLock Locked(&Lock);
	WorldSize = AnchorSize;
	Cancellable = &Rollout;
	if (bStopping)
	{
		return cairn::error(CAIRN_ERROR_CANCELLED, "stopped");
	}
	return {};
}

/** Creates pipelines, memory and AMD's contexts for frames of a size, so that recording a frame creates nothing. */
cairn::result<void> FCairnStream::PrepareFrames(FIntPoint Size)
{
	cairn::d3d12_preparation Preparation;
	Preparation.width = static_cast<uint32>(Size.X);
	Preparation.height = static_cast<uint32>(Size.Y);
	Preparation.anchor_width = static_cast<uint32>(AnchorSize.X);
	Preparation.anchor_height = static_cast<uint32>(AnchorSize.Y);
	Preparation.lists = PendingLists;
	FCairnPipelineCache Cache;
	Preparation.load = FCairnPipelineCache::Load;
	Preparation.store = FCairnPipelineCache::Store;
	Preparation.user = &Cache;
	const cairn::result<bool> Prepared = Presenter.prepare_d3d12(*Device, Preparation);
	if (!Prepared.ok())
	{
		return Prepared.why();
	}
	PreparedSize = Size;
	return {};
}

/** Prepares frames again if the size of the target has changed. */
cairn::result<void> FCairnStream::PrepareForTarget()
{
	FIntPoint Size(0, 0);
	{
		const FScopeLock Locked(&Lock);
		Size = LastTargetSize;
	}
	return Size.X > 0 && Size != PreparedSize ? PrepareFrames(Size) : cairn::result<void>();
}

/** Makes anchors at the world's rate until the thread is stopped. */
cairn::result<void> FCairnStream::Play()
{
	cairn::result<cairn::step_info> Made = Rollout.append(PictureOf(Settings.Picture));
	const cairn::result<cairn::rollout_info> Info = Rollout.info();
	if (!Made.ok() || !Info.ok())
	{
		return Made.ok() ? Info.why() : Made.why();
	}
	// Loading may have taken longer than a tick may.
	LastTickNs = CairnNow();
	// The player's input while the world was loading is not for its first step. Keys that are still held stay held.
	(void)Input.Take(KnownKeys);
	const uint64 Interval = 1000000000 / FMath::Max<uint32>(Info->latents_per_second, 1);
	// Start of the next step: one interval after that of the step before, however long that took.
	uint64 NextNs = CairnNow() + Interval;
	for (;;)
	{
		const cairn::result<cairn::anchor> Anchor = Rollout.anchor();
		if (!Anchor.ok())
		{
			return Anchor.why();
		}
		const cairn::result<void> Pushed = PushAnchor(*Anchor);
		if (!Pushed.ok())
		{
			return Pushed.why();
		}
		const cairn::result<bool> Continues = Wait(NextNs);
		if (!Continues.ok() || !*Continues)
		{
			return Continues.ok() ? cairn::result<void>() : Continues.why();
		}
		// A late anchor does not make the next ones come faster.
		NextNs = FMath::Max(NextNs + Interval, CairnNow());
		FCairnPicture Edit;
		{
			const FScopeLock Locked(&Lock);
			if (Edits.Num() > 0)
			{
				Edit = MoveTemp(Edits[0]);
				Edits.RemoveAt(0);
			}
		}
		Made = Edit.Width > 0 ? Rollout.append(PictureOf(Edit)) : Rollout.step(Input.Take(KnownKeys));
		if (!Made.ok())
		{
			return Made.why();
		}
	}
}

/** Pushes an anchor to the presenter as soon as it has room. */
cairn::result<void> FCairnStream::PushAnchor(const cairn::anchor& Anchor)
{
	for (;;)
	{
		const cairn::result<bool> Pushed = Presenter.push(Anchor, CairnNow());
		if (!Pushed.ok())
		{
			return Pushed.why();
		}
		if (*Pushed)
		{
			bReady = true;
			return {};
		}
		if (bStopping)
		{
			return cairn::error(CAIRN_ERROR_CANCELLED, "stopped");
		}
		Changed->Wait(4);
	}
}

/**
 * Waits until a time, and while the stream is paused or the game does not tick. Prepares frames of a new size meanwhile. The player's input during a pause is discarded.
 * Returns false if the stream shall stop.
 */
cairn::result<bool> FCairnStream::Wait(uint64 UntilNs)
{
	bool bWasPaused = false;
	while (!bStopping)
	{
		const cairn::result<void> Prepared = PrepareForTarget();
		if (!Prepared.ok())
		{
			return Prepared.why();
		}
		const bool bHold = bPaused || CairnNow() > LastTickNs + LongestTickNs;
		if (bWasPaused && !bHold)
		{
			(void)Input.Take(KnownKeys);
		}
		bWasPaused = bHold;
		const uint64 Now = CairnNow();
		if (!bHold && Now >= UntilNs)
		{
			return true;
		}
		const uint64 LeftMs = bHold ? LongestSleepMs : (UntilNs - Now) / 1000000 + 1;
		Changed->Wait(static_cast<uint32>(FMath::Min<uint64>(LeftMs, LongestSleepMs)));
	}
	return false;
}

/* ---- Frames ------------------------------------------------------------------------------------------------------ */

bool FCairnStream::IsDue(uint64 NowNs, const void* InTarget, FIntPoint Size)
{
	if (!bReady || bStopping)
	{
		return false;
	}
	const cairn::result<std::optional<cairn::frame>> Due = Presenter.query(NowNs);
	if (!Due.ok())
	{
		Fail(UTF8_TO_TCHAR(Due.why().what()));
		return false;
	}
	const bool bRedraw = bMustRedraw.exchange(false);
	// A frame that is in the target already is not drawn again.
	if (!*Due || (!bRedraw && InTarget == RequestedTarget && Size == RequestedSize && (**Due).position == RequestedFrame.position && (**Due).since_ns == RequestedFrame.since_ns &&
		(**Due).source == RequestedFrame.source))
	{
		return false;
	}
	RequestedFrame = **Due;
	RequestedTarget = InTarget;
	RequestedSize = Size;
	return true;
}

uint64 FCairnStream::Record(ID3D12GraphicsCommandList* List, ID3D12Resource* Texture, uint64 NowNs)
{
	// A game that adds the pass itself need not know whether the thread is ready.
	if (!bReady || bStopping)
	{
		return 0;
	}
	const D3D12_RESOURCE_DESC Shape = Texture->GetDesc();
	const FIntPoint Size(static_cast<int32>(Shape.Width), static_cast<int32>(Shape.Height));
	if (Size != RecordedSize)
	{
		const cairn::result<void> Resized = Presenter.resize(static_cast<uint32>(Size.X), static_cast<uint32>(Size.Y));
		if (!Resized.ok())
		{
			Fail(UTF8_TO_TCHAR(Resized.why().what()));
			return 0;
		}
		RecordedSize = Size;
		// The thread prepares frames of this size. Until then the nearest anchor is shown.
		const FScopeLock Locked(&Lock);
		LastTargetSize = Size;
		Changed->Trigger();
	}
	cairn::d3d12_recording Recording;
	Recording.state_before = Recording.state_after = static_cast<uint32>(D3D12_RESOURCE_STATE_COPY_DEST);
	Recording.list = List;
	Recording.target = Texture;
	Recording.fence = Fence;
	Recording.fence_value = Recorded + 1;
	const cairn::result<std::optional<cairn::frame>> Drawn = Presenter.record_d3d12(*Device, NowNs, Recording);
	if (!Drawn.ok())
	{
		Fail(UTF8_TO_TCHAR(Drawn.why().what()));
		return 0;
	}
	// There is no anchor yet, or all prepared lists wait for the device: the target keeps its content.
	if (!*Drawn)
	{
		bMustRedraw = true;
		return 0;
	}
	// The frame that is due takes the place of an anchor as soon as its size is prepared.
	if (((**Drawn).flags & CAIRN_FRAME_UNPREPARED) != 0)
	{
		bMustRedraw = true;
	}
	{
		const FScopeLock Locked(&Lock);
		ShownFrame = **Drawn;
	}
	bDrawn = true;
	return ++Recorded;
}

FCairnStatistics FCairnStream::GetStatistics() const
{
	FCairnStatistics Made;
	if (!bReady)
	{
		return Made;
	}
	const cairn::result<cairn::rollout_statistics> Anchors = Rollout.statistics();
	const cairn::result<cairn::presenter_statistics> Frames = Presenter.statistics();
	if (Anchors.ok())
	{
		Made.Anchors = static_cast<int64>(Anchors->latents);
		const uint64 Taken =
			Anchors->encode_ns + Anchors->denoise_ns + Anchors->cache_ns + Anchors->commit_ns + Anchors->decode_ns;
		Made.AnchorMs = static_cast<float>(static_cast<double>(Taken) / 1e6 / static_cast<double>(FMath::Max<uint64>(Anchors->latents, 1)));
	}
	if (Frames.ok())
	{
		Made.LateAnchors = static_cast<int64>(Frames->late_anchors);
		Made.Generated = static_cast<int64>(Frames->shown_generated + Frames->shown_extrapolated);
		Made.Unprepared = static_cast<int64>(Frames->unprepared);
		Made.Frames = Made.Generated + static_cast<int64>(Frames->shown_anchors + Frames->shown_decoded + Frames->shown_held);
		Made.FrameMs = static_cast<float>(static_cast<double>(Frames->device_frame_last_ns) / 1e6);
		Made.Generator = UTF8_TO_TCHAR(Frames->generator);
		Made.Preference = UTF8_TO_TCHAR(Frames->preference);
	}
	if (bDrawn)
	{
		const FScopeLock Locked(&Lock);
		Made.Shown = ShownFrame.source <= CAIRN_FRAME_HELD ? static_cast<ECairnFrameSource>(ShownFrame.source) : ECairnFrameSource::Held;
		Made.ShownAnchor = static_cast<int64>(ShownFrame.previous);
	}
	return Made;
}

#endif
