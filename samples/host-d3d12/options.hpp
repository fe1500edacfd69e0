/* The command line of host-d3d12. */
#ifndef HOST_D3D12_OPTIONS_HPP
#define HOST_D3D12_OPTIONS_HPP

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

extern const char options_help[];

/* An error in the command line; its text says what is wrong and what to write instead. */
struct wrong_options : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/* Colour spaces of frames. */
enum class colours { srgb, hdr10, scrgb };

/* The options; texts are UTF-8, and empty if not given. */
struct options {
    bool help = false;
    std::string world;
    /* "forest" of "scene:forest"; empty for the world. */
    std::string scene;
    std::string scenes_program = "scenes";
    std::string seed_picture, preset, script, record;
    std::uint64_t seed = 0;
    std::uint32_t adapter = 0;
    std::uint32_t multiplier = 4;
    /* Anchors per second in a window; 0 for the rate of the world or of the renderer. */
    std::uint32_t rate = 0;
    std::uint32_t width = 0, height = 0;
    colours shown_in = colours::srgb;
    /* Luminance of the pictures' white in nits, for HDR10 and scRGB. */
    std::uint32_t white = 203;
    /* Number of frames to make without a window; 0 for a window. */
    std::uint32_t headless = 0;
    /* Number of frames after which the window closes by itself; 0 for never. */
    std::uint32_t frames = 0;
    bool anchors_on_cpu = false, vsync = true, graph = true, verbose = false;
};

/* Reads the arguments after the program's name; throws wrong_options. */
options read_options(const std::vector<std::string> &arguments);

#endif
