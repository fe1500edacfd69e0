/* Colour spaces of frames, and their pixel formats. */
#ifndef HOST_D3D12_COLOURS_HPP
#define HOST_D3D12_COLOURS_HPP

#include "options.hpp"

#include <cstdint>

#include <dxgi1_6.h>

/* Format of a presenter's frames. `space` is Cairn's constant for the colour space, `display` DXGI's; `bytes` is the size of a pixel. */
struct frame_format {
    DXGI_FORMAT format;
    std::uint32_t bytes;
    std::uint32_t space;
    DXGI_COLOR_SPACE_TYPE display;
    const char *name;
};

const frame_format &format_of(colours colours);

/* Converts an sRGB colour, 8 bits each, to a frame's pixel, low bytes first. White has a luminance of `white_nits`. */
std::uint64_t pixel_of(colours colours, std::uint32_t rgb, std::uint32_t white_nits);

#endif
