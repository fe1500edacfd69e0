#include "options.hpp"

#include <cstddef>

const char options_help[] =
    "host-d3d12: a world in a window, by keyboard and mouse, on Direct3D 12\n"
    "\n"
    "usage: host-d3d12 [WORLD] [options]\n"
    "\n"
    "  WORLD                a bundle: a directory, or one file; without one, the world inside the library\n"
    "\n"
    "In the window: W A S D walk, the mouse looks around, Space jumps, Esc quits. The graph at the bottom has a bar for each\n"
    "frame: its height is the time since the previous frame, with lines at 1/60 and 1/30 s. White is an anchor, green a\n"
    "generated frame, yellow an extrapolated frame, red a held frame.\n"
    "\n"
    "what is shown\n"
    "  --source world       anchors from the world; so it is without this option\n"
    "  --source scene:NAME  anchors from a renderer: forest, sword, desert or snow, on the scene's own walk. Keyboard and\n"
    "                       mouse do nothing there. Needs the program `scenes` (cargo build --release -p scenes)\n"
    "  --scenes PROGRAM     that program; without this option it is looked for beside host-d3d12 and on the PATH\n"
    "  --seed-picture FILE  where the world begins, a PPM (P6) of any size; place.ppm beside host-d3d12 without it\n"
    "  --preset TEXT        how the world runs, such as baseline-112 or stock,g64; stock,pictures:1 without it\n"
    "  --seed N             seed of the world's noise; 0 without it\n"
    "  --script FILE        what the player does (docs/control-script.md), instead of keyboard and mouse\n"
    "\n"
    "how it is shown\n"
    "  --multiplier N       frames to an anchor: 1, 2, 3, 4 or 6; 4 without it\n"
    "  --rate N             anchors a second, 1 to 60. Fewer than the world's 15 show it slowly, and all of it: for machines that\n"
    "                       cannot make more\n"
    "  --size WxH           of the frames; a window stretches them to its own size. 960x540 without it, and without a window\n"
    "                       as large as the anchors\n"
    "  --colours WHICH      srgb; or for displays of a high dynamic range hdr10 (PQ, 10 bits) or scrgb (light, half floats). srgb\n"
    "                       without it\n"
    "  --white NITS         how bright the pictures' white is in hdr10 and scrgb, 80 to 1000; 203 without it\n"
    "  --adapter N          which graphics adapter, the fastest being 0\n"
    "  --anchors gpu|cpu    where the world runs: on that adapter by DirectML, beside the frames; or on the processor\n"
    "  --no-vsync           do not wait for the display\n"
    "  --no-graph           leave the picture alone\n"
    "  --frames N           close the window by itself after N frames\n"
    "\n"
    "without a window\n"
    "  --headless N         make N frames as fast as possible and reproducibly: time is computed, not measured, and the player\n"
    "                       follows the script, or walks ahead\n"
    "  --record DIR         write them there: frame-00000.ppm and so on (of scrgb .pfm), the anchors they were made of as\n"
    "                       anchor-00000.ppm, and frames.csv, which says what each frame is. With a window the anchors only. What the player of\n"
    "                       a world did is in controls.txt, for --script\n"
    "\n"
    "  --verbose            print the library's log\n"
    "  --help               this\n"
    "\n"
    "Beside host-d3d12 lie cairn.dll, onnxruntime.dll and DirectML.dll; or CAIRN_ONNXRUNTIME names onnxruntime.dll.\n"
    "Ends with 0, with 1 when something failed, and with 2 when the command line is wrong.\n";

/* Parses a whole number from `min` to `max`. */
static std::uint64_t number(const std::string &name, const std::string &text, std::uint64_t min, std::uint64_t max)
{
    std::uint64_t value = 0;
    bool good = !text.empty() && text.size() < 20;
    for (const char digit : text) {
        good = good && digit >= '0' && digit <= '9';
        value = value * 10 + static_cast<std::uint64_t>(digit - '0');
    }
    if (!good || value < min || value > max) {
        throw wrong_options(name + ": \"" + text + "\" is no number from " + std::to_string(min) + " to " + std::to_string(max));
    }
    return value;
}

