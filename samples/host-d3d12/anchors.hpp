/* A thread that makes anchors from a world or from a renderer. */
#ifndef HOST_D3D12_ANCHORS_HPP
#define HOST_D3D12_ANCHORS_HPP

#include "options.hpp"
#include "window.hpp"

#include <cairn.hpp>

#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <optional>
#include <string>

/* Nanoseconds of a monotonic clock. */
std::uint64_t now_ns();

/* An anchor, and the time at which it was made. */
struct timed_anchor {
    cairn::anchor anchor;
    std::uint64_t when_ns;
};

/* A thread that makes anchors, and a short queue of them. */
class anchors {
public:
    /* The thread's function: makes anchors until push() or wait_for_interval() returns false, or there are no more. take() rethrows what it
     * throws. */
    using maker = std::function<void(anchors &)>;

    /* Starts the thread. If `paced`, it makes anchors at a steady rate, otherwise as fast as they are taken. */
    anchors(maker make, bool paced);
    /* Stops the thread, and waits for it. */
    ~anchors();
    anchors(const anchors &) = delete;
    anchors &operator=(const anchors &) = delete;

    /* Takes the next anchor from the queue. If the queue is empty: waits for one if `wait` is set, else returns none. Also returns none when
     * the thread has ended. */
    std::optional<timed_anchor> take(bool wait);
    /* Whether no more anchors will come. */
    bool ended();
    /* What the thread is doing at present, as a text for the user. */
    std::string status();

    /* For the thread's function: puts an anchor into the queue once there is room. False when the thread must end. */
    bool push(cairn::anchor anchor);
    /* For the thread's function: waits until `interval_ns` after the start of the previous anchor. False when the thread must end. */
    bool wait_for_interval(std::uint64_t interval_ns);
    /* For the thread's function: whether it must end. */
    bool stopping();
    /* For the thread's function: sets status(). */
    void set_status(std::string text);
    /* For the thread's function: sets what the destructor calls, on its own thread, to interrupt a long call of the function. */
    void set_interrupt(std::function<void()> interrupt);

private:
    static DWORD WINAPI thread(void *self);

    maker make_;
    bool paced_, stop_ = false, ended_ = false;
    SRWLOCK lock_ = SRWLOCK_INIT;
    CONDITION_VARIABLE changed_ = CONDITION_VARIABLE_INIT;
    std::deque<timed_anchor> queue_;
    std::exception_ptr error_;
    std::function<void()> interrupt_;
    std::string status_;
    std::uint64_t next_start_ns_ = 0;
    HANDLE thread_ = nullptr;
};

/* Makes anchors with a world on `device`, which must outlive the thread. `player` is the window's input; null to play the script. */
anchors::maker world_anchors(const options &options, const cairn::device &device, input *player);
/* Makes anchors of that size from the pictures of the renderer's program. */
anchors::maker scene_anchors(const options &options, std::uint32_t width, std::uint32_t height);

/* Pictures per second of the renderer. */
constexpr std::uint32_t SCENE_RATE = 15;

#endif
