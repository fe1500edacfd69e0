/* A window, and what a player does in it. */
#ifndef HOST_D3D12_WINDOW_HPP
#define HOST_D3D12_WINDOW_HPP

#include <cairn.hpp>

#include <cstdint>
#include <string>

#include <windows.h>

/* A lock for as long as the object lives. */
class locked {
public:
    explicit locked(SRWLOCK &lock) : lock_(lock) { AcquireSRWLockExclusive(&lock_); }
    ~locked() { ReleaseSRWLockExclusive(&lock_); }
    locked(const locked &) = delete;
    locked &operator=(const locked &) = delete;

private:
    SRWLOCK &lock_;
};

/* Collects what a player does until the next latent step asks for it. Any thread. */
class input {
public:
    void key(std::uint32_t code, bool down);
    void mouse(float dx, float dy);
    void wheel(int notches);
    /* The window is no longer the one that hears the keyboard: all keys are up. */
    void let_go();

    /* All since the last call, for a world that knows the keys below `keys`. A key that was up again at once is held as well. */
    cairn::controls take(std::uint32_t keys);

private:
    SRWLOCK lock_ = SRWLOCK_INIT;
    bool held_[256] = {}, touched_[256] = {};
    float dx_ = 0, dy_ = 0, wheel_ = 0;
};

/* A window on the thread that makes it; Esc and the cross close it. */
class window {
public:
    window(const wchar_t *title, std::uint32_t width, std::uint32_t height, input &to);
    ~window();
    window(const window &) = delete;
    window &operator=(const window &) = delete;

    HWND handle() const { return handle_; }
    bool closed() const { return closed_; }
    bool minimised() const { return IsIconic(handle_) != 0; }
    void title(const std::string &text);
    /* Hears what happened, and waits for at most `milliseconds` for something to happen. */
    void listen(DWORD milliseconds);

private:
    static LRESULT CALLBACK procedure(HWND handle, UINT message, WPARAM w, LPARAM l);
    LRESULT hear(UINT message, WPARAM w, LPARAM l);
    void hear_mouse(HRAWINPUT from);
    void hold_pointer(bool held);

    input &input_;
    HWND handle_ = nullptr;
    bool closed_ = false, pointer_held_ = false;
};

#endif
