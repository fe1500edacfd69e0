/**
 * Cairn in C++17: cairn.h with objects that end by themselves, results that cannot be overlooked, and structs that know their
 * size. Header only, and nothing but cairn.h's functions behind it: link against the library as with cairn.h.
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
 * Every member function is the function of cairn.h that its comment names, whose own comment has the rest: what is handed over,
 * how long it takes, which results there are. The rules, once:
 *
 * Objects. device, world, anchor, rollout, guidance, presenter, script and recorder own one handle each, or none. They can be moved
 * and not copied; what was moved from is empty, and a call through an empty one answers CAIRN_ERROR_INVALID_HANDLE. They may end in
 * any order. One that ends within a callback of a call on it cannot be destroyed there and is left behind: see handle::destroy.
 *
 * Threads. A const member function may be called by any number of threads at the same time, another one by one thread at a time.
 * Moving, reset() and the end of an object are for one thread alone.
 *
 * Results. Every call that can fail gives a cairn::result. With exceptions: .value() is the value, or throws a cairn::error, which
 * carries code, message and the message's parts. Without: ask .ok(), then .why() has the same error and *result the value. Nothing
 * else throws, but for std::bad_alloc where memory for a text or an array is short. In a program compiled without exceptions .value()
 * of a failure writes its message to standard error and ends the program.
 *
 * Answers that are no error and no success, "not yet" and "the queue is full", are a part of the value: an empty std::optional, or
 * false.
 *
 * Structs. cairn::controls is cairn_controls, all zero and with its struct_size; so are all structs. Results are numbers of cairn.h
 * and constants its macros. Texts come as std::string and are never cut; paths go in as UTF-8.
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

/* ---- 1. Version -------------------------------------------------------------------------------------------------- */

/** The binary interface of the loaded library: cairn_abi_version. */
inline std::uint32_t abi_version() noexcept { return cairn_abi_version(); }

/** The version of the loaded library, as CAIRN_VERSION: cairn_version. */
inline std::uint32_t version() noexcept { return cairn_version(); }

/* ---- 2. Results -------------------------------------------------------------------------------------------------- */

/** The name of a result, such as "CAIRN_ERROR_IO": cairn_result_name. */
inline const char *result_name(cairn_result code) noexcept { return cairn_result_name(code); }

/**
 * Why a call failed: the one exception of this header, and what result::why gives. Copies share the texts.
 */
class error : public std::exception {
public:
    /** No failure: code CAIRN_OK, no text. */
    error() noexcept = default;

    /** A failure of a host's own, in the library's words. */
    error(cairn_result code, std::string message) : code_(code), texts_(std::make_shared<texts>())
    {
        texts_->message = std::move(message);
    }

    /** What the calling thread's latest failed call said: cairn_last_error, cairn_last_error_part. */
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
     * A whole text that `copy` copies into a buffer, as cairn_last_error does; empty where it fails.
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
        } while (r == CAIRN_TRUNCATED); /* it has grown meanwhile */
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

/** What becomes of a failure that is asked for its value. */
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

/** What a call gave: a T, or why there is none. */
template <class T> class [[nodiscard]] result {
public:
    result(T value) : value_(std::move(value)) {}
    result(error why) : why_(std::move(why)) {}

    /** Whether there is a value. */
    bool ok() const noexcept { return value_.has_value(); }
    /** CAIRN_OK, or the failure's. */
    cairn_result code() const noexcept { return why_.code(); }
    /** The failure; empty where there is a value. */
    const error &why() const noexcept { return why_; }

    /** The value; where there is none, throws why(). */
    T &value() & { return must_be_there(), *value_; }
    const T &value() const & { return must_be_there(), *value_; }
    T value() && { return must_be_there(), std::move(*value_); }

    /** The value, which must be there. */
    T &operator*() noexcept { return *value_; }
    const T &operator*() const noexcept { return *value_; }
    T *operator->() noexcept { return &*value_; }
    const T *operator->() const noexcept { return &*value_; }

private:
    void must_be_there() const
    {
        if (!value_) detail::raise(why_);
    }

    std::optional<T> value_;
    error why_;
};

/** Whether a call worked, or why not. */
template <> class [[nodiscard]] result<void> {
public:
    result() noexcept = default;
    result(error why) : why_(std::move(why)) {}

    /** Whether it worked. */
    bool ok() const noexcept { return why_.code() == CAIRN_OK; }
    /** CAIRN_OK, or the failure's. */
    cairn_result code() const noexcept { return why_.code(); }
    /** The failure; empty where it worked. */
    const error &why() const noexcept { return why_; }
    /** Throws why() where it did not work. */
    void value() const
    {
        if (!ok()) detail::raise(why_);
    }

private:
    error why_;
};

