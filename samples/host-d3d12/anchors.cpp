#include "anchors.hpp"

#include "pictures.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

/* Anchors that may wait: one that is shown next, and one behind it. */
static constexpr std::size_t WAITING = 2;

std::uint64_t now_ns()
{
    LARGE_INTEGER ticks, per_second;
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&per_second);
    const auto t = static_cast<std::uint64_t>(ticks.QuadPart), f = static_cast<std::uint64_t>(per_second.QuadPart);
    return t / f * 1000000000 + t % f * 1000000000 / f;
}

anchors::anchors(maker make, bool paced) : make_(std::move(make)), paced_(paced)
{
    thread_ = CreateThread(nullptr, 0, thread, this, 0, nullptr);
    if (thread_ == nullptr) throw std::runtime_error("no thread can be started. End other programs");
}

anchors::~anchors()
{
    {
        const locked lock(lock_);
        stop_ = true;
        if (when_stopped_) when_stopped_();
        WakeAllConditionVariable(&changed_);
    }
    WaitForSingleObject(thread_, INFINITE);
    CloseHandle(thread_);
}

DWORD WINAPI anchors::thread(void *pointer)
{
    auto &self = *static_cast<anchors *>(pointer);
    std::exception_ptr failed;
    try {
        self.make_(self);
    } catch (...) {
        failed = std::current_exception();
    }
    const locked lock(self.lock_);
    self.failed_ = failed;
    self.ended_ = true;
    self.when_stopped_ = nullptr;
    WakeAllConditionVariable(&self.changed_);
    return 0;
}

std::optional<arrival> anchors::take(bool wait)
{
    const locked lock(lock_);
    while (wait && made_.empty() && !ended_) SleepConditionVariableSRW(&changed_, &lock_, INFINITE, 0);
    if (made_.empty()) {
        if (failed_) std::rethrow_exception(std::exchange(failed_, nullptr));
        return std::nullopt;
    }
    arrival next = std::move(made_.front());
    made_.pop_front();
    WakeAllConditionVariable(&changed_);
    return next;
}

bool anchors::ended()
{
    const locked lock(lock_);
    return ended_ && made_.empty() && !failed_;
}

std::string anchors::doing()
{
    const locked lock(lock_);
    return doing_;
}

bool anchors::give(cairn::anchor anchor)
{
    const locked lock(lock_);
    while (made_.size() >= WAITING && !stop_) SleepConditionVariableSRW(&changed_, &lock_, INFINITE, 0);
    if (stop_) return false;
    made_.push_back({std::move(anchor), now_ns()});
    WakeAllConditionVariable(&changed_);
    return true;
}

bool anchors::wait_for_turn(std::uint64_t interval_ns)
{
    const locked lock(lock_);
    while (paced_ && !stop_ && now_ns() < turn_) {
        const std::uint64_t left = turn_ - std::min(turn_, now_ns());
        SleepConditionVariableSRW(&changed_, &lock_, static_cast<DWORD>(left / 1000000 + 1), 0);
    }
    /* One that was late does not make those after it hurry. */
    turn_ = std::max(turn_ + interval_ns, now_ns());
    return !stop_;
}

bool anchors::stopping()
{
    const locked lock(lock_);
    return stop_;
}

void anchors::now_doing(std::string what)
{
    const locked lock(lock_);
    doing_ = std::move(what);
}

void anchors::when_stopped(std::function<void()> what)
{
    const locked lock(lock_);
    when_stopped_ = std::move(what);
    if (stop_ && when_stopped_) when_stopped_();
}

namespace {

/* Says how a thread is stopped, for as long as the object lives. */
class stopped_by {
public:
    stopped_by(anchors &thread, std::function<void()> what) : thread_(thread) { thread_.when_stopped(std::move(what)); }
    ~stopped_by() { thread_.when_stopped(nullptr); }
    stopped_by(const stopped_by &) = delete;
    stopped_by &operator=(const stopped_by &) = delete;

private:
    anchors &thread_;
};

} /* namespace */

/* What the player does where nobody plays: walks on, and slowly turns. */
static const char ahead[] = "cairn-controls 1\n0..600 hold W\n0..600 mouse 36000 0\n600 end\n";

static cairn::world load(const options &o, const cairn::device &device, anchors &to)
{
    cairn::world_options wanted;
    wanted.path = o.world.empty() ? nullptr : o.world.c_str();
    wanted.operating_point = o.preset.empty() ? "stock,pictures:1" : o.preset.c_str();
    return cairn::world::load(device, wanted, [&](const cairn::load_progress &now) {
               const std::string percent = std::to_string(now.total > 0 ? now.done * 100 / now.total : 0);
               to.now_doing((now.stage == CAIRN_LOAD_READING ? "reading the world, " : "preparing the world, ") + percent + " %");
               return !to.stopping();
           }).value();
}

