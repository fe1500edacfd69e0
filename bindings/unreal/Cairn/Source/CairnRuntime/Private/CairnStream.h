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

/** Settings of a stream. */
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
	/** Size of the target in pixels if it is known in advance; zero for the world's own size. */
	FIntPoint TargetSize = FIntPoint(0, 0);
	float FrameBudgetMs = 0.0f;
	FString BudgetSchedules;
};

#if CAIRN_WITH_D3D12

struct ID3D12Fence;

/** A rollout on a thread of its own, and the presenter that shows its anchors. Functions may be called on any thread unless stated. */
class FCairnStream final : public FRunnable
{
public:
	static TSharedRef<FCairnStream, ESPMode::ThreadSafe> Start(
		FCairnSettings InSettings, TSharedRef<FCairnWorlds, ESPMode::ThreadSafe> InWorlds);
	virtual ~FCairnStream() override;

	/** Asks the thread to stop. Does not wait. */
	void RequestStop();
	/** Whether the thread and all frames on the device have ended, so that destroying the stream does not block. */
	bool HasEnded() const;
	/**
	 * Stops the thread and waits for it. Resources that frames on the device may still use are leaked. For the end of the engine, when nobody
	 * can check later that they have ended.
	 */
	void Abandon();

	/** How far the world is loaded, 0 to 1. */
	float GetProgress() const { return Progress; }
	/** Size of the world's pictures; zero before the world is loaded. */
	FIntPoint GetSize() const;
	/** Why the stream has failed; empty if it has not. */
	FString GetFailure() const;
	/** Ends the stream with a message that GetFailure returns. The first message stays. */
	void Fail(const FString& Message);

	void SetPaused(bool bHold);
	/** Says that the game runs. Without it for half a second, as while the game is paused, the world holds and input is discarded. */
	void NoteTick(uint64 NowNs);
	/** Makes a picture the world's next picture. */
	void Append(FCairnPicture Picture);
	FCairnInput Input;

	/**
	 * Whether a frame is due that the target does not show yet. The caller then draws it. InTarget is an address that tells targets apart. Game
	 * thread.
	 */
	bool IsDue(uint64 NowNs, const void* InTarget, FIntPoint Size);
	/** Whether a frame was drawn. */
	bool HasDrawn() const { return bDrawn; }
	FCairnStatistics GetStatistics() const;

	/**
	 * Records the frame that is due into a list, at the size of the target, which is in COPY_DEST. On the thread that records lists, one call at a
	 * time. Returns the value to signal on GetFence after the list; 0 if nothing was recorded, for example before the first anchor.
	 */
	uint64 Record(ID3D12GraphicsCommandList* List, ID3D12Resource* Texture, uint64 NowNs);
	ID3D12Fence* GetFence() const { return Fence; }

	virtual uint32 Run() override;
	virtual void Stop() override { RequestStop(); }

private:
	FCairnStream(FCairnSettings InSettings, TSharedRef<FCairnWorlds, ESPMode::ThreadSafe> InWorlds);

	cairn::result<void> Prepare();
	cairn::result<void> PrepareFrames(FIntPoint Size);
	cairn::result<void> PrepareForTarget();
	cairn::result<void> Play();
	cairn::result<void> PushAnchor(const cairn::anchor& Anchor);
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
	std::atomic<uint64> LastTickNs{0};
	/** Whether the target shows another frame than the one that was requested last. */
	std::atomic<bool> bMustRedraw{false};
	std::atomic<bool> bDrawn{false};
	std::atomic<float> Progress{0.0f};

	/** Guards the members below. */
	mutable FCriticalSection Lock;
	FString Failure;
	FIntPoint WorldSize = FIntPoint(0, 0);
	/** Size of the last target that a frame was recorded for; zero before. */
	FIntPoint LastTargetSize = FIntPoint(0, 0);
	TArray<FCairnPicture> Edits;
	/** The rollout that RequestStop cancels; null if there is none. */
	const cairn::rollout* Cancellable = nullptr;
	cairn::frame ShownFrame;

	/** Made by the thread before bReady, and only read afterwards. The order matters: members are destroyed from last to first. */
	FCairnDevice Device;
	FCairnWorld World;
	cairn::rollout Rollout;
	cairn::presenter Presenter;
	uint32 KnownKeys = 0;
	FIntPoint AnchorSize = FIntPoint(0, 0);
	/** Used by the thread only: the size that frames are prepared for. */
	FIntPoint PreparedSize = FIntPoint(0, 0);

	/** Used by the game thread only: the frame that it requested last. */
	cairn::frame RequestedFrame;
	const void* RequestedTarget = nullptr;
	FIntPoint RequestedSize = FIntPoint(0, 0);

	/** Used by the recording thread only: the size that the presenter was given. */
	FIntPoint RecordedSize = FIntPoint(0, 0);

	/** Signalled after each list with a frame; until then the presenter keeps the list's copy source. Made by the thread before bReady. */
	TRefCountPtr<ID3D12Fence> Fence;
	std::atomic<uint64> Recorded{0};
};

#else

/** Without Direct3D 12 no stream is ever made. */
class FCairnStream
{
public:
	void RequestStop() {}
	bool HasEnded() const { return true; }
	void Abandon() {}
};

#endif