/** Whether header and library fit: call it before anything else where they may come from different builds. */
inline result<void> check_version()
{
    if (abi_version() == CAIRN_ABI_VERSION && version() >= CAIRN_VERSION) return {};
    return error(CAIRN_ERROR_UNSUPPORTED,
                 "the library has binary interface " + std::to_string(abi_version()) + " and version " + std::to_string(version()) +
                     ", the program was compiled for " + std::to_string(CAIRN_ABI_VERSION) + " and " + std::to_string(CAIRN_VERSION) +
                     ". Put the library beside the program that belongs to it");
}

/* ---- 3. Structs and views ---------------------------------------------------------------------------------------- */

/** A struct of cairn.h with its struct_size, and zero in all else. */
template <class C> struct sized : C {
    sized() noexcept : C() { this->struct_size = sizeof(C); }
    /** The same, whatever struct_size says. */
    sized(const C &other) noexcept : C(other) { this->struct_size = sizeof(C); }
};

using cpu_options = sized<cairn_cpu_options>;
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

/** Elements in somebody's memory: an array, a std::vector, a std::array, or a pointer and how many there are. */
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

/** A picture in the host's memory, for the library to read; `pixels` must live as long as it is used. */
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

/** Memory of the host's for the library to write a picture into; `pixels` must live as long as it is used. */
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

/* ---- 4. What all objects are ------------------------------------------------------------------------------------- */

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

/** Whether a call worked. */
inline result<void> done(cairn_result r)
{
    if (r < 0) return error::last(r);
    return {};
}

/** Whether a call did what was asked for, where an answer above 0 says that it did not. */
inline result<bool> accepted(cairn_result r)
{
    if (r < 0) return error::last(r);
    return r == CAIRN_OK;
}

/** An object whose handle a call makes. */
template <class Object, class Call> result<Object> made(Call call)
{
    typename Object::raw_type *raw = nullptr;
    const cairn_result r = call(&raw);
    if (r < 0) return error::last(r);
    return Object(raw);
}

/** A struct or a number that a call fills. */
template <class T, class Call> result<T> filled(Call call)
{
    T value{};
    const cairn_result r = call(&value);
    if (r < 0) return error::last(r);
    return value;
}

/** The same, where there may be none yet. */
template <class T, class Call> result<std::optional<T>> filled_or_none(Call call)
{
    T value{};
    const cairn_result r = call(&value);
    if (r < 0) return error::last(r);
    return r == CAIRN_OK ? std::optional<T>(std::move(value)) : std::nullopt;
}

/** A text that a call copies. */
template <class Call> result<std::string> text(Call call)
{
    cairn_result r = CAIRN_OK;
    std::string text = error::read(call, &r);
    if (r < 0) return error::last(r);
    return text;
}

/** An array that a call fills: call(rows, stride, capacity, &count). */
template <class Row, class Call> result<std::vector<Row>> rows(Call call)
{
    std::vector<Row> rows;
    std::uint32_t count = 0;
    for (;;) {
        const cairn_result r = call(rows.empty() ? nullptr : rows.data(), sizeof(Row), static_cast<std::uint32_t>(rows.size()), &count);
        if (r < 0) return error::last(r);
        const bool all = count <= rows.size();
        rows.resize(count);
        if (all) return rows;
    }
}

} /* namespace detail */

/** One handle, or none, that is destroyed with the object. */
template <class T> class handle {
public:
    using raw_type = T;

    /** None. */
    constexpr handle() noexcept = default;
    /** Takes over a handle that a function of cairn.h made. */
    explicit handle(T *raw) noexcept : raw_(raw) {}
    handle(handle &&other) noexcept : raw_(other.release()) {}
    handle &operator=(handle &&other) noexcept
    {
        reset(other.release());
        return *this;
    }
    ~handle() { reset(); }

    /** Whether there is one. */
    explicit operator bool() const noexcept { return raw_ != nullptr; }
    /** For functions of cairn.h; null for none. It stays the object's. */
    T *get() const noexcept { return raw_; }
    /** Gives the handle away: the caller destroys it. */
    [[nodiscard]] T *release() noexcept { return std::exchange(raw_, nullptr); }
    /** Destroys the handle, and takes over another one. */
    void reset(T *raw = nullptr) noexcept { detail::destroy(std::exchange(raw_, raw)); }
    /**
     * Destroys the handle and says whether that could be done: within a callback of a call on it CAIRN_ERROR_BUSY is the answer, and
     * it is kept.
     */
    result<void> destroy()
    {
        result<void> ended = detail::done(detail::destroy(raw_));
        if (ended.ok()) raw_ = nullptr;
        return ended;
    }

private:
    T *raw_ = nullptr;
};

