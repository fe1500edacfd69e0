#include "CairnInput.h"

#include "Misc/ScopeLock.h"

namespace
{
	struct FNamedKey
	{
		const TCHAR* Name;
		int32 Code;
	};

	/** Keys whose name is not their letter. */
	const FNamedKey NamedKeys[] = {
		{TEXT("LeftMouseButton"), 0x01}, {TEXT("RightMouseButton"), 0x02}, {TEXT("MiddleMouseButton"), 0x04},
		{TEXT("ThumbMouseButton"), 0x05}, {TEXT("ThumbMouseButton2"), 0x06}, {TEXT("BackSpace"), 0x08}, {TEXT("Tab"), 0x09},
		{TEXT("Enter"), 0x0D}, {TEXT("LeftShift"), 0x10}, {TEXT("RightShift"), 0x10}, {TEXT("LeftControl"), 0x11},
		{TEXT("RightControl"), 0x11}, {TEXT("LeftAlt"), 0x12}, {TEXT("RightAlt"), 0x12}, {TEXT("Escape"), 0x1B},
		{TEXT("SpaceBar"), 0x20}, {TEXT("PageUp"), 0x21}, {TEXT("PageDown"), 0x22}, {TEXT("End"), 0x23}, {TEXT("Home"), 0x24},
		{TEXT("Left"), 0x25}, {TEXT("Up"), 0x26}, {TEXT("Right"), 0x27}, {TEXT("Down"), 0x28}, {TEXT("Insert"), 0x2D},
		{TEXT("Delete"), 0x2E}, {TEXT("Zero"), 0x30}, {TEXT("One"), 0x31}, {TEXT("Two"), 0x32}, {TEXT("Three"), 0x33},
		{TEXT("Four"), 0x34}, {TEXT("Five"), 0x35}, {TEXT("Six"), 0x36}, {TEXT("Seven"), 0x37}, {TEXT("Eight"), 0x38},
		{TEXT("Nine"), 0x39}, {TEXT("NumPadZero"), 0x60}, {TEXT("NumPadOne"), 0x61}, {TEXT("NumPadTwo"), 0x62},
		{TEXT("NumPadThree"), 0x63}, {TEXT("NumPadFour"), 0x64}, {TEXT("NumPadFive"), 0x65}, {TEXT("NumPadSix"), 0x66},
		{TEXT("NumPadSeven"), 0x67}, {TEXT("NumPadEight"), 0x68}, {TEXT("NumPadNine"), 0x69}, {TEXT("Multiply"), 0x6A},
		{TEXT("Add"), 0x6B}, {TEXT("Subtract"), 0x6D}, {TEXT("Decimal"), 0x6E}, {TEXT("Divide"), 0x6F}, {TEXT("F1"), 0x70},
		{TEXT("F2"), 0x71}, {TEXT("F3"), 0x72}, {TEXT("F4"), 0x73}, {TEXT("F5"), 0x74}, {TEXT("F6"), 0x75}, {TEXT("F7"), 0x76},
		{TEXT("F8"), 0x77}, {TEXT("F9"), 0x78}, {TEXT("F10"), 0x79}, {TEXT("F11"), 0x7A}, {TEXT("F12"), 0x7B}, {TEXT("CapsLock"), 0x14},
		{TEXT("Semicolon"), 0xBA}, {TEXT("Equals"), 0xBB}, {TEXT("Comma"), 0xBC}, {TEXT("Hyphen"), 0xBD}, {TEXT("Period"), 0xBE},
		{TEXT("Slash"), 0xBF}, {TEXT("Tilde"), 0xC0}, {TEXT("LeftBracket"), 0xDB}, {TEXT("Backslash"), 0xDC}, {TEXT("RightBracket"), 0xDD},
		{TEXT("Apostrophe"), 0xDE}};

	const TCHAR* const DefaultKeys[] = {
		TEXT("W"), TEXT("A"), TEXT("S"), TEXT("D"), TEXT("E"), TEXT("Q"), TEXT("R"), TEXT("F"), TEXT("Up"), TEXT("Down"),
		TEXT("Left"), TEXT("Right"), TEXT("SpaceBar"), TEXT("LeftShift"), TEXT("LeftControl"), TEXT("LeftMouseButton"),
		TEXT("RightMouseButton")};
}

int32 CairnVirtualKey(const FKey& Key)
{
	const FString Name = Key.ToString();
	if (Name.Len() == 1 && Name[0] >= TEXT('A') && Name[0] <= TEXT('Z'))
	{
		return Name[0];
	}
	for (const FNamedKey& Named : NamedKeys)
	{
		if (Name == Named.Name)
		{
			return Named.Code;
		}
	}
	return 0;
}

TArray<FCairnKey> CairnDefaultKeys()
{
	TArray<FCairnKey> Keys;
	for (const TCHAR* Name : DefaultKeys)
	{
		FCairnKey Made;
		Made.Key = FKey(Name);
		Keys.Add(Made);
	}
	return Keys;
}

void FCairnInput::SetKey(int32 VirtualKey, bool bDown)
{
	if (VirtualKey < 1 || VirtualKey > 255)
	{
		return;
	}
	const FScopeLock Locked(&Lock);
	const uint64 Bit = uint64(1) << (VirtualKey % 64);
	uint64& Word = Held[VirtualKey / 64];
	Word = bDown ? Word | Bit : Word & ~Bit;
	Sum.keys[VirtualKey / 64] |= bDown ? Bit : 0;
}

void FCairnInput::AddMouse(float Right, float Down)
{
	const FScopeLock Locked(&Lock);
	// Clamped to the range of controls; values that are not finite count as 0.
	Sum.mouse_dx = FMath::IsFinite(Right) ? FMath::Clamp(Sum.mouse_dx + Right, -32768.0f, 32768.0f) : Sum.mouse_dx;
	Sum.mouse_dy = FMath::IsFinite(Down) ? FMath::Clamp(Sum.mouse_dy + Down, -32768.0f, 32768.0f) : Sum.mouse_dy;
}

void FCairnInput::AddScroll(float Up)
{
	const FScopeLock Locked(&Lock);
	Sum.scroll = FMath::IsFinite(Up) ? FMath::Clamp(Sum.scroll + Up, -32768.0f, 32768.0f) : Sum.scroll;
}

cairn::controls FCairnInput::Take(uint32 Known)
{
	const FScopeLock Locked(&Lock);
	cairn::controls Controls = Sum;
	Sum = cairn::controls();
	for (uint32 Word = 0; Word < 4; Word++)
	{
		Sum.keys[Word] = Held[Word];
		// The world rejects controls with an unknown key as a whole, so unknown keys are left out.
		for (uint32 Bit = 0; Bit < 64; Bit++)
		{
			if (Word * 64 + Bit >= Known)
			{
				Controls.keys[Word] &= ~(uint64(1) << Bit);
			}
		}
	}
	return Controls;
}
