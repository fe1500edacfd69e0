#include "colours.hpp"

#include <cairn.hpp>
#include <cmath>
#include <cstring>

/* Luminance in nits of the largest value in HDR10, and of the value 1 in scRGB. */
static constexpr double PQ_NITS = 10000, SCRGB_NITS = 80;

const frame_format &format_of(colours colours)
{
    static const frame_format formats[] = {
        {DXGI_FORMAT_R8G8B8A8_UNORM, 4, CAIRN_COLOUR_SRGB, DXGI_COLOR_SPACE_RGB_FULL_G22_NONE_P709, "sRGB"},
        {DXGI_FORMAT_R10G10B10A2_UNORM, 4, CAIRN_COLOUR_HDR10, DXGI_COLOR_SPACE_RGB_FULL_G2084_NONE_P2020, "HDR10"},
        {DXGI_FORMAT_R16G16B16A16_FLOAT, 8, CAIRN_COLOUR_SCRGB, DXGI_COLOR_SPACE_RGB_FULL_G10_NONE_P709, "scRGB"},
    };
    return formats[static_cast<int>(colours)];
}

/* Linear light, 0 to 1, of an sRGB level. */
static double linear_of(std::uint32_t level)
{
    const double v = level / 255.0;
    return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

/* The transfer function PQ of HDR10, SMPTE ST 2084: the value, 0 to 1, of a luminance as a fraction of 10000 nits. */
static double pq(double luminance)
{
    constexpr double m1 = 2610.0 / 16384, m2 = 2523.0 / 4096 * 128, c1 = 3424.0 / 4096, c2 = 2413.0 / 4096 * 32, c3 = 2392.0 / 4096 * 32;
    const double p = std::pow(luminance, m1);
    return std::pow((c1 + c2 * p) / (1 + c3 * p), m2);
}

/* The bits of the half float nearest to a number from 0 to 65504. Numbers that would be denormal become 0. */
static std::uint64_t half_of(double value)
{
    const float single = static_cast<float>(value);
    std::uint32_t bits;
    std::memcpy(&bits, &single, sizeof bits);
    constexpr std::uint32_t smallest_normal = 113u << 23;
    return bits < smallest_normal ? 0 : (bits - (112u << 23) + (1u << 12)) >> 13;
}

std::uint64_t pixel_of(colours colours, std::uint32_t rgb, std::uint32_t white_nits)
{
    const std::uint32_t levels[] = {rgb & 255, rgb >> 8 & 255, rgb >> 16 & 255};
    const double r = linear_of(levels[0]), g = linear_of(levels[1]), b = linear_of(levels[2]);
    switch (colours) {
    case colours::srgb: break;
    case colours::hdr10: {
        /* BT.709 to BT.2020 primaries. */
        const double wide[] = {0.627404 * r + 0.329283 * g + 0.043313 * b, 0.069097 * r + 0.919540 * g + 0.011362 * b,
                               0.016391 * r + 0.088013 * g + 0.895595 * b};
        std::uint64_t pixel = std::uint64_t{3} << 30;
        for (int c = 0; c < 3; c++) {
            pixel |= static_cast<std::uint64_t>(std::lround(pq(wide[c] * white_nits / PQ_NITS) * 1023)) << (10 * c);
        }
        return pixel;
    }
    case colours::scrgb: {
        const double brightness = white_nits / SCRGB_NITS;
        return half_of(r * brightness) | half_of(g * brightness) << 16 | half_of(b * brightness) << 32 | std::uint64_t{0x3C00} << 48;
    }
    }
    return rgb | 0xFF000000u;
}
