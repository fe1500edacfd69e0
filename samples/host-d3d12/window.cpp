#include "window.hpp"

#include <stdexcept>

void input::key(std::uint32_t code, bool down)
{
    if (code >= 256) return;
    const lock_guard lock(lock_);
    held_[code] = down;
    touched_[code] = touched_[code] || down;
}

void input::mouse(float dx, float dy)
{
    const lock_guard lock(lock_);
    dx_ += dx;
    dy_ += dy;
}

void input::wheel(float notches)
{
    const lock_guard lock(lock_);
    wheel_ += notches;
}

void input::release_keys()
{
    const lock_guard lock(lock_);
    for (bool &held : held_) held = false;
}

cairn::controls input::take(std::uint32_t keys)
{
    const auto clamp = [](float v) { return v < -32768 ? -32768.0f : v > 32768 ? 32768.0f : v; };
    const lock_guard lock(lock_);
    cairn::controls c;
    c.mouse_dx = clamp(dx_);
    c.mouse_dy = clamp(dy_);
    c.scroll = wheel_;
    for (std::uint32_t code = 0; code < 256; code++) {
        if (code < keys && (held_[code] || touched_[code])) c.keys[code / 64] |= std::uint64_t{1} << code % 64;
        touched_[code] = false;
    }
    dx_ = dy_ = wheel_ = 0;
    return c;
}

window::window(const wchar_t *title, std::uint32_t width, std::uint32_t height, input &to) : input_(to)
{
    WNDCLASSEXW kind = {};
    kind.cbSize = sizeof kind;
    kind.lpfnWndProc = procedure;
    kind.hInstance = GetModuleHandleW(nullptr);
    kind.hCursor = LoadCursorW(nullptr, reinterpret_cast<LPCWSTR>(IDC_ARROW));
    kind.lpszClassName = L"host-d3d12";
    RegisterClassExW(&kind);
    RECT frame = {0, 0, static_cast<LONG>(width), static_cast<LONG>(height)};
    AdjustWindowRect(&frame, WS_OVERLAPPEDWINDOW, FALSE);
    handle_ = CreateWindowExW(0, kind.lpszClassName, title, WS_OVERLAPPEDWINDOW, CW_USEDEFAULT, CW_USEDEFAULT,
                              frame.right - frame.left, frame.bottom - frame.top, nullptr, nullptr, kind.hInstance, this);
    if (handle_ == nullptr) {
        throw std::runtime_error("the window cannot be made: error " + std::to_string(GetLastError()) +
                                 ". Is there a desktop? Without one use --headless N");
    }
    /* Raw motion of the mouse: the pointer would stop at the edge of the screen. */
    const RAWINPUTDEVICE mouse = {0x01, 0x02, 0, handle_};
    RegisterRawInputDevices(&mouse, 1, sizeof mouse);
    ShowWindow(handle_, SW_SHOW);
}

window::~window()
{
    capture_pointer(false);
    SetWindowLongPtrW(handle_, GWLP_USERDATA, 0);
    DestroyWindow(handle_);
}

void window::title(const std::string &text)
{
    wchar_t wide[256];
    const int length = MultiByteToWideChar(CP_UTF8, 0, text.data(), static_cast<int>(text.size()), wide, 255);
    wide[length] = L'\0';
    SetWindowTextW(handle_, wide);
}

void window::handle_messages(DWORD milliseconds)
{
    if (milliseconds > 0) MsgWaitForMultipleObjectsEx(0, nullptr, milliseconds, QS_ALLINPUT, MWMO_INPUTAVAILABLE);
    MSG message;
    while (PeekMessageW(&message, nullptr, 0, 0, PM_REMOVE)) {
        TranslateMessage(&message);
        DispatchMessageW(&message);
    }
}

/* While the window has the keyboard's focus, the pointer is hidden and stays inside the window. */
void window::capture_pointer(bool captured)
{
    if (pointer_captured_ == captured) return;
    pointer_captured_ = captured;
    RECT inside = {};
    GetClientRect(handle_, &inside);
    MapWindowPoints(handle_, nullptr, reinterpret_cast<POINT *>(&inside), 2);
    ClipCursor(captured ? &inside : nullptr);
    ShowCursor(!captured);
}

void window::handle_mouse(HRAWINPUT from)
{
    RAWINPUT raw;
    UINT size = sizeof raw;
    if (GetRawInputData(from, RID_INPUT, &raw, &size, sizeof(RAWINPUTHEADER)) == static_cast<UINT>(-1)) return;
    const bool moves = raw.header.dwType == RIM_TYPEMOUSE && (raw.data.mouse.usFlags & MOUSE_MOVE_ABSOLUTE) == 0;
    if (moves) input_.mouse(static_cast<float>(raw.data.mouse.lLastX), static_cast<float>(raw.data.mouse.lLastY));
}

LRESULT window::handle_message(UINT message, WPARAM w, LPARAM l)
{
    switch (message) {
    case WM_CLOSE:
        closed_ = true;
        return 0;
    case WM_KEYDOWN:
    case WM_SYSKEYDOWN:
        if (w == VK_ESCAPE) closed_ = true;
        input_.key(static_cast<std::uint32_t>(w), true);
        if (message == WM_KEYDOWN) return 0;
        break;
    case WM_KEYUP:
    case WM_SYSKEYUP:
        input_.key(static_cast<std::uint32_t>(w), false);
        break;
    case WM_LBUTTONDOWN:
    case WM_LBUTTONUP:
        input_.key(VK_LBUTTON, message == WM_LBUTTONDOWN);
        return 0;
    case WM_RBUTTONDOWN:
    case WM_RBUTTONUP:
        input_.key(VK_RBUTTON, message == WM_RBUTTONDOWN);
        return 0;
    case WM_MOUSEWHEEL:
        /* Precise wheels and touchpads report fractions of a notch. */
        input_.wheel(static_cast<float>(GET_WHEEL_DELTA_WPARAM(w)) / WHEEL_DELTA);
        return 0;
    case WM_INPUT:
        handle_mouse(reinterpret_cast<HRAWINPUT>(l));
        break;
    case WM_SETFOCUS:
        capture_pointer(true);
        return 0;
    case WM_KILLFOCUS:
        input_.release_keys();
        capture_pointer(false);
        return 0;
    default:
        break;
    }
    return DefWindowProcW(handle_, message, w, l);
}

LRESULT CALLBACK window::procedure(HWND handle, UINT message, WPARAM w, LPARAM l)
{
    if (message == WM_NCCREATE) {
        auto *made = static_cast<window *>(reinterpret_cast<CREATESTRUCTW *>(l)->lpCreateParams);
        made->handle_ = handle;
        SetWindowLongPtrW(handle, GWLP_USERDATA, reinterpret_cast<LONG_PTR>(made));
    }
    auto *self = reinterpret_cast<window *>(GetWindowLongPtrW(handle, GWLP_USERDATA));
    return self != nullptr ? self->handle_message(message, w, l) : DefWindowProcW(handle, message, w, l);
}
