/**
 * Cairn in C++17: cairn.h with objects that own their handles, results that must be used, and structs that set their size. Header only; it
 * calls only the functions of cairn.h. Link against the library as with cairn.h.
 *
 *     void play(const cairn::picture &seed, const cairn::target &target)
 *     {
 *         cairn::device device = cairn::device::cpu().value();
 *         cairn::world world = cairn::world::load(device).value();
 *         cairn::rollout rollout = cairn::rollout::create(world).value();
 *         rollout.append(seed).value();
 *         cairn::controls walk;
 *         walk.keys[1] = std::uint64_t{1} << 23; // W
 *         for (int i = 0; i < 15; i++) {
 *             rollout.step(walk).value();
 *             rollout.anchor().value().read_picture(0, target).value();
 *         }
 *     }
 *
 * Every member function calls the function of cairn.h that its comment names; that function's comment has the details: ownership, duration
 * and results. These rules hold for all:
 *
 * Objects. device, world, anchor, rollout, guidance, presenter, script and recorder own one handle each, or none. They can be moved but
 * not copied. A moved-from object is empty, and a call on an empty object fails with CAIRN_ERROR_INVALID_HANDLE. Objects may be destroyed
 * in any order. An object that is destroyed within a callback of a call on it cannot destroy its handle, which leaks: see handle::destroy.
 *
 * Threads. A const member function may be called by any number of threads at the same time, any other by one thread at a time. Only one
 * thread may move, reset() or destroy an object.
 *
 * Results. Every call that can fail returns a cairn::result. With exceptions: .value() returns the value, or throws a cairn::error, which
 * has the code, the message and the message's parts. Without: test .ok(); then .why() has the same error, and *result the value. Nothing
 * else throws, except std::bad_alloc if memory for a text or an array is short. In a source compiled without exceptions, .value() of a
 * failure writes its message to standard error and ends the program. A program may contain both kinds of sources, but they cannot pass these
 * objects to each other: the names are in cairn::throwing or cairn::aborting, which are inline namespaces. Pass handles of cairn.h instead.
 *
 * "Not yet" and "the queue is full" are neither errors nor successes. They are part of the value: an empty std::optional, or false.
 *
 * Structs. cairn::controls is cairn_controls, all zero but for its struct_size; likewise all other structs. Result codes are the numbers of
 * cairn.h, and constants its macros. Texts are returned as std::string and not truncated, except by device::best; paths are UTF-8.
 */

#ifndef CAIRN_HPP
#define CAIRN_HPP

#include "cairn.h"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#if defined(__cpp_exceptions) || defined(_CPPUNWIND)
#define CAIRN_HPP_EXCEPTIONS 1
#else
#define CAIRN_HPP_EXCEPTIONS 0
#endif