static void size(const std::string &text, options &to)
{
    const std::size_t x = text.find('x');
    if (x == std::string::npos) throw wrong_options("--size: \"" + text + "\" is no size. Write it as 960x540");
    to.width = static_cast<std::uint32_t>(number("--size", text.substr(0, x), 16, 8192));
    to.height = static_cast<std::uint32_t>(number("--size", text.substr(x + 1), 16, 8192));
}

static std::string scene(const std::string &text)
{
    if (text == "world") return {};
    for (const char *name : {"forest", "sword", "desert", "snow"}) {
        if (text == std::string("scene:") + name) return name;
    }
    throw wrong_options("--source: \"" + text + "\" is neither world nor scene:forest, scene:sword, scene:desert or scene:snow");
}

static colours colours_of(const std::string &text)
{
    if (text == "srgb") return colours::srgb;
    if (text == "hdr10") return colours::hdr10;
    if (text == "scrgb") return colours::scrgb;
    throw wrong_options("--colours: \"" + text + "\" is neither srgb, hdr10 nor scrgb");
}

/* Throws for options that exclude each other. */
static void check_combination(const options &o)
{
    if (o.headless != 0 && o.frames != 0) throw wrong_options("--frames: is for a window; --headless N says how many frames");
    if (o.headless != 0 && o.rate != 0) throw wrong_options("--rate: is for a window; without one, time is computed");
    const bool known = o.multiplier == 1 || o.multiplier == 2 || o.multiplier == 3 || o.multiplier == 4 || o.multiplier == 6;
    if (!known) throw wrong_options("--multiplier: give 1, 2, 3, 4 or 6");
    if (o.scene.empty()) return;
    if (!o.world.empty()) throw wrong_options("--source: a scene is shown without a world; leave out \"" + o.world + "\"");
    if (!o.script.empty()) throw wrong_options("--script: a scene has a walk of its own; leave one of both out");
}

options read_options(const std::vector<std::string> &arguments)
{
    options o;
    bool white = false;
    for (std::size_t i = 0; i < arguments.size(); i++) {
        const std::string &name = arguments[i];
        const auto value = [&]() -> const std::string & {
            if (++i == arguments.size()) throw wrong_options(name + ": needs something behind it");
            return arguments[i];
        };
        if (name == "--help" || name == "-h") {
            o.help = true;
            return o;
        }
        if (name == "--source") o.scene = scene(value());
        else if (name == "--scenes") o.scenes_program = value();
        else if (name == "--seed-picture") o.seed_picture = value();
        else if (name == "--preset") o.preset = value();
        else if (name == "--seed") o.seed = number(name, value(), 0, UINT64_MAX / 10);
        else if (name == "--script") o.script = value();
        else if (name == "--multiplier") o.multiplier = static_cast<std::uint32_t>(number(name, value(), 1, 6));
        else if (name == "--rate") o.rate = static_cast<std::uint32_t>(number(name, value(), 1, 60));
        else if (name == "--size") size(value(), o);
        else if (name == "--colours") o.shown_in = colours_of(value());
        else if (name == "--white") {
            o.white = static_cast<std::uint32_t>(number(name, value(), 80, 1000));
            white = true;
        }
        else if (name == "--adapter") o.adapter = static_cast<std::uint32_t>(number(name, value(), 0, 63));
        else if (name == "--anchors") {
            const std::string &where = value();
            if (where != "gpu" && where != "cpu") throw wrong_options("--anchors: \"" + where + "\" is neither gpu nor cpu");
            o.anchors_on_cpu = where == "cpu";
        }
        else if (name == "--no-vsync") o.vsync = false;
        else if (name == "--no-graph") o.graph = false;
        else if (name == "--frames") o.frames = static_cast<std::uint32_t>(number(name, value(), 1, 1000000));
        else if (name == "--headless") o.headless = static_cast<std::uint32_t>(number(name, value(), 1, 100000));
        else if (name == "--record") o.record = value();
        else if (name == "--verbose") o.verbose = true;
        else if (name.rfind("-", 0) == 0) throw wrong_options(name + ": is no option");
        else if (!o.world.empty()) throw wrong_options(name + ": there is a world already, " + o.world);
        else o.world = name;
    }
    check_combination(o);
    if (white && o.shown_in == colours::srgb) throw wrong_options("--white: is for --colours hdr10 or scrgb");
    return o;
}