/* ---- 5. Logging, devices, worlds --------------------------------------------------------------------------------- */

/** Sets where messages of at least that importance go; null ends logging: cairn_set_log_callback. */
inline result<void> set_log_callback(std::uint32_t level, cairn_log_callback callback, void *user = nullptr)
{
    return detail::done(cairn_set_log_callback(level, callback, user));
}

/** What devices can be made of: cairn_adapters. */
inline result<std::vector<adapter>> adapters()
{
    return detail::rows<adapter>([](adapter *rows, std::size_t stride, std::uint32_t capacity, std::uint32_t *count) {
        return cairn_adapters(rows, stride, capacity, count);
    });
}

/** What a device of that kind needs and what was found: cairn_device_requirements. */
inline result<std::vector<requirement>> requirements(std::uint32_t kind, const cpu_options &options = {})
{
    return detail::rows<requirement>([&](requirement *rows, std::size_t stride, std::uint32_t capacity, std::uint32_t *count) {
        return cairn_device_requirements(kind, &options, rows, stride, capacity, count);
    });
}

#if defined(_WIN32)
/** What a device runs on, with a reference more to each object: the caller's to release, as by ComPtr::Attach. */
struct d3d12_objects {
    ID3D12Device *device;
    ID3D12CommandQueue *queue;
};

/** What to wait for until it has the value. A reference more to the fence, the caller's to release. */
struct d3d12_guard {
    ID3D12Fence *fence;
    std::uint64_t value;
};

/** A picture of an anchor: RGBA8 in state COMMON, to be left in it. A reference more to each object, the caller's to release. */
struct d3d12_picture {
    ID3D12Resource *texture;
    /** To be waited for until it has the value, before the texture is read. */
    ID3D12Fence *fence;
    std::uint64_t value;
};
#endif

/** A device that runs worlds. */
class device : public handle<cairn_device> {
public:
    using handle::handle;

    /** The host's processor, on every system: cairn_device_create_cpu. */
    static result<device> cpu(const cpu_options &options = {})
    {
        return detail::made<device>([&](cairn_device **to) { return cairn_device_create_cpu(&options, to); });
    }

#if defined(_WIN32)
    /**
     * An engine's own Direct3D 12 device and queue, and a compute queue for the world's passes or null for one of the library's own:
     * cairn_device_create_d3d12. Experimental, as all with d3d12 or swapchain in its name.
     */
    static result<device> d3d12(ID3D12Device *engine, ID3D12CommandQueue *queue, ID3D12CommandQueue *anchors = nullptr)
    {
        return detail::made<device>([&](cairn_device **to) { return cairn_device_create_d3d12(engine, queue, anchors, to); });
    }

    /** A Direct3D 12 device of the library's own on an adapter of adapters(): cairn_device_create_adapter. */
    static result<device> of_adapter(std::uint64_t luid)
    {
        return detail::made<device>([&](cairn_device **to) { return cairn_device_create_adapter(luid, to); });
    }

    /** How it runs worlds and rollouts that come from now on: cairn_device_set_d3d12. */
    result<void> set(const d3d12_options &options) const
    {
        return detail::done(cairn_device_set_d3d12(get(), &options));
    }

    /** What it runs on: cairn_device_get_d3d12. */
    result<d3d12_objects> d3d12() const
    {
        return detail::filled<d3d12_objects>([&](d3d12_objects *to) { return cairn_device_get_d3d12(get(), &to->device, &to->queue); });
    }
#endif

    /** What it is: cairn_device_get_info. */
    result<device_info> info() const
    {
        return detail::filled<device_info>([&](device_info *to) { return cairn_device_get_info(get(), to); });
    }
};

/** A loaded world, which may have any number of rollouts. */
class world : public handle<cairn_world> {
public:
    using handle::handle;

    /** Loads a world, the library's own where the options name no path: cairn_world_load. */
    static result<world> load(const cairn::device &device, const world_options &options = {})
    {
        return detail::made<world>([&](cairn_world **to) { return cairn_world_load(device.get(), &options, to); });
    }

