/*
 * include/cairn.hpp over test doubles of functions of cairn.h, for results that the library gives only now and then: a state whose size changes
 * between two calls, and a long text of refusals. Not linked with the library.
 */
#include "cairn.hpp"

#include "check.hpp"

#include <algorithm>

/* The size of the state in each call of cairn_rollout_save; the last one stays. */
static std::vector<std::size_t> sizes;
static std::size_t calls;
/* The result of a call with too small a capacity, and the refusals. */
static cairn_result too_small;
static std::string refused;

/* The functions below do not read handles. */
static int object;

cairn_result cairn_rollout_save(const cairn_rollout *, void *bytes, std::size_t capacity, std::size_t *size)
{
    const std::size_t length = sizes[std::min(calls++, sizes.size() - 1)];
    if (bytes != nullptr || capacity > 0) {
        if (capacity < length) return too_small;
        std::fill_n(static_cast<unsigned char *>(bytes), length, static_cast<unsigned char>(length));
    }
    *size = length;
    return CAIRN_OK;
}

cairn_result cairn_device_create_auto(const cairn_device_options *, char *to, std::size_t capacity, std::size_t *length, cairn_device **device)
{
    if (length != nullptr) *length = refused.size();
    if (capacity > 0) to[refused.copy(to, capacity - 1)] = '\0';
    *device = reinterpret_cast<cairn_device *>(&object);
    return refused.size() < capacity ? CAIRN_OK : CAIRN_TRUNCATED;
}

cairn_result cairn_last_error(char *, std::size_t, std::size_t *length)
{
    *length = 0;
    return CAIRN_OK;
}

cairn_result cairn_last_error_part(std::uint32_t, char *, std::size_t, std::size_t *length)
{
    *length = 0;
    return CAIRN_OK;
}

cairn_result cairn_rollout_destroy(cairn_rollout *) { return CAIRN_OK; }
cairn_result cairn_device_destroy(cairn_device *) { return CAIRN_OK; }

/* Saves a state whose size is that of the next of `sizes` in each call. */
static cairn::result<std::vector<unsigned char>> save(std::vector<std::size_t> next, cairn_result answer = CAIRN_ERROR_INVALID_ARGUMENT)
{
    sizes = std::move(next);
    calls = 0;
    too_small = answer;
    return cairn::rollout(reinterpret_cast<cairn_rollout *>(&object)).save();
}

/* Whether a state of that size was saved, without bytes of another one. */
static bool is_state(const cairn::result<std::vector<unsigned char>> &saved, std::size_t size)
{
    return saved.ok() && *saved == std::vector<unsigned char>(size, static_cast<unsigned char>(size));
}

static void a_saved_state_has_the_size_of_its_second_call()
{
    CHECK(is_state(save({100}), 100));
    CHECK(is_state(save({100, 60}), 60));
    CHECK(is_state(save({100, 120}), 120));
    CHECK(is_state(save({100, 120, 120, 90}), 90));
    CHECK(is_state(save({100, 120, 120, 130}), 130));
}

static void a_state_that_cannot_be_saved_is_an_error()
{
    CHECK(save({100, 120}, CAIRN_ERROR_BUSY).code() == CAIRN_ERROR_BUSY && calls == 2);
    /* A failure that is not about the size is not repeated: the state is no longer than the memory. */
    CHECK(save({100, 120, 100}).code() == CAIRN_ERROR_INVALID_ARGUMENT && calls == 3);
    std::vector<std::size_t> growing(1000);
    for (std::size_t i = 0; i < growing.size(); i++) growing[i] = i + 1;
    CHECK(save(growing).code() == CAIRN_ERROR_INVALID_ARGUMENT && calls < 40);
}

static void refusals_are_whole_up_to_their_limit()
{
    std::string refusals;
    for (const std::size_t length : {std::size_t{0}, std::size_t{5000}, std::size_t{65535}}) {
        refused.assign(length, 'x');
        CHECK(cairn::device::best({}, &refusals).ok() && refusals == refused);
    }
    refused.assign(70000, 'x');
    CHECK(cairn::device::best({}, &refusals).ok() && refusals.size() == 65535);
    CHECK(cairn::device::best().ok());
}

int main()
{
    RUN(a_saved_state_has_the_size_of_its_second_call);
    RUN(a_state_that_cannot_be_saved_is_an_error);
    RUN(refusals_are_whole_up_to_their_limit);
    return failed_tests != 0;
}
