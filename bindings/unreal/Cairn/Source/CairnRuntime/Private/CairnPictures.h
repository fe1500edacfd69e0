#pragma once

#include "CoreMinimal.h"

/** A picture in memory: four bytes to a pixel, blue first, rows from top to bottom. */
struct FCairnPicture
{
	TArray64<uint8> Pixels;
	int32 Width = 0;
	int32 Height = 0;
};

/** Reads a picture of any format that the engine reads, and PPM. False with a message that names the file. */
bool CairnReadPicture(const FString& File, FCairnPicture& Out, FString& OutWhy);

/** Takes what is in an array of the engine's colours. */
FCairnPicture CairnPictureOf(const TArray<FColor>& Colours, int32 Width, int32 Height);