    /**
     * The same; `progress` is called with a const load_progress & as the load goes on, and ends it by answering false. What it throws
     * ends the load as well, and comes out of here.
     */
    template <class Progress> static result<world> load(const cairn::device &device, const world_options &options, Progress &&progress)
    {
        follower<std::remove_reference_t<Progress>> follow{progress};
        world_options followed = options;
        followed.progress = [](const cairn_load_progress *now, void *user) -> std::uint32_t {
            return static_cast<follower<std::remove_reference_t<Progress>> *>(user)->ends(*now);
        };
        followed.user = &follow;
        result<world> loaded = load(device, followed);
#if CAIRN_HPP_EXCEPTIONS
        if (follow.thrown) std::rethrow_exception(follow.thrown);
#endif
        return loaded;
    }

    /** What it is: cairn_world_get_info. */
    result<world_info> info() const
    {
        return detail::filled<world_info>([&](world_info *to) { return cairn_world_get_info(get(), to); });
    }

    /** How much memory it needs with one rollout: cairn_world_get_memory. */
    result<world_memory> memory() const
    {
        return detail::filled<world_memory>([&](world_memory *to) { return cairn_world_get_memory(get(), to); });
    }

    /** The text of its licence: cairn_world_get_licence. */
    result<std::string> licence() const
    {
        return detail::text([&](char *to, std::size_t room, std::size_t *length) {
            return cairn_world_get_licence(get(), to, room, length);
        });
    }

private:
    /** A host's function behind C's; an exception must not pass through the library. */
    template <class Progress> struct follower {
        Progress &progress;
#if CAIRN_HPP_EXCEPTIONS
        std::exception_ptr thrown = nullptr;
        std::uint32_t ends(const load_progress &now) noexcept
        {
            try {
                return progress(now) ? 0 : 1;
            } catch (...) {
                thrown = std::current_exception();
                return 1;
            }
        }
#else
        std::uint32_t ends(const load_progress &now) noexcept { return progress(now) ? 0 : 1; }
#endif
    };
};

/* ---- 6. Anchors and rollouts ------------------------------------------------------------------------------------- */

/** A strong picture with its latent: a copy that stays as it is, whatever becomes of its rollout. */
class anchor : public handle<cairn_anchor> {
public:
    using handle::handle;

    /** An anchor of the host's own picture; `number` counts up by one, `flags` are CAIRN_ANCHOR_CUT or 0: cairn_anchor_create. */
    static result<anchor> create(const picture &given, std::uint64_t number, std::uint32_t flags = 0)
    {
        return detail::made<anchor>([&](cairn_anchor **to) { return cairn_anchor_create(&given, number, flags, to); });
    }

    /** What it is: cairn_anchor_get_info. */
    result<anchor_info> info() const
    {
        return detail::filled<anchor_info>([&](anchor_info *to) { return cairn_anchor_get_info(get(), to); });
    }

    /** Copies picture `index`, in order of time, into memory of its size: cairn_anchor_read_picture. */
    result<void> read_picture(std::uint32_t index, const target &to) const
    {
        return detail::done(cairn_anchor_read_picture(get(), index, &to));
    }

    /** Copies the latent, [channels, height, width]: cairn_anchor_read_latent. */
    result<void> read_latent(span<float> to) const { return detail::done(cairn_anchor_read_latent(get(), to.data(), to.size())); }

#if defined(_WIN32)
    /** Picture `index` as a texture: cairn_anchor_get_d3d12. */
    result<d3d12_picture> d3d12(std::uint32_t index) const
    {
        return detail::filled<d3d12_picture>(
            [&](d3d12_picture *to) { return cairn_anchor_get_d3d12(get(), index, &to->texture, &to->fence, &to->value); });
    }
#endif
};

/** What a queued step did and made. */
struct completed {
    step_info step;
    cairn::anchor anchor;
};

/** One running instance of a world. */
class rollout : public handle<cairn_rollout> {
public:
    using handle::handle;

    /** Starts empty: the first thing to do is to append a seed picture: cairn_rollout_create. */
    static result<rollout> create(const cairn::world &world, const rollout_options &options = {})
    {
        return detail::made<rollout>([&](cairn_rollout **to) { return cairn_rollout_create(world.get(), &options, to); });
    }

    /** What it is, and how far: cairn_rollout_get_info. */
    result<rollout_info> info() const
    {
        return detail::filled<rollout_info>([&](rollout_info *to) { return cairn_rollout_get_info(get(), to); });
    }

    /** What it has done so far: cairn_rollout_get_statistics. */
    result<rollout_statistics> statistics() const
    {
        return detail::filled<rollout_statistics>([&](rollout_statistics *to) { return cairn_rollout_get_statistics(get(), to); });
    }

