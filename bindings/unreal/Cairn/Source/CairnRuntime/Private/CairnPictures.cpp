#include "CairnPictures.h"

#include "IImageWrapperModule.h"
#include "ImageCore.h"
#include "Misc/FileHelper.h"
#include "Modules/ModuleManager.h"

namespace
{
	/** Largest width or height of a picture that Cairn accepts. */
	constexpr int32 LargestSide = 16384;

	/** The next number of a PPM header, after white space and comments; 0 if there is none. At is then after the byte that follows it. */
	int32 HeaderNumber(const TArray64<uint8>& Bytes, int64& At)
	{
		const auto IsSpace = [](uint8 Byte) { return Byte == ' ' || (Byte >= '\t' && Byte <= '\r'); };
		while (At < Bytes.Num() && (IsSpace(Bytes[At]) || Bytes[At] == '#'))
		{
			const bool bComment = Bytes[At] == '#';
			while (bComment && At < Bytes.Num() && Bytes[At] != '\n')
			{
				At++;
			}
			At++;
		}
		int32 Number = 0;
		while (At < Bytes.Num() && Bytes[At] >= '0' && Bytes[At] <= '9' && Number <= LargestSide)
		{
			Number = Number * 10 + (Bytes[At++] - '0');
		}
		return At < Bytes.Num() && IsSpace(Bytes[At++]) ? Number : 0;
	}

	bool ReadPpm(const TArray64<uint8>& Bytes, FCairnPicture& Out)
	{
		int64 At = 2;
		Out.Width = HeaderNumber(Bytes, At);
		Out.Height = HeaderNumber(Bytes, At);
		const int32 Most = HeaderNumber(Bytes, At);
		const int64 Count = static_cast<int64>(Out.Width) * Out.Height;
		if (Out.Width < 1 || Out.Height < 1 || Out.Width > LargestSide || Out.Height > LargestSide || Most != 255 || Bytes.Num() - At < Count * 3)
		{
			return false;
		}
		Out.Pixels.SetNumUninitialized(Count * 4);
		for (int64 i = 0; i < Count; i++)
		{
			const uint8* From = &Bytes[At + i * 3];
			uint8* To = &Out.Pixels[i * 4];
			To[0] = From[2];
			To[1] = From[1];
			To[2] = From[0];
			To[3] = 255;
		}
		return true;
	}
}

bool CairnReadPicture(const FString& File, FCairnPicture& Out, FString& OutWhy)
{
	TArray64<uint8> Bytes;
	if (!FFileHelper::LoadFileToArray(Bytes, *File))
	{
		OutWhy = FString(TEXT("Cairn: ")) + File + TEXT(": the picture cannot be read. Name a file that is there, and package it with the game");
		return false;
	}
	bool bRead = Bytes.Num() > 2 && Bytes[0] == 'P' && Bytes[1] == '6' && ReadPpm(Bytes, Out);
	if (!bRead)
	{
		FImage Image;
		IImageWrapperModule& Formats = FModuleManager::LoadModuleChecked<IImageWrapperModule>(TEXT("ImageWrapper"));
		bRead = Bytes.Num() > 0 && Formats.DecompressImage(Bytes.GetData(), Bytes.Num(), Image) && Image.SizeX <= LargestSide &&
			Image.SizeY <= LargestSide;
		if (bRead)
		{
			Image.ChangeFormat(ERawImageFormat::BGRA8, EGammaSpace::sRGB);
			Out.Width = Image.SizeX;
			Out.Height = Image.SizeY;
			Out.Pixels = MoveTemp(Image.RawData);
		}
	}
	if (!bRead)
	{
		OutWhy = FString(TEXT("Cairn: ")) + File +
			TEXT(": this is no picture of up to 16384 pixels each way. Give a PNG, JPEG, BMP, EXR or PPM of eight bits");
	}
	return bRead;
}

FCairnPicture CairnPictureOf(const TArray<FColor>& Colours, int32 Width, int32 Height)
{
	FCairnPicture Made;
	Made.Width = Width;
	Made.Height = Height;
	Made.Pixels.SetNumUninitialized(static_cast<int64>(Colours.Num()) * 4);
	for (int32 i = 0; i < Colours.Num(); i++)
	{
		const FColor& From = Colours[i];
		uint8* To = &Made.Pixels[static_cast<int64>(i) * 4];
		To[0] = From.B;
		To[1] = From.G;
		To[2] = From.R;
		// A scene capture may leave any alpha.
		To[3] = 255;
	}
	return Made;
}
