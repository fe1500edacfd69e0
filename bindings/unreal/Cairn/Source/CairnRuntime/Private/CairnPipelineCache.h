#pragma once

#include "CairnEngine.h"

/**
 * Compiled pipelines in the file Saved/Cairn/Pipelines.bin of the project, from one run of the game to the next: for the callbacks of
 * cairn_presenter_prepare_d3d12, whose user is an object of this class.
 */
class FCairnPipelineCache
{
public:
	/** cairn_pipelines_load_callback */
	static uint64_t Load(void* Bytes, uint64_t Capacity, void* User);
	/** cairn_pipelines_store_callback */
	static void Store(const void* Bytes, uint64_t Size, void* User);

private:
	/** What the file had when its size was asked for. */
	TArray64<uint8> Loaded;
};