    /** Appends a picture, on the calling thread: cairn_rollout_append. */
    result<step_info> append(const picture &given)
    {
        return detail::filled<step_info>([&](step_info *to) { return cairn_rollout_append(get(), &given, to); });
    }

#if defined(_WIN32)
    /** Appends a texture in a D3D12_RESOURCE_STATES, which it is left in: cairn_rollout_append_d3d12. */
    result<step_info> append_d3d12(ID3D12Resource *given, std::uint32_t state)
    {
        return detail::filled<step_info>([&](step_info *to) { return cairn_rollout_append_d3d12(get(), given, state, to); });
    }
#endif

    /** Makes the next latent with these controls, on the calling thread: cairn_rollout_step. */
    result<step_info> step(const controls &given)
    {
        return detail::filled<step_info>([&](step_info *to) { return cairn_rollout_step(get(), &given, to); });
    }

    /** Holds latents to so many nanoseconds each: cairn_rollout_set_budget. */
    result<void> set_budget(std::uint64_t latent_ns, const char *schedules)
    {
        return detail::done(cairn_rollout_set_budget(get(), latent_ns, schedules));
    }

    /** Holds it, and the frames of a presenter, to a budget: cairn_rollout_govern. */
    result<void> govern(const budget &given) { return detail::done(cairn_rollout_govern(get(), &given)); }

    /** Ends that. */
    result<void> ungovern() { return detail::done(cairn_rollout_govern(get(), nullptr)); }

    /** Back to the start with the same seed: cairn_rollout_reset. Not the reset() of every object, which ends it. */
    result<void> restart() { return detail::done(cairn_rollout_reset(get())); }

    /** A copy of the last anchor: cairn_rollout_get_anchor. */
    result<cairn::anchor> anchor() const
    {
        return detail::made<cairn::anchor>([&](cairn_anchor **to) { return cairn_rollout_get_anchor(get(), to); });
    }

    /** Queues a step for the rollout's own thread; a ticket, or none where the queue is full: cairn_rollout_submit. */
    result<std::optional<std::uint64_t>> submit(const controls &given) const
    {
        return detail::filled_or_none<std::uint64_t>([&](std::uint64_t *to) { return cairn_rollout_submit(get(), &given, to); });
    }

    /** Queues the append of a picture: cairn_rollout_submit_picture. */
    result<std::optional<std::uint64_t>> submit(const picture &given) const
    {
        return detail::filled_or_none<std::uint64_t>(
            [&](std::uint64_t *to) { return cairn_rollout_submit_picture(get(), &given, to); });
    }

    /** The result of a queued step, or none while it waits or runs: cairn_rollout_poll. */
    result<std::optional<completed>> poll(std::uint64_t ticket) const
    {
        return collected([&](step_info *step, cairn_anchor **to) { return cairn_rollout_poll(get(), ticket, step, to); });
    }

    /** The same, after it has ended, or none when the time is over: cairn_rollout_wait. */
    result<std::optional<completed>> wait(std::uint64_t ticket, std::uint64_t timeout_ns = CAIRN_FOREVER) const
    {
        return collected([&](step_info *step, cairn_anchor **to) { return cairn_rollout_wait(get(), ticket, timeout_ns, step, to); });
    }

    /** Ends everything that is going on: cairn_rollout_cancel. */
    result<void> cancel() const { return detail::done(cairn_rollout_cancel(get())); }
    /** Holds the queue: cairn_rollout_pause. */
    result<void> pause() const { return detail::done(cairn_rollout_pause(get())); }
    /** Lets a held queue go on: cairn_rollout_resume. */
    result<void> resume() const { return detail::done(cairn_rollout_resume(get())); }
    /** Lets one step of a held queue run; false where none is queued: cairn_rollout_single_step. */
    result<bool> single_step() const { return detail::accepted(cairn_rollout_single_step(get())); }

    /** The whole state: cairn_rollout_save. */
    result<std::vector<unsigned char>> save() const
    {
        std::size_t size = 0;
        cairn_result r = cairn_rollout_save(get(), nullptr, 0, &size);
        std::vector<unsigned char> bytes(r < 0 ? 0 : size);
        if (r >= 0) r = cairn_rollout_save(get(), bytes.data(), bytes.size(), &size);
        if (r < 0) return error::last(r);
        return bytes;
    }

