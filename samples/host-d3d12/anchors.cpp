#include "anchors.hpp"

#include "pictures.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

/* Capacity of the queue: the anchor that is shown next, and the one after it. */
static constexpr std::size_t CAPACITY = 2;

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
        const lock_guard lock(lock_);
        stop_ = true;
        if (interrupt_) interrupt_();
        WakeAllConditionVariable(&changed_);
    }
    WaitForSingleObject(thread_, INFINITE);
    CloseHandle(thread_);
}

DWORD WINAPI anchors::thread(void *pointer)
{
    auto &self = *static_cast<anchors *>(pointer);
    std::exception_ptr error;
    try {
        self.make_(self);
    } catch (...) {
        error = std::current_exception();
    }
    const lock_guard lock(self.lock_);
    self.error_ = error;
    self.ended_ = true;
    self.interrupt_ = nullptr;
    WakeAllConditionVariable(&self.changed_);
    return 0;
}

std::optional<timed_anchor> anchors::take(bool wait)
{
    const lock_guard lock(lock_);
    while (wait && queue_.empty() && !ended_) SleepConditionVariableSRW(&changed_, &lock_, INFINITE, 0);
    if (queue_.empty()) {
        if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
        return std::nullopt;
    }
    timed_anchor next = std::move(queue_.front());
    queue_.pop_front();
    WakeAllConditionVariable(&changed_);
    return next;
}

bool anchors::ended()
{
    const lock_guard lock(lock_);
    return ended_ && queue_.empty() && !error_;
}

std::string anchors::status()
{
    const lock_guard lock(lock_);
    return status_;
}

bool anchors::push(cairn::anchor anchor)
{
    const lock_guard lock(lock_);
    while (queue_.size() >= CAPACITY && !stop_) SleepConditionVariableSRW(&changed_, &lock_, INFINITE, 0);
    if (stop_) return false;
    queue_.push_back({std::move(anchor), now_ns()});
    WakeAllConditionVariable(&changed_);
    return true;
}

bool anchors::wait_for_interval(std::uint64_t interval_ns)
{
    const lock_guard lock(lock_);
    while (paced_ && !stop_ && now_ns() < next_start_ns_) {
        const std::uint64_t left = next_start_ns_ - std::min(next_start_ns_, now_ns());
        SleepConditionVariableSRW(&changed_, &lock_, static_cast<DWORD>(left / 1000000 + 1), 0);
    }
    /* After a late anchor the following ones keep the full interval: they do not catch up. */
    next_start_ns_ = std::max(next_start_ns_ + interval_ns, now_ns());
    return !stop_;
}

bool anchors::stopping()
{
    const lock_guard lock(lock_);
    return stop_;
}

void anchors::set_status(std::string text)
{
    const lock_guard lock(lock_);
    status_ = std::move(text);
}

void anchors::set_interrupt(std::function<void()> interrupt)
{
    const lock_guard lock(lock_);
    interrupt_ = std::move(interrupt);
    if (stop_ && interrupt_) interrupt_();
}

namespace {

/* Sets a thread's interrupt for the lifetime of the object. */
class interrupt_scope {
public:
    interrupt_scope(anchors &thread, std::function<void()> interrupt) : thread_(thread) { thread_.set_interrupt(std::move(interrupt)); }
    ~interrupt_scope() { thread_.set_interrupt(nullptr); }
    interrupt_scope(const interrupt_scope &) = delete;
    interrupt_scope &operator=(const interrupt_scope &) = delete;

private:
    anchors &thread_;
};

} /* namespace */

/* The script that is played without player and --script: walks ahead, and turns slowly. */
static const char default_script[] = "cairn-controls 1\n0..600 hold W\n0..600 mouse 36000 0\n600 end\n";

static cairn::world load(const options &o, const cairn::device &device, anchors &to)
{
    cairn::world_options world_options;
    world_options.path = o.world.empty() ? nullptr : o.world.c_str();
    world_options.operating_point = o.preset.empty() ? "stock,pictures:1" : o.preset.c_str();
    return cairn::world::load(device, world_options, [&](const cairn::load_progress &now) {
               const std::string percent = std::to_string(now.total > 0 ? now.done * 100 / now.total : 0);
               to.set_status((now.stage == CAIRN_LOAD_READING ? "reading the world, " : "preparing the world, ") + percent + " %");
               return !to.stopping();
           }).value();
}

