#pragma once

#include "CoreMinimal.h"
#include "InputCoreTypes.h"

#include "CairnTypes.generated.h"

/** Processor that makes anchors, the pictures between which frames are generated. */
UENUM(BlueprintType)
enum class ECairnAnchors : uint8
{
	/** The engine's graphics device through DirectML, on a queue of its own. */
	Graphics,
	/** The processor. For small worlds, and where the graphics card has no time left. */
	Processor
};

/** Kind of the frame in the target. */
UENUM(BlueprintType)
enum class ECairnFrameSource : uint8
{
	/** Nothing was drawn yet. */
	None,
	/** An anchor. */
	Anchor,
	/** A further picture that the decoder made together with the later anchor. */
	Decoded,
	/** Generated between two anchors. */
	Generated,
	/** Extrapolated beyond the last anchor, because the next one is late. */
	Extrapolated,
	/** A repeated picture, because nothing can be generated. */
	Held
};

/** A key of the player and the key that the world gets for it. */
USTRUCT(BlueprintType)
struct FCairnKey
{
	GENERATED_BODY()

	/** Key of the keyboard or the mouse. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn")
	FKey Key;

	/** A Windows virtual-key code, such as 87 for W; 0 for the key's own. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn", meta = (ClampMin = "0", ClampMax = "255"))
	int32 VirtualKey = 0;
};

/** Statistics of a component since it was started. */
USTRUCT(BlueprintType)
struct FCairnStatistics
{
	GENERATED_BODY()

	/** Anchors that were made. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Anchors = 0;

	/** Anchors that were made after they were due. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 LateAnchors = 0;

	/** Frames drawn. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Frames = 0;

	/** Those of them that were generated. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Generated = 0;

	/** Frames that show the nearest anchor because the target's size was not prepared yet. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Unprepared = 0;

	/** Average milliseconds of wall time per anchor, for passes and decoding. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	float AnchorMs = 0.0f;

	/** Milliseconds of device time of the last frame; 0 if unknown. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	float FrameMs = 0.0f;

	/** Generator of frames, such as "shader". */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	FString Generator;

	/** Why a generator that might be better is not used. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	FString Preference;

	/** The frame in the target. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	ECairnFrameSource Shown = ECairnFrameSource::None;

	/** Number of the anchor that the frame shows or starts from. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 ShownAnchor = -1;
};

/** A requirement of Cairn. */
USTRUCT(BlueprintType)
struct FCairnRequirement
{
	GENERATED_BODY()

	/** What is needed. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	FString Needed;

	/** What was found. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	FString Found;

	/** Whether the requirement is met. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	bool bMet = false;

	/** Whether Cairn runs without it. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	bool bOptional = false;
};
