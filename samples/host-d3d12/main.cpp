/*
 * A host of Cairn on Direct3D 12: plays a world in a window, or writes frames to files without a window.
 *
 * Read it from the bottom: main() reads the command line, and run() creates the graphics device and Cairn's device on it. Then
 * in_window() or without_window() starts a thread that makes anchors, and presents frames. show() has all that an engine needs: one call
 * records the frame that is due into the engine's command list, after which the engine records its own drawing.
 */
#include "anchors.hpp"
#include "gpu.hpp"
#include "graph.hpp"
#include "options.hpp"
#include "pictures.hpp"
#include "window.hpp"

#include <cairn.hpp>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <shellapi.h>

static constexpr std::uint64_t SECOND = 1000000000;

/* The options and devices that the functions below use. */
struct host {
    const options &o;
    gpu &gpu;
    /* Cairn's device on the graphics device. */
    const cairn::device &device;
};

/* Creates a presenter of frames of that size; 0 for the anchors' size. */
static cairn::presenter make_presenter(const options &o, std::uint32_t width, std::uint32_t height, std::uint64_t interval_ns,
                                       std::uint32_t flags)
{
    cairn::presenter_options presenter_options;
    presenter_options.multiplier = o.multiplier;
    presenter_options.width = width;
    presenter_options.height = height;
    presenter_options.interval_ns = interval_ns;
    presenter_options.flags = CAIRN_PRESENTER_NO_DECODED | flags;
    presenter_options.colour_space = format_of(o.shown_in).space;
    presenter_options.white_nits = o.shown_in == colours::srgb ? 0 : o.white;
    return cairn::presenter::create(presenter_options).value();
}

/*
 * Creates everything that frames of that size need, so that the first frame takes no longer than others. Call it after the first anchor
 * was pushed, whose size is needed. An engine does this on a loading thread; this program may wait, as it shows nothing yet.
 */
static void prepare(const host &host, const cairn::presenter &presenter, std::uint32_t width, std::uint32_t height)
{
    cairn::d3d12_preparation preparation;
    preparation.format = static_cast<std::uint32_t>(format_of(host.o.shown_in).format);
    preparation.width = width;
    preparation.height = height;
    presenter.prepare_d3d12(host.device, preparation).value();
}

/*
 * Records the frame that is due at `now` into `target`, and submits it. The target goes from state `before` to `after`. `draw_over` records
 * further drawing, with the target in state COPY_DEST.
 */
template <class DrawOver>
static std::optional<cairn::frame> show(const host &host, cairn::presenter &presenter, std::uint64_t now, ID3D12Resource *target,
                                        D3D12_RESOURCE_STATES before, D3D12_RESOURCE_STATES after, DrawOver draw_over)
{
    ID3D12GraphicsCommandList *list = host.gpu.begin();
    cairn::d3d12_recording recording;
    recording.list = list;
    recording.target = target;
    recording.state_before = static_cast<std::uint32_t>(before);
    recording.state_after = static_cast<std::uint32_t>(D3D12_RESOURCE_STATE_COPY_DEST);
    recording.fence = host.gpu.fence();
    recording.fence_value = host.gpu.value_of_open_list();
    const auto frame = presenter.record_d3d12(host.device, now, recording).value();
    if (frame) {
        draw_over(list);
        const D3D12_RESOURCE_BARRIER barrier = transition(target, D3D12_RESOURCE_STATE_COPY_DEST, after);
        list->ResourceBarrier(1, &barrier);
    }
    host.gpu.submit();
    return frame;
}

static const char *source_name(std::uint32_t source)
{
    static const char *const names[] = {"", "anchor", "decoded", "generated", "extrapolated", "held"};
    return source < sizeof names / sizeof names[0] ? names[source] : "new";
}

static void print_statistics(const cairn::presenter &presenter)
{
    const auto s = presenter.statistics().value();
    std::printf("shown: %llu anchors, %llu generated, %llu extrapolated, %llu held; %llu of %llu anchors were late; generator %s\n",
                static_cast<unsigned long long>(s.shown_anchors), static_cast<unsigned long long>(s.shown_generated),
                static_cast<unsigned long long>(s.shown_extrapolated), static_cast<unsigned long long>(s.shown_held),
                static_cast<unsigned long long>(s.late_anchors), static_cast<unsigned long long>(s.anchors), s.generator);
}

