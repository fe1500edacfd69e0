/*
 * include/cairn.hpp: ownership, errors, and a path through the embedded world. Compiled with exceptions and without; each variant tests
 * all that it supports.
 */
#include "cairn.hpp"

#include "check.hpp"

#include <array>
#include <cstring>
#include <type_traits>

/* Prints a result that differs from the expected code. */
#define ANSWERS(expected, call)                                                                                                \
    do {                                                                                                                       \
        const auto &given = (call);                                                                                            \
        if (given.code() != (expected)) {                                                                                      \
            std::fprintf(stderr, "%s:%d: %s is %s (%s)\n", __FILE__, __LINE__, #call, cairn::result_name(given.code()),        \
                         given.why().what());                                                                                  \
            failed_checks++;                                                                                                   \
        }                                                                                                                      \
    } while (0)

#define OK(call) ANSWERS(CAIRN_OK, call)

/* Compile-time checks. */
template <class T> constexpr bool moves_only =
    std::is_nothrow_move_constructible_v<T> && std::is_nothrow_move_assignable_v<T> && !std::is_copy_constructible_v<T> &&
    !std::is_copy_assignable_v<T> && sizeof(T) == sizeof(void *);
static_assert(moves_only<cairn::device> && moves_only<cairn::world> && moves_only<cairn::anchor> && moves_only<cairn::rollout>);
static_assert(moves_only<cairn::guidance> && moves_only<cairn::presenter> && moves_only<cairn::script> && moves_only<cairn::recorder>);
static_assert(sizeof(cairn::controls) == sizeof(cairn_controls) && sizeof(cairn::requirement) == sizeof(cairn_requirement));
static_assert(!std::is_convertible_v<cairn_device *, cairn::device>, "a handle is taken over by name only");

static cairn::device two_threads()
{
    cairn::device_options options;
    options.threads = 2;
    options.flags = CAIRN_DEVICE_DETERMINISTIC | CAIRN_DEVICE_ENVIRONMENT;
    return cairn::device::cpu(options).value();
}

static cairn::script script_of(std::string_view text) { return cairn::script::create(text).value(); }

static void structs_have_their_size_and_are_zero()
{
    const cairn::controls still;
    CHECK(still.struct_size == sizeof(cairn_controls) && still.mouse_dx == 0 && still.keys[3] == 0);
    cairn_controls c{};
    c.scroll = 2;
    const cairn::controls taken = c;
    CHECK(taken.struct_size == sizeof(cairn_controls) && taken.scroll == 2);
    unsigned char pixels[2][3][4] = {};
    const cairn::picture picture = cairn::picture_of({&pixels[0][0][0], sizeof pixels}, 3, 2);
    CHECK(picture.size == 24 && picture.width == 3 && picture.pixels == pixels && picture.struct_size == sizeof(cairn_picture));
    std::vector<float> vector(5);
    const std::array<float, 4> array{};
    const float plain[3] = {};
    CHECK(cairn::span<const float>(vector).size() == 5 && cairn::span<const float>(array).data() == array.data());
    CHECK(cairn::span<const float>(plain).size() == 3 && cairn::span<float>().size() == 0);
}

static void versions_and_devices_equal_the_librarys()
{
    OK(cairn::check_version());
    CHECK(cairn::abi_version() == CAIRN_ABI_VERSION && cairn::version() == CAIRN_VERSION);
    const auto adapters = cairn::adapters();
    CHECK(adapters.ok() && !adapters->empty() && (*adapters)[0].kind == CAIRN_DEVICE_CPU);
    cairn::device_options options;
    options.flags = CAIRN_DEVICE_ENVIRONMENT;
    options.webgpu = "no/such/file";
    std::string refusals;
    const auto best = cairn::device::best(options, &refusals);
    CHECK(best.ok() && best->info()->kind == CAIRN_DEVICE_CPU && refusals.find("not WebGPU: ") != std::string::npos);
    const auto requirements = cairn::requirements(CAIRN_DEVICE_CPU);
    CHECK(requirements.ok() && requirements->size() >= 2 && (*requirements)[1].what == CAIRN_REQUIREMENT_ONNXRUNTIME);
    CHECK(requirements.ok() && std::strlen((*requirements)[1].needed) > 0);
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn::requirements(77));
    const auto info = two_threads().info();
    CHECK(info.ok() && info->threads == 2 && std::strstr(info->description, "2 threads") != nullptr);
}

