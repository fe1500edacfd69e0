#pragma once

#include "CoreMinimal.h"
#include "InputCoreTypes.h"

#include "CairnTypes.generated.h"

/** What makes anchors, the strong pictures. */
UENUM(BlueprintType)
enum class ECairnAnchors : uint8
{
	/** The graphics device of the engine, by DirectML, on a queue of its own. */
	Graphics,
	/** The processor. For small worlds, and where the graphics card has no time left. */
	Processor
};

/** What the frame in the target is. */
UENUM(BlueprintType)
enum class ECairnFrameSource : uint8
{
	/** Nothing was drawn yet. */
	None,
	/** An anchor. */
	Anchor,
	/** A picture that the later anchor brought with it. */
	Decoded,
	/** Generated between two anchors. */
	Generated,
	/** Generated beyond the last anchor, as the next one is late. */
	Extrapolated,
	/** A picture that stands. */
	Held
};

/** A key of the player's and what the world takes it for. */
USTRUCT(BlueprintType)
struct FCairnKey
{
	GENERATED_BODY()

	/** Of the keyboard or the mouse. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn")
	FKey Key;

	/** A Windows virtual-key code, such as 87 for W; 0 for the key's own. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Cairn", meta = (ClampMin = "0", ClampMax = "255"))
	int32 VirtualKey = 0;
};

/** What a component has done since it was started. */
USTRUCT(BlueprintType)
struct FCairnStatistics
{
	GENERATED_BODY()

	/** Anchors that were made. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Anchors = 0;

	/** Those that came after they were due. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 LateAnchors = 0;

	/** Frames drawn. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Frames = 0;

	/** Those of them that were generated. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Generated = 0;

	/** Frames drawn as the nearest anchor, as the target's size was not prepared yet. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 Unprepared = 0;

	/** Milliseconds of wall time that an anchor took on average, by passes and decoding. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	float AnchorMs = 0.0f;

	/** Milliseconds of the device's time that the last frame took; 0 where nobody knows. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	float FrameMs = 0.0f;

	/** What generates frames, such as "shader". */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	FString Generator;

	/** Why a generator that might be better is not used. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	FString Preference;

	/** The frame in the target. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	ECairnFrameSource Shown = ECairnFrameSource::None;

	/** Number of the anchor that it shows or starts from. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	int64 ShownAnchor = -1;
};

/** A thing that Cairn needs. */
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

	/** Whether nothing is missing. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	bool bMet = false;

	/** Whether Cairn runs without it. */
	UPROPERTY(BlueprintReadOnly, Category = "Cairn")
	bool bOptional = false;
};