anchors::maker world_anchors(const options &o, const cairn::device &device, input *player)
{
    return [&device, o, player](anchors &to) {
        try {
            const cairn::script script = cairn::script::create(o.script.empty() ? ahead : read_text(o.script)).value();
            const image seed = read_ppm(o.seed_picture.empty() ? beside_program("place.ppm") : o.seed_picture);
            const cairn::world world = load(o, device, to);
            cairn::rollout_options wanted;
            wanted.seed = o.seed;
            cairn::rollout rollout = cairn::rollout::create(world, wanted).value();
            const stopped_by cancel(to, [&] { (void)rollout.cancel(); });
            const std::uint32_t keys = world.info().value().keys, rate = rollout.info().value().latents_per_second;
            const std::uint64_t interval = 1000000000 / (o.rate > 0 ? o.rate : rate);
            to.now_doing("making the first picture");
            rollout.append(cairn::picture_of(seed.rgba, seed.width, seed.height)).value();
            cairn::recorder played = cairn::recorder::create().value();
            for (std::uint64_t latent = 1; to.give(rollout.anchor().value()) && to.wait_for_turn(interval); latent++) {
                const cairn::controls given = player != nullptr ? player->take(keys) : script.controls(latent, rate).value();
                rollout.step(given).value();
                if (o.record.empty()) continue;
                played.step(latent, rate, given).value();
                write_text(o.record + "/controls.txt", played.make_script(latent * 1000000 / rate).value().text().value());
            }
        } catch (const cairn::error &e) {
            if (e.code() != CAIRN_ERROR_CANCELLED || !to.stopping()) throw;
        }
    };
}

namespace {

/* The renderer's program, and the end of a pipe that its pictures come out of. */
class renderer {
public:
    explicit renderer(std::string command)
    {
        SECURITY_ATTRIBUTES inherited = {sizeof inherited, nullptr, TRUE};
        HANDLE write = nullptr;
        if (!CreatePipe(&read_, &write, &inherited, 0)) throw std::runtime_error("no pipe can be made. End other programs");
        SetHandleInformation(read_, HANDLE_FLAG_INHERIT, 0);
        STARTUPINFOW start = {};
        start.cb = sizeof start;
        start.dwFlags = STARTF_USESTDHANDLES;
        start.hStdInput = INVALID_HANDLE_VALUE;
        start.hStdOutput = write;
        start.hStdError = GetStdHandle(STD_ERROR_HANDLE);
        std::wstring wide(command.size() + 1, L'\0');
        MultiByteToWideChar(CP_UTF8, 0, command.c_str(), -1, &wide[0], static_cast<int>(wide.size()));
        PROCESS_INFORMATION made = {};
        const BOOL started = CreateProcessW(nullptr, &wide[0], nullptr, nullptr, TRUE, 0, nullptr, nullptr, &start, &made);
        const DWORD why = GetLastError();
        CloseHandle(write);
        if (!started) {
            CloseHandle(read_);
            throw std::runtime_error(command + ": the renderer does not start: error " + std::to_string(why) +
                                     ". Build it (cargo build --release -p scenes) and name it: --scenes target/release/scenes");
        }
        CloseHandle(made.hThread);
        process_ = made.hProcess;
    }
    ~renderer()
    {
        end();
        WaitForSingleObject(process_, INFINITE);
        CloseHandle(process_);
        CloseHandle(read_);
    }
    renderer(const renderer &) = delete;
    renderer &operator=(const renderer &) = delete;

    /* Fills all of `bytes`; false at the end of the pictures. */
    bool read(std::vector<unsigned char> &bytes)
    {
        std::size_t done = 0;
        while (done < bytes.size()) {
            DWORD count = 0;
            const auto left = static_cast<DWORD>(std::min<std::size_t>(bytes.size() - done, 1 << 20));
            if (!ReadFile(read_, &bytes[done], left, &count, nullptr) || count == 0) return false;
            done += count;
        }
        return true;
    }
    /* How the program ended by itself; 0 is well. */
    DWORD ended()
    {
        DWORD code = 1;
        WaitForSingleObject(process_, INFINITE);
        GetExitCodeProcess(process_, &code);
        return code;
    }
    void end() { TerminateProcess(process_, 1); }

private:
    HANDLE process_ = nullptr, read_ = nullptr;
};

} /* namespace */

anchors::maker scene_anchors(const options &o, std::uint32_t width, std::uint32_t height)
{
    return [o, width, height](anchors &to) {
        to.now_doing("starting the renderer");
        renderer scenes("\"" + o.scenes_program + "\" clip --scene " + o.scene + " --seconds 600 --rate " + std::to_string(SCENE_RATE) +
                        " --size " + std::to_string(width) + "x" + std::to_string(height) + " --raw -");
        const stopped_by end(to, [&] { scenes.end(); });
        std::vector<unsigned char> rgb(std::size_t{width} * height * 3);
        image picture(width, height);
        std::uint64_t number = 0;
        for (; to.wait_for_turn(1000000000 / (o.rate > 0 ? o.rate : SCENE_RATE)) && scenes.read(rgb); number++) {
            for (std::size_t i = 0; i < rgb.size(); i++) picture.rgba[i / 3 * 4 + i % 3] = rgb[i];
            for (std::size_t i = 3; i < picture.rgba.size(); i += 4) picture.rgba[i] = 255;
            if (!to.give(cairn::anchor::create(cairn::picture_of(picture.rgba, width, height), number).value())) break;
        }
        if (!to.stopping() && scenes.ended() != 0) {
            throw std::runtime_error(o.scenes_program + ": the renderer failed after " + std::to_string(number) +
                                     " pictures; it says why above. Build it anew: cargo build --release -p scenes");
        }
    };
}