namespace cairn {

/* Functions and types differ with and without exceptions. By names of their own, both may be in one program. */
#if CAIRN_HPP_EXCEPTIONS
inline namespace throwing {
#else
inline namespace aborting {
#endif

/* ---- 1. Version -------------------------------------------------------------------------------------------------- */

/** The version of the loaded library's binary interface: cairn_abi_version. */
inline std::uint32_t abi_version() noexcept { return cairn_abi_version(); }

/** The version of the loaded library, in the form of CAIRN_VERSION: cairn_version. */
inline std::uint32_t version() noexcept { return cairn_version(); }

/* ---- 2. Results -------------------------------------------------------------------------------------------------- */

/** The name of a result, such as "CAIRN_ERROR_IO": cairn_result_name. */
inline const char *result_name(cairn_result code) noexcept { return cairn_result_name(code); }

/**
 * Why a call failed. The only exception of this header, and the type of result::why. Copies share the texts.
 */
class error : public std::exception {
public:
    /** No failure: code CAIRN_OK, no text. */
    error() noexcept = default;

    /** A failure of the host's own. */
    error(cairn_result code, std::string message) : code_(code), texts_(std::make_shared<texts>())
    {
        texts_->message = std::move(message);
    }

    /** The calling thread's last error: cairn_last_error, cairn_last_error_part. */
    static error last(cairn_result code)
    {
        error made(code, read([](char *to, std::size_t room, std::size_t *length) {
            return cairn_last_error(to, room, length);
        }));
        made.texts_->function = part(CAIRN_LAST_ERROR_FUNCTION);
        made.texts_->field = part(CAIRN_LAST_ERROR_FIELD);
        made.texts_->cause = part(CAIRN_LAST_ERROR_CAUSE);
        made.texts_->remedy = part(CAIRN_LAST_ERROR_REMEDY);
        return made;
    }

    /** CAIRN_ERROR_INVALID_ARGUMENT and so on; CAIRN_OK for no failure. */
    cairn_result code() const noexcept { return code_; }
    /** The whole message: what went wrong, with which argument or file, and what can be done; UTF-8. */
    const char *what() const noexcept override { return texts_ ? texts_->message.c_str() : ""; }
    /** The function that failed. A part that the message does not have is empty, here and below. */
    std::string_view function() const noexcept { return texts_ ? std::string_view(texts_->function) : std::string_view(); }
    /** The argument, file or field that is wrong. */
    std::string_view field() const noexcept { return texts_ ? std::string_view(texts_->field) : std::string_view(); }
    /** What is wrong, one sentence without a final stop. */
    std::string_view cause() const noexcept { return texts_ ? std::string_view(texts_->cause) : std::string_view(); }
    /** What can be done, an imperative sentence without a final stop. */
    std::string_view remedy() const noexcept { return texts_ ? std::string_view(texts_->remedy) : std::string_view(); }

    /**
     * Reads a whole text with `copy`, which copies it into a buffer as cairn_last_error does; empty if it fails.
     */
    template <class Copy> static std::string read(Copy copy, cairn_result *answer = nullptr)
    {
        std::string text;
        std::size_t length = 0;
        cairn_result r = copy(static_cast<char *>(nullptr), std::size_t{0}, &length);
        do {
            if (r < 0) break;
            text.resize(length + 1);
            r = copy(&text[0], text.size(), &length);
        } while (r == CAIRN_TRUNCATED); /* The text has grown between the two calls. */
        text.resize(r < 0 ? 0 : length);
        if (answer) *answer = r;
        return text;
    }

private:
    struct texts {
        std::string message, function, field, cause, remedy;
    };

    static std::string part(std::uint32_t which)
    {
        return read([which](char *to, std::size_t room, std::size_t *length) {
            return cairn_last_error_part(which, to, room, length);
        });
    }

    cairn_result code_ = CAIRN_OK;
    std::shared_ptr<texts> texts_;
};

namespace detail {

/** Throws the error, or without exceptions prints it and ends the program. */
[[noreturn]] inline void raise(const error &why)
{
#if CAIRN_HPP_EXCEPTIONS
    throw why;
#else
    std::fprintf(stderr, "%s\n", why.what());
    std::abort();
#endif
}

} /* namespace detail */

/** The result of a call: a T, or the error. */
template <class T> class [[nodiscard]] result {
public:
    result(T value) : value_(std::move(value)) {}
    result(error why) : why_(std::move(why)) {}

    /** Whether there is a value. */
    bool ok() const noexcept { return value_.has_value(); }
    /** CAIRN_OK, or the error's code. */
    cairn_result code() const noexcept { return why_.code(); }
    /** The error; empty if there is a value. */
    const error &why() const noexcept { return why_; }

    /** The value; if there is none, throws why(). */
    T &value() & { return require_value(), *value_; }
    const T &value() const & { return require_value(), *value_; }
    T value() && { return require_value(), std::move(*value_); }

    /** The value, without a check: only if ok(). */
    T &operator*() noexcept { return *value_; }
    const T &operator*() const noexcept { return *value_; }
    T *operator->() noexcept { return &*value_; }
    const T *operator->() const noexcept { return &*value_; }

private:
    void require_value() const
    {
        if (!value_) detail::raise(why_);
    }

    std::optional<T> value_;
    error why_;
};

/** The result of a call without a value: success, or the error. */
template <> class [[nodiscard]] result<void> {
public:
    result() noexcept = default;
    result(error why) : why_(std::move(why)) {}

    /** Whether the call succeeded. */
    bool ok() const noexcept { return why_.code() == CAIRN_OK; }
    /** CAIRN_OK, or the error's code. */
    cairn_result code() const noexcept { return why_.code(); }
    /** The error; empty on success. */
    const error &why() const noexcept { return why_; }
    /** Throws why() if the call failed. */
    void value() const
    {
        if (!ok()) detail::raise(why_);
    }

private:
    error why_;
};

/** Checks that the library fits this header. Call it before anything else if they may come from different builds. */
inline result<void> check_version()
{
    if (abi_version() == CAIRN_ABI_VERSION && version() >= CAIRN_VERSION) return {};
    return error(CAIRN_ERROR_UNSUPPORTED,
                 "the library has binary interface " + std::to_string(abi_version()) + " and version " + std::to_string(version()) +
                     ", the program was compiled for " + std::to_string(CAIRN_ABI_VERSION) + " and " + std::to_string(CAIRN_VERSION) +
                     ". Use the library of the release that the program was compiled for: on Windows beside the program, on Linux where "
                     "the program's run path (-Wl,-rpath,'$ORIGIN') leads");
}

/* ---- 3. Structs and views ---------------------------------------------------------------------------------------- */

/** A struct of cairn.h with struct_size set and all other fields zero. */
template <class C> struct sized : C {
    sized() noexcept : C() { this->struct_size = sizeof(C); }
    /** Copies `other`, but sets struct_size. */
    sized(const C &other) noexcept : C(other) { this->struct_size = sizeof(C); }
};

using thread_options = sized<cairn_thread_options>;
using scheduler = sized<cairn_scheduler>;
using device_options = sized<cairn_device_options>;
using device_info = sized<cairn_device_info>;
using adapter = sized<cairn_adapter>;
using requirement = sized<cairn_requirement>;
using load_progress = cairn_load_progress;
using world_options = sized<cairn_world_options>;
using world_info = sized<cairn_world_info>;
using world_memory = sized<cairn_world_memory>;
using picture = sized<cairn_picture>;
using target = sized<cairn_target>;
using controls = sized<cairn_controls>;
using anchor_info = sized<cairn_anchor_info>;
using rollout_options = sized<cairn_rollout_options>;
using rollout_info = sized<cairn_rollout_info>;
using rollout_statistics = sized<cairn_rollout_statistics>;
using budget = sized<cairn_budget>;
using d3d12_options = sized<cairn_d3d12_options>;
using d3d12_preparation = sized<cairn_d3d12_preparation>;
using d3d12_recording = sized<cairn_d3d12_recording>;
using swapchain_options = sized<cairn_swapchain_options>;
using swapchain_frame = sized<cairn_swapchain_frame>;
using swapchain_pacing = sized<cairn_swapchain_pacing>;
using swapchain_statistics = sized<cairn_swapchain_statistics>;
using step_info = sized<cairn_step_info>;
using guidance_data = sized<cairn_guidance_data>;
using guidance_info = sized<cairn_guidance_info>;
using presenter_options = sized<cairn_presenter_options>;
using presenter_statistics = sized<cairn_presenter_statistics>;
using frame = sized<cairn_frame>;

/** Elements in the caller's memory: an array, a std::vector, a std::array, or a pointer and a count. */
template <class T> class span {
public:
    constexpr span() noexcept = default;
    constexpr span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
    template <std::size_t N> constexpr span(T (&array)[N]) noexcept : data_(array), size_(N) {}
    template <class Container, class = std::enable_if_t<std::is_convertible_v<decltype(std::declval<Container &>().data()), T *>>>
    constexpr span(Container &&container) noexcept : data_(container.data()), size_(container.size())
    {
    }

    constexpr T *data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }

private:
    T *data_ = nullptr;
    std::size_t size_ = 0;
};

/** A picture in the host's memory that the library reads; `pixels` must outlive it. */
inline picture picture_of(span<const unsigned char> pixels, std::uint32_t width, std::uint32_t height,
                          std::uint32_t format = CAIRN_FORMAT_RGBA8, std::uint64_t row_pitch = 0) noexcept
{
    picture made;
    made.format = format;
    made.width = width;
    made.height = height;
    made.pixels = pixels.data();
    made.size = pixels.size();
    made.row_pitch = row_pitch;
    return made;
}

/** Memory of the host's into which the library writes a picture; `pixels` must outlive it. */
inline target target_of(span<unsigned char> pixels, std::uint32_t width, std::uint32_t height,
                        std::uint32_t format = CAIRN_FORMAT_RGBA8, std::uint64_t row_pitch = 0) noexcept
{
    target made;
    made.format = format;
    made.width = width;
    made.height = height;
    made.pixels = pixels.data();
    made.size = pixels.size();
    made.row_pitch = row_pitch;
    return made;
}

/* ---- 4. Handles -------------------------------------------------------------------------------------------------- */

namespace detail {

inline cairn_result destroy(cairn_device *raw) noexcept { return cairn_device_destroy(raw); }
inline cairn_result destroy(cairn_world *raw) noexcept { return cairn_world_destroy(raw); }
inline cairn_result destroy(cairn_anchor *raw) noexcept { return cairn_anchor_destroy(raw); }
inline cairn_result destroy(cairn_rollout *raw) noexcept { return cairn_rollout_destroy(raw); }
inline cairn_result destroy(cairn_guidance *raw) noexcept { return cairn_guidance_destroy(raw); }
inline cairn_result destroy(cairn_presenter *raw) noexcept { return cairn_presenter_destroy(raw); }
inline cairn_result destroy(cairn_swapchain *raw) noexcept { return cairn_swapchain_destroy(raw); }
inline cairn_result destroy(cairn_script *raw) noexcept { return cairn_script_destroy(raw); }
inline cairn_result destroy(cairn_recorder *raw) noexcept { return cairn_recorder_destroy(raw); }

/** Converts the result of a call without a value. */
inline result<void> to_result(cairn_result r)
{
    if (r < 0) return error::last(r);
    return {};
}

/** Converts the result of a call whose results above 0 mean that it did nothing: false for these. */
inline result<bool> to_accepted(cairn_result r)
{
    if (r < 0) return error::last(r);
    return r == CAIRN_OK;
}

/** Makes an object of the handle that `call` creates. */
template <class Object, class Call> result<Object> create(Call call)
{
    typename Object::raw_type *raw = nullptr;
    const cairn_result r = call(&raw);
    if (r < 0) return error::last(r);
    return Object(raw);
}

/** Returns the struct or number that `call` fills. */
template <class T, class Call> result<T> fill(Call call)
{
    T value{};
    const cairn_result r = call(&value);
    if (r < 0) return error::last(r);
    return value;
}

/** As fill; none if the call's result is above 0. */
template <class T, class Call> result<std::optional<T>> fill_or_none(Call call)
{
    T value{};
    const cairn_result r = call(&value);
    if (r < 0) return error::last(r);
    return r == CAIRN_OK ? std::optional<T>(std::move(value)) : std::nullopt;
}

/** Returns the text that `call` copies. */
template <class Call> result<std::string> text(Call call)
{
    cairn_result r = CAIRN_OK;
    std::string text = error::read(call, &r);
    if (r < 0) return error::last(r);
    return text;
}

/** Returns the array that call(elements, stride, capacity, &count) fills. */
template <class T, class Call> result<std::vector<T>> fill_array(Call call)
{
    std::vector<T> elements;
    std::uint32_t count = 0;
    for (;;) {
        const auto capacity = static_cast<std::uint32_t>(elements.size());
        const cairn_result r = call(elements.empty() ? nullptr : elements.data(), sizeof(T), capacity, &count);
        if (r < 0) return error::last(r);
        const bool all = count <= elements.size();
        elements.resize(count);
        if (all) return elements;
    }
}

} /* namespace detail */

/** Owns one handle, or none, and destroys it. */
template <class T> class handle {
public:
    using raw_type = T;

    /** No handle. */
    constexpr handle() noexcept = default;
    /** Takes ownership of a handle that a function of cairn.h created. */
    explicit handle(T *raw) noexcept : raw_(raw) {}
    handle(handle &&other) noexcept : raw_(other.release()) {}
    handle &operator=(handle &&other) noexcept
    {
        reset(other.release());
        return *this;
    }
    ~handle() { reset(); }

    /** Whether it owns a handle. */
    explicit operator bool() const noexcept { return raw_ != nullptr; }
    /** The handle, for functions of cairn.h; null for none. The object keeps its ownership. */
    T *get() const noexcept { return raw_; }
    /** Gives up ownership of the handle: the caller destroys it. */
    [[nodiscard]] T *release() noexcept { return std::exchange(raw_, nullptr); }
    /** Destroys the handle, and takes ownership of another one. */
    void reset(T *raw = nullptr) noexcept { detail::destroy(std::exchange(raw_, raw)); }
    /**
     * Destroys the handle, and reports a failure: within a callback of a call on the handle this fails with CAIRN_ERROR_BUSY and keeps it.
     */
    result<void> destroy()
    {
        result<void> destroyed = detail::to_result(detail::destroy(raw_));
        if (destroyed.ok()) raw_ = nullptr;
        return destroyed;
    }

private:
    T *raw_ = nullptr;
};

/* ---- 5. Logging, devices, worlds --------------------------------------------------------------------------------- */

/** Sets the callback that gets messages up to `level`; null ends logging: cairn_set_log_callback. */
inline result<void> set_log_callback(std::uint32_t level, cairn_log_callback callback, void *user = nullptr)
{
    return detail::to_result(cairn_set_log_callback(level, callback, user));
}

/** Sets the number and priority of the library's own threads, while there is no object: cairn_set_threads. */
inline result<void> set_threads(const thread_options &options = {})
{
    return detail::to_result(cairn_set_threads(&options));
}

/** Makes the library share its work on the host's job system, while there is no object: cairn_set_scheduler. */
inline result<void> set_scheduler(const scheduler &jobs)
{
    return detail::to_result(cairn_set_scheduler(&jobs));
}

/** Makes the library share its work on its own threads again, while there is no object: cairn_set_scheduler. */
inline result<void> reset_scheduler()
{
    return detail::to_result(cairn_set_scheduler(nullptr));
}

/** Lists what devices can be created on: cairn_adapters. */
inline result<std::vector<adapter>> adapters()
{
    return detail::fill_array<adapter>([](adapter *to, std::size_t stride, std::uint32_t capacity, std::uint32_t *count) {
        return cairn_adapters(to, stride, capacity, count);
    });
}

/** Lists what a device of that kind needs and what was found: cairn_device_requirements. */
inline result<std::vector<requirement>> requirements(std::uint32_t kind, const device_options &options = {})
{
    return detail::fill_array<requirement>([&](requirement *to, std::size_t stride, std::uint32_t capacity, std::uint32_t *count) {
        return cairn_device_requirements(kind, &options, to, stride, capacity, count);
    });
}

#if defined(_WIN32)
/** The objects that a device runs on. Each is a new reference, which the caller releases, for example with ComPtr::Attach. */
struct d3d12_objects {
    ID3D12Device *device;
    ID3D12CommandQueue *queue;
};

/** A fence, and the value to wait for. The fence is a new reference, which the caller releases. */
struct d3d12_guard {
    ID3D12Fence *fence;
    std::uint64_t value;
};

/** An anchor's picture: RGBA8, in state COMMON, to which it must be returned. Each object is a new reference, which the caller releases. */
struct d3d12_picture {
    ID3D12Resource *texture;
    /** Must have the value before the texture is read. */
    ID3D12Fence *fence;
    std::uint64_t value;
};
#endif

/** A device that runs worlds. */
class device : public handle<cairn_device> {
public:
    using handle::handle;

    /** Creates a device on the host's processor: cairn_device_create_cpu. */
    static result<device> cpu(const device_options &options = {})
    {
        return detail::create<device>([&](cairn_device **to) { return cairn_device_create_cpu(&options, to); });
    }

    /**
     * Creates a device on a graphics adapter, by ONNX Runtime's WebGPU provider: cairn_device_create_gpu. `name` is a part of its name, its
     * vendor or its number; null for the fastest. Experimental.
     */
    static result<device> gpu(const char *name = nullptr, const device_options &options = {})
    {
        return detail::create<device>([&](cairn_device **to) { return cairn_device_create_gpu(name, &options, to); });
    }

    /**
     * Creates the best device of this machine: cairn_device_create_auto. `refusals`, if it is not null, gets a line for each better kind that
     * was not taken, with the reason; at most 65535 bytes, because a second call for a longer text would create a second device. Experimental.
     */
    static result<device> best(const device_options &options = {}, std::string *refusals = nullptr)
    {
        std::string text(refusals != nullptr ? 65536 : 0, '\0');
        auto made = detail::create<device>([&](cairn_device **to) {
            return cairn_device_create_auto(&options, text.empty() ? nullptr : &text[0], text.size(), nullptr, to);
        });
        if (refusals != nullptr && made.ok()) *refusals = text.c_str();
        return made;
    }

#if defined(_WIN32)
    /**
     * Creates a device on an engine's Direct3D 12 device and queue. `anchors` is a compute queue for the world's passes, or null for one of
     * the library's own: cairn_device_create_d3d12. Experimental, like everything with d3d12 or swapchain in its name.
     */
    static result<device> d3d12(ID3D12Device *engine, ID3D12CommandQueue *queue, ID3D12CommandQueue *anchors = nullptr,
        const device_options &options = {})
    {
        return detail::create<device>([&](cairn_device **to) { return cairn_device_create_d3d12(engine, queue, anchors, &options, to); });
    }

    /** Creates a Direct3D 12 device of the library's own on an adapter of adapters(): cairn_device_create_adapter. */
    static result<device> of_adapter(std::uint64_t luid, const device_options &options = {})
    {
        return detail::create<device>([&](cairn_device **to) { return cairn_device_create_adapter(luid, &options, to); });
    }

    /** Sets options for worlds and rollouts created from now on: cairn_device_set_d3d12. */
    result<void> set(const d3d12_options &options) const
    {
        return detail::to_result(cairn_device_set_d3d12(get(), &options));
    }

    /** The Direct3D 12 objects that it runs on: cairn_device_get_d3d12. */
    result<d3d12_objects> d3d12() const
    {
        return detail::fill<d3d12_objects>([&](d3d12_objects *to) { return cairn_device_get_d3d12(get(), &to->device, &to->queue); });
    }
#endif

    /** Its properties: cairn_device_get_info. */
    result<device_info> info() const
    {
        return detail::fill<device_info>([&](device_info *to) { return cairn_device_get_info(get(), to); });
    }
};

/** A loaded world, which may have any number of rollouts. */
class world : public handle<cairn_world> {
public:
    using handle::handle;

    /** Loads a world, or if the options have no path the world inside the library: cairn_world_load. */
    static result<world> load(const cairn::device &device, const world_options &options = {})
    {
        return detail::create<world>([&](cairn_world **to) { return cairn_world_load(device.get(), &options, to); });
    }

    /**
     * The same, with a callback: `progress` is called with a const load_progress & during the load, and cancels it by returning false. An
     * exception in it also cancels the load, and is rethrown here.
     */
    template <class Progress> static result<world> load(const cairn::device &device, const world_options &options, Progress &&progress)
    {
        progress_adapter<std::remove_reference_t<Progress>> bridge{progress};
        world_options with_progress = options;
        with_progress.progress = [](const cairn_load_progress *now, void *user) -> std::uint32_t {
            return static_cast<progress_adapter<std::remove_reference_t<Progress>> *>(user)->cancels(*now);
        };
        with_progress.user = &bridge;
        result<world> loaded = load(device, with_progress);
#if CAIRN_HPP_EXCEPTIONS
        if (bridge.thrown) std::rethrow_exception(bridge.thrown);
#endif
        return loaded;
    }

    /** Its properties: cairn_world_get_info. */
    result<world_info> info() const
    {
        return detail::fill<world_info>([&](world_info *to) { return cairn_world_get_info(get(), to); });
    }

    /** The memory that it needs with one rollout: cairn_world_get_memory. */
    result<world_memory> memory() const
    {
        return detail::fill<world_memory>([&](world_memory *to) { return cairn_world_get_memory(get(), to); });
    }

    /** The text of its licence: cairn_world_get_licence. */
    result<std::string> licence() const
    {
        return detail::text([&](char *to, std::size_t room, std::size_t *length) {
            return cairn_world_get_licence(get(), to, room, length);
        });
    }

private:
    /** Calls the host's function from C's callback. It stores exceptions, which must not pass through the library. */
    template <class Progress> struct progress_adapter {
        Progress &progress;
#if CAIRN_HPP_EXCEPTIONS
        std::exception_ptr thrown = nullptr;
        std::uint32_t cancels(const load_progress &now) noexcept
        {
            try {
                return progress(now) ? 0 : 1;
            } catch (...) {
                thrown = std::current_exception();
                return 1;
            }
        }
#else
        std::uint32_t cancels(const load_progress &now) noexcept { return progress(now) ? 0 : 1; }
#endif
    };
};

/* ---- 6. Anchors and rollouts ------------------------------------------------------------------------------------- */

/** A picture between which and the next frames are generated, with its latent. An immutable copy, independent of its rollout. */
class anchor : public handle<cairn_anchor> {
public:
    using handle::handle;

    /** Makes an anchor of the host's own picture; `number` increases by one, `flags` are CAIRN_ANCHOR_CUT or 0: cairn_anchor_create. */
    static result<anchor> create(const picture &given, std::uint64_t number, std::uint32_t flags = 0)
    {
        return detail::create<anchor>([&](cairn_anchor **to) { return cairn_anchor_create(&given, number, flags, to); });
    }

    /** Its properties: cairn_anchor_get_info. */
    result<anchor_info> info() const
    {
        return detail::fill<anchor_info>([&](anchor_info *to) { return cairn_anchor_get_info(get(), to); });
    }

    /** Copies picture `index`, in order of time, to memory of the same size: cairn_anchor_read_picture. */
    result<void> read_picture(std::uint32_t index, const target &to) const
    {
        return detail::to_result(cairn_anchor_read_picture(get(), index, &to));
    }

    /** Copies the latent, [channels, height, width]: cairn_anchor_read_latent. */
    result<void> read_latent(span<float> to) const { return detail::to_result(cairn_anchor_read_latent(get(), to.data(), to.size())); }

#if defined(_WIN32)
    /** Picture `index` as a texture: cairn_anchor_get_d3d12. */
    result<d3d12_picture> d3d12(std::uint32_t index) const
    {
        return detail::fill<d3d12_picture>(
            [&](d3d12_picture *to) { return cairn_anchor_get_d3d12(get(), index, &to->texture, &to->fence, &to->value); });
    }
#endif
};

/** The result of a queued step. */
struct completed {
    step_info step;
    cairn::anchor anchor;
};

/** One running instance of a world. */
class rollout : public handle<cairn_rollout> {
public:
    using handle::handle;

    /** Creates a rollout without latents; append a seed picture first: cairn_rollout_create. */
    static result<rollout> create(const cairn::world &world, const rollout_options &options = {})
    {
        return detail::create<rollout>([&](cairn_rollout **to) { return cairn_rollout_create(world.get(), &options, to); });
    }

    /** Its properties and progress: cairn_rollout_get_info. */
    result<rollout_info> info() const
    {
        return detail::fill<rollout_info>([&](rollout_info *to) { return cairn_rollout_get_info(get(), to); });
    }

    /** Its statistics: cairn_rollout_get_statistics. */
    result<rollout_statistics> statistics() const
    {
        return detail::fill<rollout_statistics>([&](rollout_statistics *to) { return cairn_rollout_get_statistics(get(), to); });
    }

    /** Appends a picture, on the calling thread: cairn_rollout_append. */
    result<step_info> append(const picture &given)
    {
        return detail::fill<step_info>([&](step_info *to) { return cairn_rollout_append(get(), &given, to); });
    }

    /** Appends pictures as one latent, on the calling thread: cairn_rollout_append_pictures. */
    result<step_info> append(const picture *given, std::uint32_t count)
    {
        return detail::fill<step_info>([&](step_info *to) { return cairn_rollout_append_pictures(get(), given, count, to); });
    }

    /** Sets whether the encoder keeps its state from one appended picture to the next: cairn_rollout_keep_encoder_stream. */
    result<void> keep_encoder_stream(bool keep) { return detail::to_result(cairn_rollout_keep_encoder_stream(get(), keep)); }

    /** Frees its device memory until the next step: cairn_rollout_rest. */
    result<void> rest() { return detail::to_result(cairn_rollout_rest(get())); }

#if defined(_WIN32)
    /** Appends a texture that is in the D3D12_RESOURCE_STATES `state`, and stays in it: cairn_rollout_append_d3d12. */
    result<step_info> append_d3d12(ID3D12Resource *given, std::uint32_t state)
    {
        return detail::fill<step_info>([&](step_info *to) { return cairn_rollout_append_d3d12(get(), given, state, to); });
    }
#endif

    /** Makes the next latent with these controls, on the calling thread: cairn_rollout_step. */
    result<step_info> step(const controls &given)
    {
        return detail::fill<step_info>([&](step_info *to) { return cairn_rollout_step(get(), &given, to); });
    }

    /** Limits the wall time per latent, in nanoseconds: cairn_rollout_set_budget. */
    result<void> set_budget(std::uint64_t latent_ns, const char *schedules)
    {
        return detail::to_result(cairn_rollout_set_budget(get(), latent_ns, schedules));
    }

    /** Keeps it, and the frames of a presenter, within a budget: cairn_rollout_govern. */
    result<void> govern(const budget &given) { return detail::to_result(cairn_rollout_govern(get(), &given)); }

    /** Removes that budget: cairn_rollout_govern. */
    result<void> ungovern() { return detail::to_result(cairn_rollout_govern(get(), nullptr)); }

    /** Resets the rollout to its start with the same seed: cairn_rollout_reset. Not to be confused with reset(), which destroys the handle. */
    result<void> restart() { return detail::to_result(cairn_rollout_reset(get())); }

    /** A copy of the last anchor: cairn_rollout_get_anchor. */
    result<cairn::anchor> anchor() const
    {
        return detail::create<cairn::anchor>([&](cairn_anchor **to) { return cairn_rollout_get_anchor(get(), to); });
    }

    /** Queues a step for the rollout's own thread. Returns a ticket, or none if the queue is full: cairn_rollout_submit. */
    result<std::optional<std::uint64_t>> submit(const controls &given) const
    {
        return detail::fill_or_none<std::uint64_t>([&](std::uint64_t *to) { return cairn_rollout_submit(get(), &given, to); });
    }

    /** Queues the append of a picture: cairn_rollout_submit_picture. */
    result<std::optional<std::uint64_t>> submit(const picture &given) const
    {
        return detail::fill_or_none<std::uint64_t>(
            [&](std::uint64_t *to) { return cairn_rollout_submit_picture(get(), &given, to); });
    }

    /** Queues the append of pictures as one latent: cairn_rollout_submit_pictures. */
    result<std::optional<std::uint64_t>> submit(const picture *given, std::uint32_t count) const
    {
        return detail::fill_or_none<std::uint64_t>(
            [&](std::uint64_t *to) { return cairn_rollout_submit_pictures(get(), given, count, to); });
    }

    /** The result of a queued step, or none while it waits or runs: cairn_rollout_poll. */
    result<std::optional<completed>> poll(std::uint64_t ticket) const
    {
        return fetch([&](step_info *step, cairn_anchor **to) { return cairn_rollout_poll(get(), ticket, step, to); });
    }

    /** Waits for a queued step's result; none after the timeout: cairn_rollout_wait. */
    result<std::optional<completed>> wait(std::uint64_t ticket, std::uint64_t timeout_ns = CAIRN_FOREVER) const
    {
        return fetch([&](step_info *step, cairn_anchor **to) { return cairn_rollout_wait(get(), ticket, timeout_ns, step, to); });
    }

    /** Cancels all steps, queued and in progress: cairn_rollout_cancel. */
    result<void> cancel() const { return detail::to_result(cairn_rollout_cancel(get())); }
    /** Pauses the queue: cairn_rollout_pause. */
    result<void> pause() const { return detail::to_result(cairn_rollout_pause(get())); }
    /** Resumes a paused queue: cairn_rollout_resume. */
    result<void> resume() const { return detail::to_result(cairn_rollout_resume(get())); }
    /** Runs one step of a paused queue; false if none is queued: cairn_rollout_single_step. */
    result<bool> single_step() const { return detail::to_accepted(cairn_rollout_single_step(get())); }

    /** The whole state: cairn_rollout_save. */
    result<std::vector<unsigned char>> save() const
    {
        std::vector<unsigned char> bytes;
        std::size_t size = 0;
        cairn_result r = cairn_rollout_save(get(), nullptr, 0, &size);
        if (r < 0) return error::last(r);
        /* A queued step that ends between two calls may change the size, if the rollout has a budget. */
        for (int tries = 0;; tries++) {
            bytes.resize(size);
            r = cairn_rollout_save(get(), bytes.data(), bytes.size(), &size);
            if (r >= 0) {
                bytes.resize(size);
                return bytes;
            }
            error why = error::last(r);
            if (r != CAIRN_ERROR_INVALID_ARGUMENT || tries == 8) return why;
            r = cairn_rollout_save(get(), nullptr, 0, &size);
            if (r < 0) return error::last(r);
            if (size <= bytes.size()) return why;
        }
    }

    /** Writes the whole state to a file, completely or not at all: cairn_rollout_save_file. */
    result<void> save_file(const std::string &path) const { return detail::to_result(cairn_rollout_save_file(get(), path.c_str())); }
    /** Restores a saved state: cairn_rollout_restore. */
    result<void> restore(span<const unsigned char> bytes)
    {
        return detail::to_result(cairn_rollout_restore(get(), bytes.data(), bytes.size()));
    }
    /** Restores a saved state from a file: cairn_rollout_restore_file. */
    result<void> restore_file(const std::string &path) { return detail::to_result(cairn_rollout_restore_file(get(), path.c_str())); }

private:
    template <class Call> static result<std::optional<completed>> fetch(Call call)
    {
        completed fetched;
        cairn_anchor *raw = nullptr;
        const cairn_result r = call(&fetched.step, &raw);
        if (r < 0) return error::last(r);
        fetched.anchor.reset(raw);
        return r == CAIRN_OK ? std::optional<completed>(std::move(fetched)) : std::nullopt;
    }
};

/* ---- 7. Guidance and presenters ---------------------------------------------------------------------------------- */

/** Motion and depth of a pair of anchors. */
class guidance : public handle<cairn_guidance> {
public:
    using handle::handle;

    /** Estimates both; `source` is CAIRN_MOTION_AUTO and so on: cairn_guidance_create. */
    static result<guidance> create(const anchor &previous, const anchor &current, std::uint32_t source = CAIRN_MOTION_AUTO)
    {
        return detail::create<guidance>(
            [&](cairn_guidance **to) { return cairn_guidance_create(previous.get(), current.get(), source, to); });
    }

    /** Makes guidance of the host's own motion and depth: cairn_guidance_create_from_host. */
    static result<guidance> create(const guidance_data &data)
    {
        return detail::create<guidance>([&](cairn_guidance **to) { return cairn_guidance_create_from_host(&data, to); });
    }

    /** Its properties: cairn_guidance_get_info. */
    result<guidance_info> info() const
    {
        return detail::fill<guidance_info>([&](guidance_info *to) { return cairn_guidance_get_info(get(), to); });
    }

    /** Copies the motion, half floats x, y for each pixel: cairn_guidance_read_motion. */
    result<void> read_motion(span<std::uint16_t> to) const
    {
        return detail::to_result(cairn_guidance_read_motion(get(), to.data(), to.size()));
    }

    /** Copies the depth, 0 near: cairn_guidance_read_depth. */
    result<void> read_depth(span<float> to) const { return detail::to_result(cairn_guidance_read_depth(get(), to.data(), to.size())); }
};

/** Shows a stream of anchors at a steady rate. */
class presenter : public handle<cairn_presenter> {
public:
    using handle::handle;

    /** Creates a presenter: cairn_presenter_create. */
    static result<presenter> create(const presenter_options &options = {})
    {
        return detail::create<presenter>([&](cairn_presenter **to) { return cairn_presenter_create(&options, to); });
    }

    /** Passes it the next anchor; false if the queue is full: cairn_presenter_push. */
    result<bool> push(const cairn::anchor &anchor, std::uint64_t now_ns) const
    {
        return detail::to_accepted(cairn_presenter_push(get(), anchor.get(), nullptr, now_ns));
    }

    /** The same, with guidance for the previous anchor and this one. */
    result<bool> push(const cairn::anchor &anchor, const cairn::guidance &guidance, std::uint64_t now_ns) const
    {
        return detail::to_accepted(cairn_presenter_push(get(), anchor.get(), guidance.get(), now_ns));
    }

    /** The frame that is due, or none before the first anchor: cairn_presenter_query. */
    result<std::optional<frame>> query(std::uint64_t now_ns) const
    {
        return detail::fill_or_none<frame>([&](frame *to) { return cairn_presenter_query(get(), now_ns, to); });
    }

    /** Makes the frame that is due and writes it to memory; none before the first anchor: cairn_presenter_draw. */
    result<std::optional<frame>> draw(std::uint64_t now_ns, const target &memory)
    {
        return detail::fill_or_none<frame>([&](frame *to) { return cairn_presenter_draw(get(), now_ns, &memory, to); });
    }

#if defined(_WIN32)
    /**
     * Creates everything that frames need; call it on a loading thread. False if no anchor was pushed and `wanted` does not have the anchors'
     * size: cairn_presenter_prepare_d3d12.
     */
    result<bool> prepare_d3d12(const cairn::device &device, const d3d12_preparation &wanted = {}) const
    {
        return detail::to_accepted(cairn_presenter_prepare_d3d12(get(), device.get(), &wanted));
    }

    /**
     * Records the frame that is due into the engine's command list. None before the first anchor, and while all prepared lists may not have
     * run: cairn_presenter_record_d3d12.
     */
    result<std::optional<frame>> record_d3d12(const cairn::device &device, std::uint64_t now_ns, const d3d12_recording &recording)
    {
        return detail::fill_or_none<frame>([&](frame *to) {
            return cairn_presenter_record_d3d12(get(), device.get(), now_ns, &recording, to);
        });
    }

    /**
     * Writes the frame that is due to a texture, in a list of the presenter's own that it executes on the device's queue. `guard` gets the fence
     * and the value to wait for: cairn_presenter_submit_d3d12.
     */
    result<std::optional<frame>> submit_d3d12(const cairn::device &device, std::uint64_t now_ns, ID3D12Resource *texture,
                                              std::uint32_t before, std::uint32_t after, d3d12_guard &guard)
    {
        return detail::fill_or_none<frame>([&](frame *to) {
            return cairn_presenter_submit_d3d12(get(), device.get(), now_ns, texture, before, after, to, &guard.fence, &guard.value);
        });
    }

    /** Waits for its frames and releases their targets, before a swap chain is resized: cairn_presenter_release_d3d12. */
    result<void> release_d3d12() { return detail::to_result(cairn_presenter_release_d3d12(get())); }
#endif

    /** Changes the size of the frames; 0 for both for the anchors' size: cairn_presenter_resize. */
    result<void> resize(std::uint32_t width, std::uint32_t height) const
    {
        return detail::to_result(cairn_presenter_resize(get(), width, height));
    }

    /** Sets the mask of a static overlay over the anchors; null for none: cairn_presenter_set_overlay. */
    result<void> set_overlay(const std::uint8_t *mask, std::size_t size, std::uint32_t width, std::uint32_t height) const
    {
        return detail::to_result(cairn_presenter_set_overlay(get(), mask, size, width, height));
    }

    /** Limits the device time per frame, in nanoseconds: cairn_presenter_set_budget. */
    result<void> set_budget(std::uint64_t frame_ns) const
    {
        return detail::to_result(cairn_presenter_set_budget(get(), frame_ns));
    }

    /** Forgets all anchors: cairn_presenter_reset. Not to be confused with reset(), which destroys the handle. */
    result<void> restart() const { return detail::to_result(cairn_presenter_reset(get())); }

    /** Its statistics: cairn_presenter_get_statistics. */
    result<presenter_statistics> statistics() const
    {
        return detail::fill<presenter_statistics>(
            [&](presenter_statistics *to) { return cairn_presenter_get_statistics(get(), to); });
    }
};

#if defined(_WIN32)
/**
 * AMD's swap chain, for engines that want AMD to present. Experimental. Release every reference to the DXGI swap chain and its buffers
 * before destroying it: while there is one, destroy() fails with CAIRN_ERROR_BUSY.
 */
class swapchain : public handle<cairn_swapchain> {
public:
    using handle::handle;

    /** Replaces an engine's swap chain, to which `own` must be the only reference: cairn_swapchain_wrap says when it becomes null. */
    static result<swapchain> wrap(const cairn::device &device, IDXGISwapChain *&own, const swapchain_options &options = {})
    {
        return detail::create<swapchain>([&](cairn_swapchain **to) { return cairn_swapchain_wrap(device.get(), &options, &own, to); });
    }

    /** Creates one as IDXGIFactory::CreateSwapChain does: cairn_swapchain_create. */
    static result<swapchain> create(const cairn::device &device, IDXGIFactory *factory, const DXGI_SWAP_CHAIN_DESC &description,
                                    const swapchain_options &options = {})
    {
        return detail::create<swapchain>([&](cairn_swapchain **to) {
            return cairn_swapchain_create(device.get(), &options, factory, &description, to);
        });
    }

    /** Creates one for a window, a HWND: cairn_swapchain_create_for_window. */
    static result<swapchain> create_for_window(const cairn::device &device, IDXGIFactory *factory, void *window,
                                               const DXGI_SWAP_CHAIN_DESC1 &description, const swapchain_options &options = {},
                                               const DXGI_SWAP_CHAIN_FULLSCREEN_DESC *fullscreen = nullptr)
    {
        return detail::create<swapchain>([&](cairn_swapchain **to) {
            return cairn_swapchain_create_for_window(device.get(), &options, factory, window, &description, fullscreen, to);
        });
    }

    /** The DXGI swap chain, as a new reference, which the caller releases: cairn_swapchain_get_dxgi. */
    result<IDXGISwapChain4 *> dxgi()
    {
        return detail::fill<IDXGISwapChain4 *>([&](IDXGISwapChain4 **to) { return cairn_swapchain_get_dxgi(get(), to); });
    }

    /** Records motion and depth of the frame that is presented next into the engine's command list: cairn_swapchain_prepare. */
    result<void> prepare(ID3D12GraphicsCommandList *list, const swapchain_frame &given)
    {
        return detail::to_result(cairn_swapchain_prepare(get(), list, &given));
    }

    /** Sets the picture that is composited over all frames, in D3D12_RESOURCE_STATES `state`; null for none: cairn_swapchain_set_interface. */
    result<void> set_interface(ID3D12Resource *ui, std::uint32_t state, std::uint32_t flags = 0)
    {
        return detail::to_result(cairn_swapchain_set_interface(get(), ui, state, flags));
    }

    /** Sets the pacing of presents: cairn_swapchain_set_pacing. */
    result<void> set_pacing(const swapchain_pacing &pacing) { return detail::to_result(cairn_swapchain_set_pacing(get(), &pacing)); }

    /** Restores AMD's default pacing: cairn_swapchain_set_pacing. */
    result<void> set_pacing() { return detail::to_result(cairn_swapchain_set_pacing(get(), nullptr)); }

    /** Disables generated frames until a frame is prepared again: cairn_swapchain_pause. */
    result<void> pause() { return detail::to_result(cairn_swapchain_pause(get())); }

    /** Waits until all frames are shown: cairn_swapchain_wait. */
    result<void> wait() { return detail::to_result(cairn_swapchain_wait(get())); }

    /** Adapts to the size of its buffers after ResizeBuffers: cairn_swapchain_fit. */
    result<void> fit() { return detail::to_result(cairn_swapchain_fit(get())); }

    /** Its statistics: cairn_swapchain_get_statistics. */
    result<swapchain_statistics> statistics() const
    {
        return detail::fill<swapchain_statistics>(
            [&](swapchain_statistics *to) { return cairn_swapchain_get_statistics(get(), to); });
    }
};
#endif

/* ---- 8. Recorded input ------------------------------------------------------------------------------------------- */

/** A player's input by world time. */
class script : public handle<cairn_script> {
public:
    using handle::handle;

    /** Reads a control script: cairn_script_create. */
    static result<script> create(std::string_view text)
    {
        return detail::create<script>([&](cairn_script **to) { return cairn_script_create(text.data(), text.size(), to); });
    }

    /** The controls of a latent step, from 1: cairn_script_get_controls. */
    result<cairn::controls> controls(std::uint64_t latent, std::uint32_t latents_per_second) const
    {
        return detail::fill<cairn::controls>(
            [&](cairn::controls *to) { return cairn_script_get_controls(get(), latent, latents_per_second, to); });
    }

    /** Its duration in microseconds of world time: cairn_script_get_duration. */
    result<std::uint64_t> duration() const
    {
        return detail::fill<std::uint64_t>([&](std::uint64_t *to) { return cairn_script_get_duration(get(), to); });
    }

    /** Its canonical text: cairn_script_get_text. */
    result<std::string> text() const
    {
        return detail::text([&](char *to, std::size_t room, std::size_t *length) {
            return cairn_script_get_text(get(), to, room, length);
        });
    }
};

/** Records a player's input and makes a script of it. */
class recorder : public handle<cairn_recorder> {
public:
    using handle::handle;

    /** Creates an empty recording: cairn_recorder_create. */
    static result<recorder> create()
    {
        return detail::create<recorder>([](cairn_recorder **to) { return cairn_recorder_create(to); });
    }

    /** Records that a key or mouse button, by its virtual-key code, went down or up: cairn_recorder_key. */
    result<void> key(std::uint64_t microseconds, std::uint32_t key, bool down)
    {
        return detail::to_result(cairn_recorder_key(get(), microseconds, key, down ? 1 : 0));
    }

    /** Records a motion of the mouse in counts, right and down positive: cairn_recorder_mouse. */
    result<void> mouse(std::uint64_t microseconds, float dx, float dy)
    {
        return detail::to_result(cairn_recorder_mouse(get(), microseconds, dx, dy));
    }

    /** Records a turn of the wheel in notches, up positive: cairn_recorder_scroll. */
    result<void> scroll(std::uint64_t microseconds, std::int32_t notches)
    {
        return detail::to_result(cairn_recorder_scroll(get(), microseconds, notches));
    }

    /** Records the controls of a latent step: cairn_recorder_step. */
    result<void> step(std::uint64_t latent, std::uint32_t latents_per_second, const controls &given)
    {
        return detail::to_result(cairn_recorder_step(get(), latent, latents_per_second, &given));
    }

    /** Makes a script of the recording so far, which ends at `microseconds` of world time: cairn_recorder_make_script. */
    result<script> make_script(std::uint64_t microseconds)
    {
        return detail::create<script>([&](cairn_script **to) { return cairn_recorder_make_script(get(), microseconds, to); });
    }
};

} /* namespace throwing or aborting */

} /* namespace cairn */

#endif /* CAIRN_HPP */
