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

	/** The world's bundle, a file or a directory; nothing for the one inside the library. Relative paths begin at the project. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World", meta = (FilePathFilter = "cairn"))
	FFilePath WorldBundle;

	/** How the world runs: a preset ("coherence", "stock" and so on), with changes after commas: "stock,g64". */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	FString OperatingPoint = TEXT("stock,pictures:1");

	/** What makes anchors. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	ECairnAnchors Anchors = ECairnAnchors::Graphics;

	/** Threads of the processor that share a pass, where it makes anchors; 0 for one for each core. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World", meta = (ClampMin = "0", ClampMax = "1024"))
	int32 Threads = 0;

	/** Decides all noise. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	int64 Seed = 0;

	/** What the world begins with, where SeedTarget is not set: PNG, JPEG, BMP, EXR or PPM; nothing for the plugin's own picture. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World", meta = (FilePathFilter = "png"))
	FFilePath SeedPicture;

	/** What the world begins with: what is in it when the component starts, of a scene capture for example. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|World")
	TObjectPtr<UTextureRenderTarget2D> SeedTarget;

	/** Where frames go: RTF RGBA8 SRGB, RGBA8 or RGBA16f. Nothing for one that the component makes, of the world's size. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	TObjectPtr<UTextureRenderTarget2D> Target;

	/** Off for a game that draws by CairnAddPass, into a texture of its own: then there is no Target. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	bool bDrawIntoTarget = true;

	/** Frames are linear light, for a texture of RGBA16F that CairnAddPass is given. A Target says so by its format. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames", meta = (EditCondition = "!bDrawIntoTarget"))
	bool bLinearFrames = false;

	/** Frames to an anchor: 1, 2, 3, 4 or 6. With 1 none is generated. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames", meta = (ClampMin = "1", ClampMax = "6"))
	int32 Multiplier = 4;

	/** Frames of another shape than the anchors' have black beside or above them, where they would be stretched. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	bool bLetterbox = false;

	/** Milliseconds of the device's time for a frame, anchors and all; 0 for as long as it takes. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames", meta = (ClampMin = "0"))
	float FrameBudgetMs = 0.0f;

	/** Schedules to go down to where the budget is too small, a space between them: "stock explicit:1:0.5:0". */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Frames")
	FString BudgetSchedules;

	/** Start when the game does. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn")
	bool bStartOnBeginPlay = true;

	/** Keys and mouse of the first player are the world's, as Keys says. Without it call SetKey, AddMouse and AddScroll. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Input")
	bool bReadPlayerInput = true;

	/** Which keys the world gets. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Input")
	TArray<FCairnKey> Keys;

	/** Counts of the world's mouse for one of the engine's. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn|Input")
	float MouseScale = 10.0f;

	/** The first frame is in the target. */
	UPROPERTY(BlueprintAssignable, Category = "Cairn")
	FCairnReady OnReady;

	/** It has stopped, and why: the library's message, which says what to do. */
	UPROPERTY(BlueprintAssignable, Category = "Cairn")
	FCairnFailed OnError;

	/** How far the world is loaded, 0 to 1. */
	UPROPERTY(BlueprintAssignable, Category = "Cairn")
	FCairnProgress OnProgress;

	/** Loads the world on a thread of its own and plays it. One that plays already starts anew. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	void Start();

	/** Ends it; the target keeps its last frame. Does not wait. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	void Stop();

	/** Whether it was started and has neither failed nor been stopped. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	bool IsPlaying() const;

	/** Holds the world after the anchor that is being made, or lets it go on. */
	UFUNCTION(BlueprintCallable, Category = "Cairn")
	void SetPaused(bool bPaused);

	/** Makes what is in a render target the world's next picture: an edit of the scene. Waits for the render thread. */
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

	/** What was done so far. */
	UFUNCTION(BlueprintPure, Category = "Cairn")
	FCairnStatistics GetStatistics() const;

	/** For render code of a game's own, to give to CairnAddPass; null where nothing plays. */
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
	/** The target that the component has made, which follows the world's size. */
	UPROPERTY(Transient)
	TObjectPtr<UTextureRenderTarget2D> MadeTarget;

	bool bSaidReady = false;
	float SaidProgress = -1.0f;
};
