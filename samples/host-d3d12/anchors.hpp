/* Anchors on a thread of their own: from a world, or from a renderer. */
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

/* Nanoseconds of a clock that only goes forward. */
std::uint64_t now_ns();

/* An anchor, and when it was made. */
struct arrival {
    cairn::anchor anchor;
    std::uint64_t when_ns;
};

/* A thread that makes anchors, and the few that wait to be taken. */
class anchors {
public:
    /* Makes anchors until give() or wait_for_turn() answers false, or there are no more. What it throws comes out of take(). */
    using maker = std::function<void(anchors &)>;

    /* Starts the thread. Where `paced`, it makes as many anchors as time goes by, else as many as are taken. */
    anchors(maker make, bool paced);
    /* Stops the thread, and waits for it. */
    ~anchors();
    anchors(const anchors &) = delete;
    anchors &operator=(const anchors &) = delete;

    /* The next one, or none: not yet, unless `wait` is set, or no more. */
    std::optional<arrival> take(bool wait);
    /* Whether no more will come. */
    bool ended();
    /* What the thread is doing, for the user. */
    std::string doing();

    /* For the thread itself: hands an anchor over once there is room. */
    bool give(cairn::anchor anchor);
    /* For the thread itself: waits until the next anchor should be begun, `interval_ns` after the one before. */
    bool wait_for_turn(std::uint64_t interval_ns);
    /* For the thread itself: is told to stop. */
    bool stopping();
    void now_doing(std::string what);
    /* For the thread itself: what ends a call that it is in; called on another thread. Empty when it is in none. */
    void when_stopped(std::function<void()> what);

private:
    static DWORD WINAPI thread(void *self);

    maker make_;
    bool paced_, stop_ = false, ended_ = false;
    SRWLOCK lock_ = SRWLOCK_INIT;
    CONDITION_VARIABLE changed_ = CONDITION_VARIABLE_INIT;
    std::deque<arrival> made_;
    std::exception_ptr failed_;
    std::function<void()> when_stopped_;
    std::string doing_;
    std::uint64_t turn_ = 0;
    HANDLE thread_ = nullptr;
};

/* From a world on `device`, which must outlive the thread. `player` says what is done in the window; null for the script. */
anchors::maker world_anchors(const options &options, const cairn::device &device, input *player);
/* From the renderer's program, pictures of that size. */
anchors::maker scene_anchors(const options &options, std::uint32_t width, std::uint32_t height);

/* Pictures that the renderer draws for a second. */
constexpr std::uint32_t SCENE_RATE = 15;

#endif