static void a_handle_has_one_owner()
{
    cairn::device first = two_threads();
    cairn_device *const raw = first.get();
    cairn::device second = std::move(first);
    CHECK(!first && first.get() == nullptr && second && second.get() == raw);
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, first.info());
    OK(second.info());
    first = std::move(second);
    CHECK(first.get() == raw && !second);
    cairn::device &same = first;
    first = std::move(same);
    CHECK(first.get() == raw);

    /* The former object is destroyed, the new one is moved in. */
    cairn::device other = two_threads();
    cairn_device *const gone = other.get();
    other = std::move(first);
    CHECK(other.get() == raw && !first);
    cairn::device stale(gone);
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, stale.info());
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, stale.destroy());
    CHECK(stale.get() == gone);
    CHECK(stale.release() == gone && !stale);

    OK(other.destroy());
    CHECK(!other);
    OK(other.destroy());
    other.reset();
}

/* A load's callback tries to destroy the load's device. */
static void objects_that_a_callback_cannot_destroy_are_kept()
{
    cairn::device device = two_threads();
    cairn_result answer = CAIRN_OK;
    const auto loaded = cairn::world::load(device, {}, [&](const cairn::load_progress &) {
        answer = device.destroy().code();
        return false;
    });
    ANSWERS(CAIRN_ERROR_CANCELLED, loaded);
    CHECK(answer == CAIRN_ERROR_BUSY && device);
    OK(device.info());
}

static void failures_carry_code_message_and_parts()
{
    cairn::device_options options;
    options.threads = 1025;
    const auto failed = cairn::device::cpu(options);
    CHECK(!failed.ok() && failed.code() == CAIRN_ERROR_INVALID_ARGUMENT);
    const cairn::error &why = failed.why();
    CHECK(why.function() == "cairn_device_create_cpu" && why.field() == "threads" && !why.cause().empty() && !why.remedy().empty());
    const std::string_view message = why.what();
    CHECK(message.substr(0, 23) == "cairn_device_create_cpu" && message.find(why.remedy()) != message.npos);
    /* The copy does not change when something fails later. */
    const cairn::error copy = why;
    CHECK(cairn::script::create("no script").code() == CAIRN_ERROR_INVALID_ARGUMENT);
    CHECK(copy.what() == message && copy.function() == "cairn_device_create_cpu");

    const cairn::error none;
    CHECK(none.code() == CAIRN_OK && *none.what() == '\0' && none.cause().empty());
    const cairn::error own(CAIRN_ERROR_UNSUPPORTED, "a host's own");
    CHECK(own.code() == CAIRN_ERROR_UNSUPPORTED && std::string_view(own.what()) == "a host's own" && own.function().empty());
#if CAIRN_HPP_EXCEPTIONS
    int caught = 0;
    try {
        const cairn::device device = cairn::device::cpu(options).value();
        CHECK(!device);
    } catch (const std::exception &e) {
        const auto *as = dynamic_cast<const cairn::error *>(&e);
        caught = as && as->code() == CAIRN_ERROR_INVALID_ARGUMENT && as->field() == "threads" && as->what() == message;
    }
    try {
        cairn::rollout().cancel().value();
    } catch (const cairn::error &e) {
        caught += e.code() == CAIRN_ERROR_INVALID_HANDLE;
    }
    CHECK(caught == 2);
#endif
}

static void exceptions_of_a_progress_function_leave_the_load()
{
#if CAIRN_HPP_EXCEPTIONS
    const cairn::device device = two_threads();
    int calls = 0, caught = 0;
    try {
        (void)cairn::world::load(device, {}, [&](const cairn::load_progress &) -> bool {
            calls++;
            throw 7;
        });
    } catch (int thrown) {
        caught = thrown;
    }
    CHECK(calls == 1 && caught == 7);
#endif
}

