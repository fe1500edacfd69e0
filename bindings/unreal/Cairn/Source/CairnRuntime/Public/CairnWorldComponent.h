#pragma once

#include "CoreMinimal.h"
#include "CairnTypes.h"
#include "Components/ActorComponent.h"
#include "Engine/EngineTypes.h"

#include "CairnWorldComponent.generated.h"

class FCairnStream;
class UTextureRenderTarget2D;

DECLARE_DYNAMIC_MULTICAST_DELEGATE(FCairnReady);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FCairnFailed, const FString&, Message);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FCairnProgress, float, Part);

/** Plays a world into a render target. */
UCLASS(ClassGroup = (Cairn), meta = (BlueprintSpawnableComponent))
class CAIRNRUNTIME_API UCairnWorldComponent : public UActorComponent
{
	GENERATED_BODY()

public:
	UCairnWorldComponent();

	/** The world's bundle, a file or a directory; empty for the one inside the library. Relative paths start at the project's folder. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World", meta = (FilePathFilter = "cairn", RelativeToGameDir))
	FFilePath WorldBundle;

	/** Operating point of the world: a preset ("coherence", "stock" and so on), with changes after commas: "stock,g64". */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	FString OperatingPoint = TEXT("stock,pictures:1");

	/** The processor that makes anchors. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	ECairnAnchors Anchors = ECairnAnchors::Graphics;

	/** Processor threads that share a pass, if the processor makes anchors; 0 for one per core. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World", meta = (ClampMin = "0", ClampMax = "1024"))
	int32 Threads = 0;

	/** Seed of the noise. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	int64 Seed = 0;

	/**
	 * The seed picture, used if SeedTarget is not set: PNG, JPEG, BMP, EXR or PPM; empty for the plugin's own picture. Relative paths start at the
	 * project's folder.
	 */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World",
		meta = (FilePathFilter = "Pictures|*.png;*.jpg;*.jpeg;*.bmp;*.exr;*.ppm", RelativeToGameDir))
	FFilePath SeedPicture;

	/**
	 * Render target whose content when the component starts is the seed picture, for example that of a scene capture: RTF RGBA8 SRGB, RGBA8,
	 * RGB10A2, or RGBA16f, which has linear light that is cut off above 1.
	 */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	TObjectPtr<UTextureRenderTarget2D> SeedTarget;

	/** Render target for frames: RTF RGBA8 SRGB, RGBA8 or RGBA16f. Null: the component makes one of the world's size. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	TObjectPtr<UTextureRenderTarget2D> Target;

	/** Switch off if the game draws with CairnAddPass into its own texture: then there is no Target. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	bool bDrawIntoTarget = true;

	/** Frames are linear light, for an RGBA16F texture given to CairnAddPass. For a Target its format decides. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames", meta = (EditCondition = "!bDrawIntoTarget"))
	bool bLinearFrames = false;

	/** Frames per anchor: 1, 2, 3, 4 or 6. With 1, no frames are generated. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames", meta = (ClampMin = "1", ClampMax = "6"))
	int32 Multiplier = 4;

	/** Frames with another aspect ratio than the anchors get black bars instead of being stretched. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	bool bLetterbox = false;

	/** Budget of device time for a frame in milliseconds, including the anchors' share; 0 for no limit. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames", meta = (ClampMin = "0"))
	float FrameBudgetMs = 0.0f;

	/** Schedules that may be used to keep the budget, separated by spaces: "stock explicit:1:0.5:0". */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	FString BudgetSchedules;

	/** Start together with the game. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn")
	bool bStartOnBeginPlay = true;

	/** The world gets the first player's keys and mouse, as Keys maps them. If off, call SetKey, AddMouse and AddScroll. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Input")
	bool bReadPlayerInput = true;

	/** The keys that the world gets. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Input")
	TArray<FCairnKey> Keys;

	/** Factor from the engine's mouse counts to the world's. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Input")
	float MouseScale = 10.0f;

	/** Fired when the first frame is in the target. */
	UPROPERTY(BlueprintAssignable, Category = "Cairn")
	FCairnReady OnReady;

	/** Fired when the component has stopped with an error. The library's message says what to do. */
	UPROPERTY(BlueprintAssignable, Category = "Cairn")
	FCairnFailed OnError;

	/** Fired with the progress of loading, 0 to 1. */
	UPROPERTY(BlueprintAssignable, Category = "Cairn")
	FCairnProgress OnProgress;

	/** Loads the world on a thread of its own and plays it. If it plays already, it starts again. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	void Start();

	/** Stops playing; the target keeps its last frame. Does not wait. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	void Stop();

	/** Whether it was started and has neither failed nor been stopped. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	bool IsPlaying() const;

	/** Pauses the world after the anchor that is being made, or resumes it. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	void SetPaused(bool bPaused);

	/** Makes the content of a render target the world's next picture: an edit of the scene. Waits for the render thread. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	void AppendRenderTarget(UTextureRenderTarget2D* Picture);

	/** A key went down or up, for games with their own input. */
	UFUNCTION(BlueprintCallable, Category = "Cairn|Input")
	void SetKey(FKey Key, bool bDown);

	/** The mouse moved, in counts: right and down positive. */
	UFUNCTION(BlueprintCallable, Category = "Cairn|Input")
	void AddMouse(float Right, float Down);

	/** The wheel turned, up positive. */
	UFUNCTION(BlueprintCallable, Category = "Cairn|Input")
	void AddScroll(float Up);

	/** Statistics since the start. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	FCairnStatistics GetStatistics() const;

	/** The stream to pass to CairnAddPass in a game's own render code; null if nothing plays. */
	TSharedPtr<FCairnStream, ESPMode::ThreadSafe> GetStream() const { return Stream; }

	virtual void BeginPlay() override;
	virtual void EndPlay(const EEndPlayReason::Type Reason) override;
	virtual void BeginDestroy() override;
	virtual void TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction) override;

private:
	void Fail(const FString& Message);
	void ReadPlayerInput();
	bool MakeTarget();
	void Draw();

	TSharedPtr<FCairnStream, ESPMode::ThreadSafe> Stream;
	/** The target that the component made; its size follows the world's. */
	UPROPERTY(Transient)
	TObjectPtr<UTextureRenderTarget2D> MadeTarget;

	bool bReadyFired = false;
	float LastProgress = -1.0f;
};
