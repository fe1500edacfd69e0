/* Shared declarations of the host's parts. */
#pragma once

#include "direct3d.h"

#include <string>

/** Prints and counts a failed check, and continues. */
void expect(bool fine, const char* what);

/** Folder of the plugin. */
const std::wstring& plugin_folder();
/** Folder of its project, which is not near the process's working folder. */
std::wstring project_folder();

/** Number of times that the plugin has loaded compiled pipelines. */
int pipeline_loads();

/** Starts the engine's renderer on Direct3D 12. */
void start_renderer();
/**
 * Ends a frame of the game. The render thread's work, and the list thread's, continues while the next frame is made: the game may be a
 * frame ahead of the render thread, and that a frame ahead of the list thread.
 */
void run_frame();
/** Ends a frame, and waits until the device has done all work. */
void finish_frames();
/** From now on closed lists are withheld from the device, as while a window is minimised or frames are rendered off screen. */
void hold_submission();
/** Submits the withheld lists, in the order of recording, and waits for them. */
void release_submission();
/** References to the device that are not the engine's own. */
unsigned long foreign_references();
/** Waits for the device and releases everything. */
void end_renderer();

std::shared_ptr<FRHITexture> make_texture(EPixelFormat format, int32 width, int32 height);
/** A texture's contents at one point of the list. */
class texture_copy;
/** Records a copy of the texture after the render thread's earlier commands. */
std::shared_ptr<texture_copy> copy_texture(const FTextureRHIRef& texture);
/** The copy's bytes, row by row; the device must have finished it. */
std::vector<uint8> read_copy(const texture_copy& copy);
/** The texture's bytes, row by row, after all work in flight is finished. */
std::vector<uint8> read_texture(FRHITexture& texture);
/** Half floats: a value from one, and the nearest to a value from 0 on. */
double of_half(uint16_t half);
uint16_t half_of(double value);
void write_texture(FRHITexture& texture, const std::vector<uint8>& bytes);