static void scripts_equal_what_was_recorded()
{
    auto recorder = cairn::recorder::create().value();
    OK(recorder.key(10000, 0x57, true));
    OK(recorder.mouse(20000, 3, -4));
    OK(recorder.scroll(30000, -1));
    OK(recorder.key(90000, 0x57, false));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, recorder.key(90001, 256, true));
    const auto script = recorder.make_script(200000).value();
    CHECK(script.duration().value() == 200000);
    const auto controls = script.controls(1, 15).value();
    CHECK(controls.keys[1] == std::uint64_t{1} << 23 && controls.mouse_dx == 3 && controls.mouse_dy == -4 && controls.scroll < 0);
    const std::string text = script.text().value();
    CHECK(script_of(text).text().value() == text && text.rfind("cairn-controls 1", 0) == 0);

    auto steps = cairn::recorder::create().value();
    OK(steps.step(1, 15, controls));
    CHECK(steps.make_script(66667).value().controls(1, 15).value().mouse_dx == 3);
}

static void log_messages_reach_the_host()
{
    const cairn_log_callback count = [](std::uint32_t, const char *, const char *, void *user) { ++*static_cast<int *>(user); };
    static int messages;
    OK(cairn::set_log_callback(CAIRN_LOG_TRACE, count, &messages));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn::set_log_callback(77, count, &messages));
    OK(cairn::set_log_callback(CAIRN_LOG_OFF, nullptr));
}

static void threads_can_be_set_before_the_first_object()
{
    cairn::thread_options options;
    options.threads = 2;
    options.priority = CAIRN_PRIORITY_NORMAL;
    OK(cairn::set_threads(options));
    OK(cairn::set_threads());
    cairn::scheduler jobs;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn::set_scheduler(jobs));
    jobs.concurrency = 4;
    jobs.run = [](void *, std::uint32_t count, cairn_job job, void *data) {
        while (count-- > 0) job(data);
    };
    OK(cairn::set_scheduler(jobs));
    {
        const auto recorder = cairn::recorder::create().value();
        ANSWERS(CAIRN_ERROR_BUSY, cairn::set_threads(options));
        ANSWERS(CAIRN_ERROR_BUSY, cairn::reset_scheduler());
    }
    OK(cairn::reset_scheduler());
}

/* A grey picture of the given size and brightness `level`. */
static cairn::anchor grey(std::uint64_t number, unsigned char level, std::uint32_t flags = 0)
{
    const std::vector<unsigned char> pixels(40 * 24 * 4, level);
    return cairn::anchor::create(cairn::picture_of(pixels, 40, 24), number, flags).value();
}

static void presenters_show_due_frames_and_report_statistics()
{
    cairn::presenter_options options;
    options.multiplier = 4;
    options.interval_ns = 100;
    options.capacity = 1;
    auto presenter = cairn::presenter::create(options).value();
    std::vector<unsigned char> pixels(40 * 24 * 4);
    const auto target = cairn::target_of(pixels, 40, 24);
    CHECK(!presenter.query(0).value() && !presenter.draw(0, target).value());

    const cairn::anchor first = grey(0, 100), second = grey(1, 120);
    const auto guidance = cairn::guidance::create(first, second).value();
    CHECK(presenter.push(first, 0).value() && presenter.query(0).value()->source == CAIRN_FRAME_ANCHOR);
    CHECK(presenter.push(second, guidance, 100).value());
    CHECK(!presenter.push(grey(2, 140), 100).value());
    const auto frame = presenter.draw(125, target).value();
    CHECK(frame && frame->previous == 0 && frame->current == 1 && frame->t == 0.25f);
    CHECK(frame && (frame->source == CAIRN_FRAME_GENERATED || (frame->flags & CAIRN_FRAME_CUT)) && pixels[0] >= 100);
    const auto statistics = presenter.statistics().value();
    CHECK(statistics.anchors == 2 && std::strcmp(statistics.generator, "cpu") == 0);
    OK(presenter.restart());
    CHECK(!presenter.query(200).value());

    const auto info = guidance.info().value();
    CHECK(info.width == 40 && info.height == 24);
    std::vector<std::uint16_t> motion(40 * 24 * 2);
    std::vector<float> depth(40 * 24);
    OK(guidance.read_motion(motion));
    OK(guidance.read_depth(depth));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, guidance.read_depth({depth.data(), 7}));
    cairn::guidance_data data;
    data.width = 40;
    data.height = 24;
    data.motion = motion.data();
    data.motion_count = motion.size();
    OK(cairn::guidance::create(data));
}

