#pragma once

#include "CairnTypes.h"
#include "CoreMinimal.h"
#include "HAL/CriticalSection.h"

#include <cairn.hpp>

/** The Windows virtual-key code of one of the engine's keys; 0 for one that has none. */
int32 CairnVirtualKey(const FKey& Key);

/** Keys of a first-person world: W A S D, arrows, Space, Shift, Ctrl, E, Q, R, F, and the mouse buttons. */
TArray<FCairnKey> CairnDefaultKeys();

/** Sums up the player's input until the next anchor uses it. Any thread. */
class FCairnInput
{
public:
	void SetKey(int32 VirtualKey, bool bDown);
	void AddMouse(float Right, float Down);
	void AddScroll(float Up);

	/** Takes the input since the last call, for keys below Known. A key that was held at any time since then counts as held. */
	cairn::controls Take(uint32 Known);

private:
	FCriticalSection Lock;
	cairn::controls Sum;
	uint64 Held[4] = {};
};