/* Writes anchors and frames to a folder; with an empty name it writes nothing. */
class record {
public:
    explicit record(std::string folder) : folder_(std::move(folder))
    {
        if (!folder_.empty()) make_folder(folder_);
    }
    void anchor(const cairn::anchor &anchor) const
    {
        if (folder_.empty()) return;
        const auto info = anchor.info().value();
        image picture(info.width, info.height);
        anchor.read_picture(info.pictures - 1, cairn::target_of(picture.rgba, info.width, info.height)).value();
        write_ppm(name("anchor", info.latent) + ".ppm", picture);
    }
    void frame(std::uint32_t number, const cairn::frame &frame, const offscreen &from)
    {
        if (folder_.empty()) return;
        from.write(name("frame", number));
        char line[128];
        std::snprintf(line, sizeof line, "%u,%s,%llu,%llu,%.4f\n", static_cast<unsigned>(number), source_name(frame.source),
                      static_cast<unsigned long long>(frame.previous), static_cast<unsigned long long>(frame.current),
                      static_cast<double>(frame.t));
        lines_ += line;
    }
    void end() const
    {
        if (!folder_.empty()) write_text(folder_ + "/frames.csv", "frame,source,previous,current,t\n" + lines_);
    }

private:
    std::string name(const char *what, std::uint64_t number) const
    {
        char text[64];
        std::snprintf(text, sizeof text, "/%s-%05llu", what, static_cast<unsigned long long>(number));
        return folder_ + text;
    }

    std::string folder_, lines_;
};

/* ---- In a window ------------------------------------------------------------------------------------------------- */

/* Measures the rates that the window's title shows. */
class rates {
public:
    /* Counts a frame. Returns a new title twice a second. */
    std::optional<std::string> count(std::uint64_t now, const cairn::presenter &presenter, const options &o)
    {
        frames_++;
        if (now - since_ < SECOND / 2) return std::nullopt;
        const auto s = presenter.statistics().value();
        const double seconds = static_cast<double>(now - since_) / static_cast<double>(SECOND);
        char text[200];
        std::snprintf(text, sizeof text, "Cairn: %s | %.1f frames/s from %.1f anchors/s, %ux | generator %s | %llu late | Esc quits",
                      o.scene.empty() ? "world" : o.scene.c_str(), frames_ / seconds, static_cast<double>(s.anchors - anchors_) / seconds,
                      static_cast<unsigned>(o.multiplier), s.generator, static_cast<unsigned long long>(s.late_anchors));
        frames_ = 0;
        anchors_ = s.anchors;
        since_ = now;
        return text;
    }

private:
    double frames_ = 0;
    std::uint64_t anchors_ = 0, since_ = now_ns();
};

