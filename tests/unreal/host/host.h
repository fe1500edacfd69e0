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

/** Starts the engine's renderer on Direct3D 12. */
void start_renderer();
/**
 * Ends a frame of the game's. What was given to the render thread, and by that to the thread that writes lists, goes on while the next
 * frame is made: the game may be a frame ahead of the one, and that a frame ahead of the other.
 */
void run_frame();
/** Ends a frame, and waits until the device has done all. */
void finish_frames();
/** Waits for the device and lets go of all. */
void end_renderer();

std::shared_ptr<FRHITexture> make_texture(EPixelFormat format, int32 width, int32 height);
/** The texture's bytes, row by row. What is under way is finished first. */
std::vector<uint8> read_texture(FRHITexture& texture);
void write_texture(FRHITexture& texture, const std::vector<uint8>& bytes);