    /** The whole state into a file, whole or not at all: cairn_rollout_save_file. */
    result<void> save_file(const std::string &path) const { return detail::done(cairn_rollout_save_file(get(), path.c_str())); }
    /** Takes up a saved state: cairn_rollout_restore. */
    result<void> restore(span<const unsigned char> bytes)
    {
        return detail::done(cairn_rollout_restore(get(), bytes.data(), bytes.size()));
    }
    /** Takes up a saved state from a file: cairn_rollout_restore_file. */
    result<void> restore_file(const std::string &path) { return detail::done(cairn_rollout_restore_file(get(), path.c_str())); }

private:
    template <class Call> static result<std::optional<completed>> collected(Call call)
    {
        completed made;
        cairn_anchor *raw = nullptr;
        const cairn_result r = call(&made.step, &raw);
        if (r < 0) return error::last(r);
        made.anchor.reset(raw);
        return r == CAIRN_OK ? std::optional<completed>(std::move(made)) : std::nullopt;
    }
};

/* ---- 7. Guidance and presenters ---------------------------------------------------------------------------------- */

/** Motion and depth of a pair of anchors. */
class guidance : public handle<cairn_guidance> {
public:
    using handle::handle;

    /** Finds both, from CAIRN_MOTION_AUTO and so on: cairn_guidance_create. */
    static result<guidance> create(const anchor &previous, const anchor &current, std::uint32_t source = CAIRN_MOTION_AUTO)
    {
        return detail::made<guidance>(
            [&](cairn_guidance **to) { return cairn_guidance_create(previous.get(), current.get(), source, to); });
    }

    /** Takes the host's own: cairn_guidance_create_from_host. */
    static result<guidance> create(const guidance_data &data)
    {
        return detail::made<guidance>([&](cairn_guidance **to) { return cairn_guidance_create_from_host(&data, to); });
    }

    /** What it is: cairn_guidance_get_info. */
    result<guidance_info> info() const
    {
        return detail::filled<guidance_info>([&](guidance_info *to) { return cairn_guidance_get_info(get(), to); });
    }

    /** Copies the motion, half floats x, y for each pixel: cairn_guidance_read_motion. */
    result<void> read_motion(span<std::uint16_t> to) const
    {
        return detail::done(cairn_guidance_read_motion(get(), to.data(), to.size()));
    }

    /** Copies the depth, 0 near: cairn_guidance_read_depth. */
    result<void> read_depth(span<float> to) const { return detail::done(cairn_guidance_read_depth(get(), to.data(), to.size())); }
};

/** Shows a stream of anchors at a steady rate. */
class presenter : public handle<cairn_presenter> {
public:
    using handle::handle;

    /** cairn_presenter_create. */
    static result<presenter> create(const presenter_options &options = {})
    {
        return detail::made<presenter>([&](cairn_presenter **to) { return cairn_presenter_create(&options, to); });
    }

    /** Gives it the next anchor; false where the queue is full: cairn_presenter_push. */
    result<bool> push(const cairn::anchor &anchor, std::uint64_t now_ns) const
    {
        return detail::accepted(cairn_presenter_push(get(), anchor.get(), nullptr, now_ns));
    }

    /** The same, with guidance of the anchor before and this one. */
    result<bool> push(const cairn::anchor &anchor, const cairn::guidance &guidance, std::uint64_t now_ns) const
    {
        return detail::accepted(cairn_presenter_push(get(), anchor.get(), guidance.get(), now_ns));
    }

    /** Which frame is due, or none before the first anchor came: cairn_presenter_query. */
    result<std::optional<frame>> query(std::uint64_t now_ns) const
    {
        return detail::filled_or_none<frame>([&](frame *to) { return cairn_presenter_query(get(), now_ns, to); });
    }

    /** Makes the frame that is due and writes it, or nothing before the first anchor came: cairn_presenter_draw. */
    result<std::optional<frame>> draw(std::uint64_t now_ns, const target &memory)
    {
        return detail::filled_or_none<frame>([&](frame *to) { return cairn_presenter_draw(get(), now_ns, &memory, to); });
    }

#if defined(_WIN32)
    /**
     * Makes all that frames need, on a thread that loads; false where no anchor has come and `wanted` does not say how large anchors
     * are: cairn_presenter_prepare_d3d12.
     */
    result<bool> prepare_d3d12(const cairn::device &device, const d3d12_preparation &wanted = {}) const
    {
        return detail::accepted(cairn_presenter_prepare_d3d12(get(), device.get(), &wanted));
    }

    /**
     * Records the frame that is due into the engine's command list; nothing before the first anchor came, and where as many lists as were
     * prepared may not have run: cairn_presenter_record_d3d12.
     */
    result<std::optional<frame>> record_d3d12(const cairn::device &device, std::uint64_t now_ns, const d3d12_recording &recording)
    {
        return detail::filled_or_none<frame>([&](frame *to) {
            return cairn_presenter_record_d3d12(get(), device.get(), now_ns, &recording, to);
        });
    }