static void in_window(const host &host, const cairn::device &world_device)
{
    const options &o = host.o;
    const std::uint32_t width = o.width > 0 ? o.width : 960, height = o.height > 0 ? o.height : 540;
    input player;
    window window(L"Cairn", width, height, player);
    swapchain chain(host.gpu, window.handle(), width, height, format_of(o.shown_in));
    graph graph(host.gpu, o.shown_in, o.white);
    const std::uint32_t rate = o.rate > 0 || o.scene.empty() ? o.rate : SCENE_RATE;
    cairn::presenter presenter = make_presenter(o, width, height, rate > 0 ? SECOND / rate : 0, CAIRN_PRESENTER_CATCH_UP);
    const idle_at_exit wait(host.gpu);
    anchors anchors(o.scene.empty() ? world_anchors(o, world_device, o.script.empty() ? &player : nullptr)
                                    : scene_anchors(o, std::min(width, 640u), std::min(height, 360u)),
                    true);
    const record record(o.record);
    rates rates;
    std::optional<timed_anchor> next;
    std::uint64_t last = 0;
    std::uint32_t count = 0;
    std::optional<cairn::frame> shown;
    bool prepared = false;
    while (!window.closed()) {
        /* While the presenter's queue is full, the next anchor waits in `next`. */
        while ((next || (next = anchors.take(false))) && presenter.push(next->anchor, next->when_ns).value()) {
            record.anchor(next->anchor);
            next.reset();
        }
        const std::uint64_t now = now_ns();
        const auto due = presenter.query(now).value();
        if (due && !prepared) {
            prepare(host, presenter, width, height);
            prepared = true;
        }
        if (!due) window.title("Cairn: " + anchors.status());
        const bool same = due && shown && due->since_ns == shown->since_ns && due->position == shown->position;
        if (!due || window.minimised() || (same && due->until_ns <= now)) {
            window.handle_messages(4);
            continue;
        }
        if (same) {
            /* The frame that is due is on the display already: handle messages until the next one is due. */
            window.handle_messages(static_cast<DWORD>(std::min<std::uint64_t>((due->until_ns - now) / 1000000, 4)));
            if (now_ns() < due->until_ns) continue;
        }
        const auto frame = show(host, presenter, now_ns(), chain.target(), D3D12_RESOURCE_STATE_PRESENT, D3D12_RESOURCE_STATE_PRESENT,
                                [&](ID3D12GraphicsCommandList *list) {
                                    if (o.graph) graph.record(host.gpu, list, chain.target(), width, height);
                                });
        chain.present(o.vsync);
        const std::uint64_t done = now_ns();
        if (last != 0 && frame) graph.add(static_cast<float>(done - last) / 1e6f, frame->source);
        last = done;
        shown = frame;
        if (const auto title = rates.count(done, presenter, o)) window.title(*title);
        window.handle_messages(0);
        if (++count == o.frames) break;
        if (anchors.ended() && frame && frame->source == CAIRN_FRAME_HELD) break;
    }
    print_statistics(presenter);
}

/* ---- Without a window -------------------------------------------------------------------------------------------- */

static void without_window(const host &host, const cairn::device &world_device)
{
    const options &o = host.o;
    record record(o.record);
    const std::uint32_t scene_width = o.width > 0 ? o.width : 640, scene_height = o.height > 0 ? o.height : 360;
    anchors anchors(o.scene.empty() ? world_anchors(o, world_device, nullptr) : scene_anchors(o, scene_width, scene_height), false);
    std::optional<timed_anchor> next = anchors.take(true);
    if (!next) throw std::runtime_error("no anchor came at all");
    const auto info = next->anchor.info().value();
    const std::uint32_t width = o.width > 0 ? o.width : info.width, height = o.height > 0 ? o.height : info.height;
    /* Time is computed, not measured: anchor i comes at i intervals. The interval is a multiple of 12 ns, so that 2, 3, 4 or 6 divide it. */
    const std::uint64_t interval = SECOND / (info.latents_per_second > 0 ? info.latents_per_second : SCENE_RATE) / 12 * 12;
    offscreen target(host.gpu, width, height, format_of(o.shown_in));
    cairn::presenter presenter = make_presenter(o, width, height, interval, 0);
    const idle_at_exit wait(host.gpu);
    std::uint64_t pushed = 0;
    for (std::uint32_t i = 0; i < o.headless; i++) {
        /* An anchor is shown one interval after it came, when the next one is there. */
        const std::uint64_t now = interval + i * interval / o.multiplier;
        for (; pushed * interval <= now; pushed++) {
            if (pushed > 0) next = anchors.take(true);
            if (!next) throw std::runtime_error("there are " + std::to_string(pushed) + " anchors and no more. Give a smaller --headless");
            record.anchor(next->anchor);
            presenter.push(next->anchor, pushed * interval).value();
        }
        if (i == 0) prepare(host, presenter, width, height);
        const auto frame = show(host, presenter, now, target.target(), D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_COMMON,
                                [](ID3D12GraphicsCommandList *) {});
        ID3D12GraphicsCommandList *list = host.gpu.begin();
        const D3D12_RESOURCE_BARRIER read = transition(target.target(), D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_COPY_SOURCE);
        list->ResourceBarrier(1, &read);
        target.record_read(list);
        host.gpu.submit();
        host.gpu.wait_idle();
        if (frame) record.frame(i, *frame, target);
        std::fprintf(stderr, "\rframe %u of %u ", static_cast<unsigned>(i + 1), static_cast<unsigned>(o.headless));
    }
    std::fprintf(stderr, "\n");
    record.end();
    print_statistics(presenter);
}

