#pragma once

#include "CoreMinimal.h"

/** A picture in memory: four bytes per pixel, BGRA, rows from top to bottom. */
struct FCairnPicture
{
	TArray64<uint8> Pixels;
	int32 Width = 0;
	int32 Height = 0;
};

/** Reads a picture of any format that the engine reads, or PPM. On failure returns false and a message that names the file. */
bool CairnReadPicture(const FString& File, FCairnPicture& Out, FString& OutWhy);

/** Copies an array of the engine's colours. */
FCairnPicture CairnPictureOf(const TArray<FColor>& Colours, int32 Width, int32 Height);
