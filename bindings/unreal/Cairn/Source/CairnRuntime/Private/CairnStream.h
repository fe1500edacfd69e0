#pragma once

#include "CairnInput.h"
#include "CairnPictures.h"
#include "CairnTypes.h"
#include "CairnWorlds.h"
#include "CoreMinimal.h"
#include "HAL/CriticalSection.h"
#include "HAL/Event.h"
#include "HAL/Runnable.h"
#include "HAL/RunnableThread.h"
#include "Templates/RefCounting.h"

#include <atomic>

/** What a stream is made of. */
struct FCairnSettings
{
	FString World;
	FString OperatingPoint;
	ECairnAnchors Anchors = ECairnAnchors::Graphics;
	int32 Threads = 0;
	int64 Seed = 0;
	FCairnPicture Picture;
	int32 Multiplier = 4;
	bool bLetterbox = false;
	/** Frames are linear light, and not sRGB. */
	bool bLinear = false;
	/** Pixels of the target, where it is known before; zero for the world's own size. */
	FIntPoint TargetSize = FIntPoint(0, 0);
	float FrameBudgetMs = 0.0f;
	FString BudgetSchedules;
};

#if CAIRN_WITH_D3D12

struct ID3D12Fence;

/** A rollout on a thread of its own, and the presenter that shows its anchors. What is not said otherwise: any thread. */
class FCairnStream final : public FRunnable
{
public:
	static TSharedRef<FCairnStream, ESPMode::ThreadSafe> Start(
		FCairnSettings Settings, TSharedRef<FCairnWorlds, ESPMode::ThreadSafe> Worlds);
	virtual ~FCairnStream() override;

	/** Ends all that goes on, soon. Does not wait. */
	void RequestStop();
	/** Whether the thread and all frames on the device have ended, so that nothing waits when the stream goes. */
	bool HasEnded() const;
	/**
	 * Stops the thread and waits for it; what frames on the device may still use is left to the end of the process. For the end of the
	 * engine, where nobody comes back to see that they have ended.
	 */
	void Abandon();

	/** How far the world is loaded, 0 to 1. */
	float GetProgress() const { return Progress; }
	/** The size of the world's pictures; zero before it is loaded. */
	FIntPoint GetSize() const;
	/** Why it has ended by itself; empty while it has not. */
	FString GetFailure() const;
	/** Ends it with that message, for whoever asks for it to tell. The first one stays. */
	void Fail(const FString& Message);

	void SetPaused(bool bHold);
	/** Makes a picture the world's next one. */
	void Append(FCairnPicture Picture);
	FCairnInput Input;

	/** Whether a frame is due that is not in the target yet. Game thread, which draws it then. */
	bool IsDue(uint64 NowNs, FIntPoint Size);
	/** Whether a frame was drawn. */
	bool HasDrawn() const { return bDrawn; }
	FCairnStatistics GetStatistics() const;

	/**
	 * Records the frame that is due into a list, at the size of a target that is in COPY_DEST. Where the engine writes its lists, one call
	 * at a time. The value that the engine is to give GetFence behind the list; 0 where nothing was recorded, as before the first anchor.
	 */
	uint64 Record(ID3D12GraphicsCommandList* List, ID3D12Resource* Texture, uint64 NowNs);
	ID3D12Fence* GetFence() const { return Fence; }

	virtual uint32 Run() override;
	virtual void Stop() override { RequestStop(); }

private:
	FCairnStream(FCairnSettings InSettings, TSharedRef<FCairnWorlds, ESPMode::ThreadSafe> InWorlds);

	cairn::result<void> Prepare();
	cairn::result<void> PrepareFrames(FIntPoint Size);
	cairn::result<void> FollowTarget();
	cairn::result<void> Play();
	cairn::result<void> Give(const cairn::anchor& Anchor);
	cairn::result<bool> Wait(uint64 UntilNs);
	void EndThread();

	FCairnSettings Settings;
	const TSharedRef<FCairnWorlds, ESPMode::ThreadSafe> Worlds;
	TUniquePtr<FRunnableThread> Thread;
	FEventRef Changed{EEventMode::AutoReset};

	std::atomic<bool> bStopping{false};
	std::atomic<bool> bEnded{false};
	std::atomic<bool> bReady{false};
	std::atomic<bool> bPaused{false};
	std::atomic<bool> bDrawn{false};
	std::atomic<float> Progress{0.0f};

	/** Over what follows. */
	mutable FCriticalSection Lock;
	FString Failure;
	FIntPoint WorldSize = FIntPoint(0, 0);
	/** Of the target that was recorded into last; zero before. */
	FIntPoint WantedSize = FIntPoint(0, 0);
	TArray<FCairnPicture> Edits;
	/** For RequestStop; null where there is none. */
	const cairn::rollout* Cancellable = nullptr;
	cairn::frame Shown;

	/** Made by the thread before bReady, and left alone by it after. In this order: what is below is destroyed first. */
	FCairnDevice Device;
	FCairnWorld World;
	cairn::rollout Rollout;
	cairn::presenter Presenter;
	uint32 KnownKeys = 0;
	FIntPoint AnchorSize = FIntPoint(0, 0);
	/** Of the thread: what frames are prepared for. */
	FIntPoint PreparedSize = FIntPoint(0, 0);

	/** Of the game thread: what it had drawn last. */
	cairn::frame Asked;
	FIntPoint AskedSize = FIntPoint(0, 0);

	/** Of where lists are written: the size that the presenter was told. */
	FIntPoint RecordedSize = FIntPoint(0, 0);

	/** Gets a value behind each list with a frame. Until then the presenter keeps what the list copies from. Made by the thread before bReady. */
	TRefCountPtr<ID3D12Fence> Fence;
	std::atomic<uint64> Recorded{0};
};

#else

/** Where there is no Direct3D 12 none is ever made. */
class FCairnStream
{
public:
	void RequestStop() {}
	bool HasEnded() const { return true; }
	void Abandon() {}
};

#endif