anchors::maker world_anchors(const options &o, const cairn::device &device, input *player)
{
    return [&device, o, player](anchors &to) {
        try {
            const cairn::script script = cairn::script::create(o.script.empty() ? default_script : read_text(o.script)).value();
            const image seed = read_ppm(o.seed_picture.empty() ? beside_program("place.ppm") : o.seed_picture);
            const cairn::world world = load(o, device, to);
            cairn::rollout_options rollout_options;
            rollout_options.seed = o.seed;
            cairn::rollout rollout = cairn::rollout::create(world, rollout_options).value();
            const interrupt_scope cancel(to, [&] { (void)rollout.cancel(); });
            const std::uint32_t keys = world.info().value().keys, rate = rollout.info().value().latents_per_second;
            const std::uint64_t interval = 1000000000 / (o.rate > 0 ? o.rate : rate);
            to.set_status("making the first picture");
            rollout.append(cairn::picture_of(seed.rgba, seed.width, seed.height)).value();
            cairn::recorder recorder = cairn::recorder::create().value();
            for (std::uint64_t latent = 1; to.push(rollout.anchor().value()) && to.wait_for_interval(interval); latent++) {
                const cairn::controls controls = player != nullptr ? player->take(keys) : script.controls(latent, rate).value();
                rollout.step(controls).value();
                if (o.record.empty()) continue;
                recorder.step(latent, rate, controls).value();
                write_text(o.record + "/controls.txt", recorder.make_script(latent * 1000000 / rate).value().text().value());
            }
        } catch (const cairn::error &e) {
            if (e.code() != CAIRN_ERROR_CANCELLED || !to.stopping()) throw;
        }
    };
}

namespace {

/* The process of the renderer's program, and the read end of the pipe to which it writes its pictures. */
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
        terminate();
        WaitForSingleObject(process_, INFINITE);
        CloseHandle(process_);
        CloseHandle(read_);
    }
    renderer(const renderer &) = delete;
    renderer &operator=(const renderer &) = delete;

    /* Fills all of `bytes`; false at the end of the pipe. */
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
    /* Waits for the program to end; its exit code. */
    DWORD exit_code()
    {
        DWORD code = 1;
        WaitForSingleObject(process_, INFINITE);
        GetExitCodeProcess(process_, &code);
        return code;
    }
    void terminate() { TerminateProcess(process_, 1); }

private:
    HANDLE process_ = nullptr, read_ = nullptr;
};

} /* namespace */

anchors::maker scene_anchors(const options &o, std::uint32_t width, std::uint32_t height)
{
    return [o, width, height](anchors &to) {
        to.set_status("starting the renderer");
        renderer scenes("\"" + o.scenes_program + "\" clip --scene " + o.scene + " --seconds 600 --rate " + std::to_string(SCENE_RATE) +
                        " --size " + std::to_string(width) + "x" + std::to_string(height) + " --raw -");
        const interrupt_scope interrupt(to, [&] { scenes.terminate(); });
        std::vector<unsigned char> rgb(std::size_t{width} * height * 3);
        image picture(width, height);
        std::uint64_t number = 0;
        for (; to.wait_for_interval(1000000000 / (o.rate > 0 ? o.rate : SCENE_RATE)) && scenes.read(rgb); number++) {
            for (std::size_t i = 0; i < rgb.size(); i++) picture.rgba[i / 3 * 4 + i % 3] = rgb[i];
            for (std::size_t i = 3; i < picture.rgba.size(); i += 4) picture.rgba[i] = 255;
            if (!to.push(cairn::anchor::create(cairn::picture_of(picture.rgba, width, height), number).value())) break;
        }
        if (!to.stopping() && scenes.exit_code() != 0) {
            throw std::runtime_error(o.scenes_program + ": the renderer failed after " + std::to_string(number) +
                                     " pictures; it says why above. Build it anew: cargo build --release -p scenes");
        }
    };
}
