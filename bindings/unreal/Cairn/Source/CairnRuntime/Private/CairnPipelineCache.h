#pragma once

#include "CairnEngine.h"

/**
 * Keeps compiled pipelines in the project's file Saved/Cairn/Pipelines.bin between runs of the game. An object of this class is the user
 * pointer of the callbacks of cairn_presenter_prepare_d3d12.
 */
class FCairnPipelineCache
{
public:
	/** cairn_pipelines_load_callback */
	static uint64_t Load(void* Bytes, uint64_t Capacity, void* User);
	/** cairn_pipelines_store_callback */
	static void Store(const void* Bytes, uint64_t Size, void* User);

private:
	/** Content of the file when its size was queried. */
	TArray64<uint8> Loaded;
};