/* ---- The program ------------------------------------------------------------------------------------------------- */

static void on_log(std::uint32_t level, const char *target, const char *message, void *)
{
    static const char *const names[] = {"", "error", "warning", "info", "debug", "trace"};
    std::fprintf(stderr, "%s: %s: %s\n", level <= CAIRN_LOG_TRACE ? names[level] : "", target, message);
}

/* Device options of a tool: its user's environment may name libraries. A game leaves this flag out. */
static cairn::device_options tool_options()
{
    cairn::device_options options;
    options.flags = CAIRN_DEVICE_ENVIRONMENT;
    return options;
}

/* Prints what Direct3D 12 and DirectML need and what was found, when a device cannot be created. */
static void print_requirements()
{
    const auto rows = cairn::requirements(CAIRN_DEVICE_D3D12, tool_options());
    for (std::size_t i = 0; rows.ok() && i < rows->size(); i++) {
        const cairn::requirement &r = (*rows)[i];
        const char *status = r.status == CAIRN_REQUIREMENT_MET        ? "ok     "
                             : r.status == CAIRN_REQUIREMENT_NOT_MET  ? "MISSING"
                             : r.status == CAIRN_REQUIREMENT_OPTIONAL ? "absent "
                                                                      : "unknown";
        std::fprintf(stderr, "  %s  needed: %s; found: %s\n", status, r.needed, r.found);
    }
}

static void run(const options &o)
{
    cairn::check_version().value();
    if (o.verbose) cairn::set_log_callback(CAIRN_LOG_INFO, on_log).value();
    gpu gpu(o.adapter);
    auto device = cairn::device::d3d12(gpu.device(), gpu.queue(), nullptr, tool_options());
    if (!device.ok()) print_requirements();
    const cairn::device on_gpu = std::move(device).value();
    const cairn::device processor = o.anchors_on_cpu ? cairn::device::cpu(tool_options()).value() : cairn::device();
    std::printf("adapter: %s\nanchors: %s\n", gpu.name().c_str(),
                o.scene.empty() ? (o.anchors_on_cpu ? processor : on_gpu).info().value().description : ("scene " + o.scene).c_str());
    const host host = {o, gpu, on_gpu};
    if (o.headless > 0) without_window(host, o.anchors_on_cpu ? processor : on_gpu);
    else in_window(host, o.anchors_on_cpu ? processor : on_gpu);
}

/* The arguments after the program's name, in UTF-8 regardless of the system's code page. */
static std::vector<std::string> arguments()
{
    int count = 0;
    std::vector<std::string> texts;
    LPWSTR *wide = CommandLineToArgvW(GetCommandLineW(), &count);
    for (int i = 1; wide != nullptr && i < count; i++) {
        std::string text(static_cast<std::size_t>(WideCharToMultiByte(CP_UTF8, 0, wide[i], -1, nullptr, 0, nullptr, nullptr)), '\0');
        WideCharToMultiByte(CP_UTF8, 0, wide[i], -1, &text[0], static_cast<int>(text.size()), nullptr, nullptr);
        text.pop_back();
        texts.push_back(std::move(text));
    }
    LocalFree(wide);
    return texts;
}

int main()
{
    SetConsoleOutputCP(CP_UTF8);
    try {
        const options o = read_options(arguments());
        if (o.help) std::fputs(options_help, stdout);
        else run(o);
        return 0;
    } catch (const wrong_options &e) {
        std::fprintf(stderr, "host-d3d12: %s. See host-d3d12 --help\n", e.what());
        return 2;
    } catch (const cairn::error &e) {
        std::fprintf(stderr, "host-d3d12: %s (%s)\n", e.what(), cairn::result_name(e.code()));
    } catch (const std::exception &e) {
        std::fprintf(stderr, "host-d3d12: %s\n", e.what());
    }
    return 1;
}
