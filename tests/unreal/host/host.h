/* What the parts of the host share. */
#pragma once

#include "direct3d.h"

#include <string>

/** Counts what is wrong, and goes on. */
void expect(bool fine, const char* what);

/** Where the plugin is. */
const std::wstring& plugin_folder();
/** The project that it is in; nowhere near the folder that the process happens to be in. */
std::wstring project_folder();

/** How often the plugin has looked for compiled pipelines. */
int pipeline_loads();

/** Starts the engine's renderer on Direct3D 12. */
void start_renderer();
/**
 * Ends a frame of the game's. What was given to the render thread, and by that to the thread that writes lists, goes on while the next
 * frame is made: the game may be a frame ahead of the one, and that a frame ahead of the other.
 */
void run_frame();
/** Ends a frame, and waits until the device has done all. */
void finish_frames();
/** From now on closed lists are kept from the device, as while a window is minimised or frames are rendered off screen. */
void hold_submission();
/** Gives the device what was kept, in the order of recording, and waits until it has done it. */
void release_submission();
/** References to the device that are not the engine's own. */
unsigned long foreign_references();
/** Waits for the device and lets go of all. */
void end_renderer();

std::shared_ptr<FRHITexture> make_texture(EPixelFormat format, int32 width, int32 height);
/** What a texture holds where the list comes to it. */
class texture_copy;
/** Records a copy of the texture behind what the render thread was given. */
std::shared_ptr<texture_copy> copy_texture(const FTextureRHIRef& texture);
/** The copy's bytes, row by row; the device has done it. */
std::vector<uint8> read_copy(const texture_copy& copy);
/** The texture's bytes, row by row. What is under way is finished first. */
std::vector<uint8> read_texture(FRHITexture& texture);
void write_texture(FRHITexture& texture, const std::vector<uint8>& bytes);
