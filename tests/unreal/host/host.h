/* What the parts of the host share. */
#pragma once

#include "direct3d.h"

#include <string>

/** Counts what is wrong, and goes on. */
void expect(bool fine, const char* what);

/** Where the plugin is. */
const std::wstring& plugin_folder();

/** Starts the engine's renderer on Direct3D 12. */
void start_renderer();
/** Another engine's frame: what was given to the render thread, and then to the thread that writes lists, runs on threads of their own. */
void run_frame();
/** Waits for the device and lets go of all. */
void end_renderer();
/** Whether all that the engine has is given to the device, which has done it. */
void finish_frames();

/** A texture of the engine's, and what it knows of it. */
class FRHITexture {
public:
    FRHITexture(ID3D12Resource* resource, EPixelFormat format, int32 width, int32 height)
        : Resource(resource), Format(format), Width(width), Height(height)
    {
    }
    ~FRHITexture() { Resource->Release(); }
    FRHITexture(const FRHITexture&) = delete;

    ID3D12Resource* const Resource;
    const EPixelFormat Format;
    const int32 Width, Height;
    /** The state in the list, with the barriers that are not written down yet. */
    D3D12_RESOURCE_STATES State = D3D12_RESOURCE_STATE_COMMON;
    /** Of the last list that the engine knows to use it. */
    uint64 UsedIn = 0;
};

std::shared_ptr<FRHITexture> make_texture(EPixelFormat format, bool srgb, int32 width, int32 height);
/** The texture's bytes, row by row. What is under way is finished first. */
std::vector<uint8> read_texture(FRHITexture& texture);
void write_texture(FRHITexture& texture, const std::vector<uint8>& bytes);
