/* What numbers in a frame mean, and in which format they stand there. */
#ifndef HOST_D3D12_COLOURS_HPP
#define HOST_D3D12_COLOURS_HPP

#include "options.hpp"

#include <cstdint>

#include <dxgi1_6.h>

/* For the frames of a presenter: `space` is Cairn's word, `display` DXGI's. */
struct frame_format {
    DXGI_FORMAT format;
    std::uint32_t bytes;
    std::uint32_t space;
    DXGI_COLOR_SPACE_TYPE display;
    const char *name;
};

const frame_format &format_of(colours colours);

/* A colour of a picture, sRGB with 8 bits each, as a pixel of such a frame where white is `white_nits` bright; low bytes first. */
std::uint64_t pixel_of(colours colours, std::uint32_t rgb, std::uint32_t white_nits);

#endif