/* A path through the embedded world that uses every function of a rollout. */
static void a_rollout_through_the_embedded_world()
{
    cairn::device device = two_threads();
    int stages = 0;
    cairn::world_options options;
    options.operating_point = "stock,g16,native,pictures:1";
    auto world = cairn::world::load(device, options, [&](const cairn::load_progress &now) {
        stages |= 1 << now.stage;
        return true;
    }).value();
    CHECK(stages == (1 << CAIRN_LOAD_READING | 1 << CAIRN_LOAD_PREPARING));
    const auto about = world.info().value();
    CHECK(world.memory().value().total > 0 && world.licence().ok() && std::strlen(about.licence) > 0);

    cairn::rollout_options seeded;
    seeded.seed = 7;
    auto rollout = cairn::rollout::create(world, seeded).value();
    /* The rollout keeps both alive. */
    world.reset();
    device.reset();
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, rollout.anchor());
    std::vector<unsigned char> seed(about.render_width * about.render_height * 4);
    for (std::size_t i = 0; i < seed.size(); i++) seed[i] = static_cast<unsigned char>(i * 31 >> 5 | 3);
    const auto picture = cairn::picture_of(seed, about.render_width, about.render_height);
    CHECK(rollout.append(picture).value().latent == 0);

    cairn::controls walk;
    walk.keys[1] = std::uint64_t{1} << 23;
    const auto state = rollout.save().value();
    CHECK(rollout.step(walk).value().latent == 1);
    const auto anchor = rollout.anchor().value();
    const auto info = anchor.info().value();
    CHECK(info.latent == 1 && info.width == about.render_width && info.height == about.render_height);
    std::vector<unsigned char> seen(seed.size()), again(seed.size());
    OK(anchor.read_picture(info.pictures - 1, cairn::target_of(seen, info.width, info.height)));
    CHECK(seen != again && seen != seed);
    std::vector<float> latent(info.latent_channels * info.latent_height * info.latent_width);
    OK(anchor.read_latent(latent));

    /* The same step, queued, after the state was restored. */
    OK(rollout.restore(state));
    OK(rollout.pause());
    const auto ticket = rollout.submit(walk).value();
    CHECK(ticket && !rollout.poll(*ticket).value() && !rollout.wait(*ticket, 1).value());
    CHECK(rollout.single_step().value() && !rollout.single_step().value());
    auto done = rollout.wait(*ticket).value();
    CHECK(done && done->step.latent == 1 && done->anchor);
    if (done) OK(done->anchor.read_picture(info.pictures - 1, cairn::target_of(again, info.width, info.height)));
    CHECK(again == seen);
    const auto pictured = rollout.submit(picture).value();
    OK(rollout.cancel());
    OK(rollout.resume());
    CHECK(pictured && rollout.wait(*pictured).code() == CAIRN_ERROR_CANCELLED);

    /* Four pictures are one latent; the embedded world's encoder has no stream to keep. */
    const cairn::picture four[] = {picture, picture, picture, picture};
    CHECK(rollout.append(four, 4).value().latent == 2);
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, rollout.append(four, 3));
    const auto several = rollout.submit(four, 4).value();
    CHECK(several && rollout.wait(*several).value()->step.latent == 3);
    OK(rollout.keep_encoder_stream(false));
    OK(rollout.rest());
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, rollout.keep_encoder_stream(true));
    OK(rollout.restore(state));
    OK(rollout.step(walk));

    OK(rollout.save_file("wrapper-state.bin"));
    OK(rollout.restart());
    CHECK(rollout.info().value().latents == 0);
    OK(rollout.restore_file("wrapper-state.bin"));
    CHECK(rollout.info().value().latents == 2 && rollout.statistics().value().latents >= 2);
    std::remove("wrapper-state.bin");
    ANSWERS(CAIRN_ERROR_IO, rollout.restore_file("wrapper-state.bin"));
}

int main()
{
    RUN(structs_have_their_size_and_are_zero);
    RUN(versions_and_devices_equal_the_librarys);
    RUN(a_handle_has_one_owner);
    RUN(objects_that_a_callback_cannot_destroy_are_kept);
    RUN(failures_carry_code_message_and_parts);
    RUN(exceptions_of_a_progress_function_leave_the_load);
    RUN(scripts_equal_what_was_recorded);
    RUN(log_messages_reach_the_host);
    RUN(threads_can_be_set_before_the_first_object);
    RUN(presenters_show_due_frames_and_report_statistics);
    RUN(a_rollout_through_the_embedded_world);
    return failed_tests != 0;
}
