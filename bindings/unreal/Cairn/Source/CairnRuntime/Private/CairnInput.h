#pragma once

#include "CairnTypes.h"
#include "CoreMinimal.h"
#include "HAL/CriticalSection.h"

#include <cairn.hpp>

/** The Windows virtual-key code of one of the engine's keys; 0 for one that has none. */
int32 CairnVirtualKey(const FKey& Key);

/** What a first-person world wants: W A S D, arrows, Space, Shift, Ctrl, E, Q, R, F, and the mouse's buttons. */
TArray<FCairnKey> CairnDefaultKeys();

/** What a player does, summed up until the next anchor is made with it. Any thread. */
class FCairnInput
{
public:
	void SetKey(int32 VirtualKey, bool bDown);
	void AddMouse(float Right, float Down);
	void AddScroll(float Up);

	/** What was done since the last time, of keys below Known: one that was held at any moment counts as held. */
	cairn::controls Take(uint32 Known);

private:
	FCriticalSection Lock;
	cairn::controls Sum;
	uint64 Held[4] = {};
};
