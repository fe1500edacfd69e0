/* A window, and the player's input in it. */
#ifndef HOST_D3D12_WINDOW_HPP
#define HOST_D3D12_WINDOW_HPP

#include <cairn.hpp>

#include <cstdint>
#include <string>

#include <windows.h>

/* Holds a lock for the lifetime of the object. */
class lock_guard {
public:
    explicit lock_guard(SRWLOCK &lock) : lock_(lock) { AcquireSRWLockExclusive(&lock_); }
    ~lock_guard() { ReleaseSRWLockExclusive(&lock_); }
    lock_guard(const lock_guard &) = delete;
    lock_guard &operator=(const lock_guard &) = delete;

private:
    SRWLOCK &lock_;
};

/* Collects the player's input until the next latent step takes it. For use by any thread. */
class input {
public:
    void key(std::uint32_t code, bool down);
    void mouse(float dx, float dy);
    void wheel(float notches);
    /* Releases all keys, because the window has lost the keyboard's focus. */
    void release_keys();

    /* The input since the last call, for a world that knows the keys below `keys`. It includes keys that went down and up in that time. */
    cairn::controls take(std::uint32_t keys);

private:
    SRWLOCK lock_ = SRWLOCK_INIT;
    bool held_[256] = {}, touched_[256] = {};
    float dx_ = 0, dy_ = 0, wheel_ = 0;
};

/* A window, for use by the thread that creates it. Esc and the close button close it. */
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
    /* Waits for a message for at most `milliseconds`, and handles all messages. */
    void handle_messages(DWORD milliseconds);

private:
    static LRESULT CALLBACK procedure(HWND handle, UINT message, WPARAM w, LPARAM l);
    LRESULT handle_message(UINT message, WPARAM w, LPARAM l);
    void handle_mouse(HRAWINPUT from);
    void capture_pointer(bool captured);

    input &input_;
    HWND handle_ = nullptr;
    bool closed_ = false, pointer_captured_ = false;
};

#endif