    /** The same into a texture, in a list of the presenter's own, given to the device's queue; `guard` gets what to wait for: cairn_presenter_submit_d3d12. */
    result<std::optional<frame>> submit_d3d12(const cairn::device &device, std::uint64_t now_ns, ID3D12Resource *texture,
                                              std::uint32_t before, std::uint32_t after, d3d12_guard &guard)
    {
        return detail::filled_or_none<frame>([&](frame *to) {
            return cairn_presenter_submit_d3d12(get(), device.get(), now_ns, texture, before, after, to, &guard.fence, &guard.value);
        });
    }

    /** Waits for its frames and releases their targets, before a swap chain is resized: cairn_presenter_release_d3d12. */
    result<void> release_d3d12() { return detail::done(cairn_presenter_release_d3d12(get())); }
#endif

    /** Changes the size of the frames; 0 both ways for the anchors': cairn_presenter_resize. */
    result<void> resize(std::uint32_t width, std::uint32_t height) const
    {
        return detail::done(cairn_presenter_resize(get(), width, height));
    }

    /** Says what lies over the anchors and stands still; nothing where `mask` is null: cairn_presenter_set_overlay. */
    result<void> set_overlay(const std::uint8_t *mask, std::size_t size, std::uint32_t width, std::uint32_t height) const
    {
        return detail::done(cairn_presenter_set_overlay(get(), mask, size, width, height));
    }

    /** Holds frames to so many nanoseconds of the device's time each: cairn_presenter_set_budget. */
    result<void> set_budget(std::uint64_t frame_ns) const
    {
        return detail::done(cairn_presenter_set_budget(get(), frame_ns));
    }

    /** Forgets all anchors: cairn_presenter_reset. Not the reset() of every object, which ends it. */
    result<void> restart() const { return detail::done(cairn_presenter_reset(get())); }

    /** What it has done, and with what: cairn_presenter_get_statistics. */
    result<presenter_statistics> statistics() const
    {
        return detail::filled<presenter_statistics>(
            [&](presenter_statistics *to) { return cairn_presenter_get_statistics(get(), to); });
    }
};

#if defined(_WIN32)
/**
 * A swap chain of AMD's, for engines that want AMD to present. Experimental. Let go of every reference to the DXGI swap chain and its
 * buffers before it goes: while somebody holds one, destroy() answers CAIRN_ERROR_BUSY.
 */
class swapchain : public handle<cairn_swapchain> {
public:
    using handle::handle;

    /** Has AMD take over an engine's own, the only reference to which `own` is: cairn_swapchain_wrap says when it becomes null. */
    static result<swapchain> wrap(const cairn::device &device, IDXGISwapChain *&own, const swapchain_options &options = {})
    {
        return detail::made<swapchain>([&](cairn_swapchain **to) { return cairn_swapchain_wrap(device.get(), &options, &own, to); });
    }

    /** Has AMD make one as IDXGIFactory::CreateSwapChain does: cairn_swapchain_create. */
    static result<swapchain> create(const cairn::device &device, IDXGIFactory *factory, const DXGI_SWAP_CHAIN_DESC &description,
                                    const swapchain_options &options = {})
    {
        return detail::made<swapchain>([&](cairn_swapchain **to) {
            return cairn_swapchain_create(device.get(), &options, factory, &description, to);
        });
    }

    /** Has AMD make one for a window, a HWND: cairn_swapchain_create_for_window. */
    static result<swapchain> create_for_window(const cairn::device &device, IDXGIFactory *factory, void *window,
                                               const DXGI_SWAP_CHAIN_DESC1 &description, const swapchain_options &options = {},
                                               const DXGI_SWAP_CHAIN_FULLSCREEN_DESC *fullscreen = nullptr)
    {
        return detail::made<swapchain>([&](cairn_swapchain **to) {
            return cairn_swapchain_create_for_window(device.get(), &options, factory, window, &description, fullscreen, to);
        });
    }

    /** The swap chain itself, with a reference more, the caller's to release: cairn_swapchain_get_dxgi. */
    result<IDXGISwapChain4 *> dxgi()
    {
        return detail::filled<IDXGISwapChain4 *>([&](IDXGISwapChain4 **to) { return cairn_swapchain_get_dxgi(get(), to); });
    }

    /** Records motion and depth of the frame that is presented next into the engine's command list: cairn_swapchain_prepare. */
    result<void> prepare(ID3D12GraphicsCommandList *list, const swapchain_frame &told)
    {
        return detail::done(cairn_swapchain_prepare(get(), list, &told));
    }

    /** Says what is laid over all frames, in a D3D12_RESOURCE_STATES; null for nothing: cairn_swapchain_set_interface. */
    result<void> set_interface(ID3D12Resource *shown, std::uint32_t state, std::uint32_t flags = 0)
    {
        return detail::done(cairn_swapchain_set_interface(get(), shown, state, flags));
    }

    /** Says how presents are spread over time: cairn_swapchain_set_pacing. */
    result<void> set_pacing(const swapchain_pacing &pacing) { return detail::done(cairn_swapchain_set_pacing(get(), &pacing)); }

    /** Has them spread as AMD does on its own: cairn_swapchain_set_pacing. */
    result<void> set_pacing() { return detail::done(cairn_swapchain_set_pacing(get(), nullptr)); }

    /** Presents frames as they come until one is prepared again: cairn_swapchain_pause. */
    result<void> pause() { return detail::done(cairn_swapchain_pause(get())); }

    /** Waits until all frames are shown: cairn_swapchain_wait. */
    result<void> wait() { return detail::done(cairn_swapchain_wait(get())); }

    /** Makes it ready for the size of its buffers after ResizeBuffers: cairn_swapchain_fit. */
    result<void> fit() { return detail::done(cairn_swapchain_fit(get())); }

    /** What it has done and keeps: cairn_swapchain_get_statistics. */
    result<swapchain_statistics> statistics() const
    {
        return detail::filled<swapchain_statistics>(
            [&](swapchain_statistics *to) { return cairn_swapchain_get_statistics(get(), to); });
    }
};
#endif

/* ---- 8. Input written down, and played again --------------------------------------------------------------------- */

/** What a player does, by world time. */
class script : public handle<cairn_script> {
public:
    using handle::handle;

    /** Reads a control script: cairn_script_create. */
    static result<script> create(std::string_view text)
    {
        return detail::made<script>([&](cairn_script **to) { return cairn_script_create(text.data(), text.size(), to); });
    }

    /** The controls of a latent step, from 1: cairn_script_get_controls. */
    result<cairn::controls> controls(std::uint64_t latent, std::uint32_t latents_per_second) const
    {
        return detail::filled<cairn::controls>(
            [&](cairn::controls *to) { return cairn_script_get_controls(get(), latent, latents_per_second, to); });
    }

    /** How long it lasts, in microseconds of world time: cairn_script_get_duration. */
    result<std::uint64_t> duration() const
    {
        return detail::filled<std::uint64_t>([&](std::uint64_t *to) { return cairn_script_get_duration(get(), to); });
    }

    /** Its canonical text: cairn_script_get_text. */
    result<std::string> text() const
    {
        return detail::text([&](char *to, std::size_t room, std::size_t *length) {
            return cairn_script_get_text(get(), to, room, length);
        });
    }
};

/** Collects what a player does and makes a script of it. */
class recorder : public handle<cairn_recorder> {
public:
    using handle::handle;

    /** An empty recording: cairn_recorder_create. */
    static result<recorder> create()
    {
        return detail::made<recorder>([](cairn_recorder **to) { return cairn_recorder_create(to); });
    }

    /** A key or mouse button, by its virtual-key code, went down or up: cairn_recorder_key. */
    result<void> key(std::uint64_t microseconds, std::uint32_t key, bool down)
    {
        return detail::done(cairn_recorder_key(get(), microseconds, key, down ? 1 : 0));
    }

    /** The mouse moved by counts, right and down positive: cairn_recorder_mouse. */
    result<void> mouse(std::uint64_t microseconds, float dx, float dy)
    {
        return detail::done(cairn_recorder_mouse(get(), microseconds, dx, dy));
    }

    /** The wheel turned by notches, up positive: cairn_recorder_scroll. */
    result<void> scroll(std::uint64_t microseconds, std::int32_t notches)
    {
        return detail::done(cairn_recorder_scroll(get(), microseconds, notches));
    }

    /** A latent step got these controls: cairn_recorder_step. */
    result<void> step(std::uint64_t latent, std::uint32_t latents_per_second, const controls &given)
    {
        return detail::done(cairn_recorder_step(get(), latent, latents_per_second, &given));
    }

    /** A script of what was recorded, which ends at `microseconds` of world time: cairn_recorder_make_script. */
    result<script> make_script(std::uint64_t microseconds)
    {
        return detail::made<script>([&](cairn_script **to) { return cairn_recorder_make_script(get(), microseconds, to); });
    }
};

} /* namespace cairn */

#endif /* CAIRN_HPP */
